"""The jobs of an arm with a line laser, a scan or a calibration, and how they are read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Self, TypeVar, cast

import numpy as np
from annotated_types import MaxLen, MinLen

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.pose_files import POSE_FILE_SUFFIXES, read_flange_poses
from tjscan.calibration.recorded_settings import RecordedSettings, SolveSettings
from tjscan.core.config import StrictFileModel, add_file_to_errors, read_toml, validate_table
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.frames import Array
from tjscan.core.units import LIST_OR_WORD_IN_FILE, PoseSettings
from tjscan.groove.settings import GROOVE_MODELS, GrooveSettings
from tjscan.job import surroundings
from tjscan.job.devices import ArmSettings, CalibrationSettings, CarrierSettings, LaserSettings
from tjscan.job.reading import casefolded_name, read_job, replace_keys
from tjscan.laser.files.read import PROFILE_SUFFIXES
from tjscan.laser.model import LaserModel
from tjscan.scanning.plan import ScanPlan

LEAST_FLANGE_DISTANCE: Final = 0.01
"""Metres of a taught flange from the base frame's origin, along one axis at least."""


class CellJob(StrictFileModel):
    """Base of scan and calibration jobs: arm, laser, calibration, stations and surroundings."""

    arm: ArmSettings = ArmSettings()
    laser: LaserSettings = LaserSettings()
    calibration: CalibrationSettings
    board: surroundings.BoardSettings | None = None
    ball: surroundings.BallSettings | None = None
    artefact: surroundings.ArtefactSettings | None = None
    accept: surroundings.AcceptanceSettings = surroundings.AcceptanceSettings()
    joint: surroundings.JointSettings | None = None
    carrier: CarrierSettings | None = None
    station: Annotated[
        tuple[surroundings.StationSettings, ...], MaxLen(50), LIST_OR_WORD_IN_FILE
    ] = ()
    clearance: surroundings.ClearanceSettings = surroundings.ClearanceSettings()
    simulation: surroundings.SimulationSettings | None = None

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Yield key and message of drivers that do not fit, and of names of stations."""
        arm, laser = self.arm.driver_kind, self.laser.driver_kind
        if arm is DriverKind.REPLAYED and laser is not DriverKind.REPLAYED:
            yield (
                "arm.driver",
                'a replayed arm takes its poses from a recording: laser.driver must be "replay"',
            )
        if laser is DriverKind.REAL and arm is not DriverKind.REAL:
            yield (
                "arm.driver",
                f"a real laser can't sit on a {arm} arm: name the arm that carries it",
            )
        simulated = () if self.simulation is None else self.simulation.station
        for key, tables in (("station", self.station), ("simulation.station", simulated)):
            names = [casefolded_name(table.name) for table in tables]
            for i in range(len(names)):
                if names[i] in names[:i]:
                    yield (
                        f"{key}.{i}.name",
                        f"two stations are called {tables[i].name!r}; each needs a name of its "
                        "own, and upper and lower case, - and _ are alike",
                    )
        for i, name in enumerate(table.name for table in simulated):
            if name not in self.station_names:
                nearest = nearest_word(name, self.station_names) or "to name it under [[station]]"
                yield (
                    f"simulation.station.{i}.name",
                    f"there is no station {name!r}; did you mean: {nearest}?",
                )
        yield from self._contradictions_of_carrier()

    def _contradictions_of_carrier(self) -> Iterator[tuple[str, str]]:
        carrier = self.carrier
        if carrier is not None and not self.station:
            yield "station", "a carrier goes from station to station: write [[station]] tables"
        if carrier is not None and carrier.home is None and len(self.station) > 1:
            yield "carrier.home_deg", "required: the joint angles in which the arm is carried"
        for i, station in enumerate(self.station):
            if carrier is None and station.carrier is not None:
                yield f"station.{i}.carrier", "there is no [carrier] table that says what carries"
            elif carrier is not None:
                try:
                    carrier.values_si(station.carrier or ())
                except ConfigurationError as error:
                    yield f"station.{i}.carrier", error.message

    @property
    def laser_model(self) -> LaserModel:
        """The laser: the window of [laser], the faults of [simulation.laser]."""
        faults = LaserModel() if self.simulation is None else self.simulation.laser
        table = self.laser
        return replace(faults, columns=table.points, near=table.near, far=table.far)

    @property
    def station_names(self) -> tuple[str, ...]:
        """Names of the stations, in their order."""
        return tuple(table.name for table in self.station)

    @property
    def T_w_b(self) -> Array:
        """Nominal pose of the arm's base in frame w, shape (4, 4), metres.

        Frame w is b for a job without stations.

        Raises
        ------
        ConfigurationError
            If the job has several stations.
        """
        if not self.station:
            return np.eye(4)
        if self.carrier is not None:
            return self.carrier.kinematics.T_w_b(self.carrier_values)
        return self.job_at_station().station[0].T

    @property
    def carrier_values(self) -> Array:
        """Values of the carrier's axes at the job's one station, metres and radians.

        Raises
        ------
        ConfigurationError
            If the job has no carrier, or several stations.
        """
        if self.carrier is None:
            raise ConfigurationError("there is no [carrier] table", key="carrier")
        return self.carrier.values_si(self.job_at_station().station[0].carrier or ())

    def with_carrier_at(self, values: Array) -> Self:
        """The same job of one station with the carrier somewhere else, metres and radians."""
        if self.carrier is None:
            return self
        low, high = np.transpose([axis.bounds for axis in self.carrier.axis])
        reached = self.carrier.values_in_file(np.clip(values, low, high))
        station = replace(self.station[0], carrier=reached)
        return self.model_copy(update={"station": (station,)})

    @property
    def T_w_b_true(self) -> Array:
        """True pose of the base in a simulated world; otherwise as `T_w_b`."""
        simulation = self.job_at_station().simulation
        if self.carrier is not None and simulation is not None:
            return self.carrier.true_T_w_b(self.carrier_values, simulation.seed)
        stations = () if simulation is None else simulation.station
        return stations[0].T if stations else self.T_w_b

    def job_at_station(self, name: str | None = None) -> Self:
        """The same job at one of its stations, which then is its only one.

        Keys of the station are moved to their places in a job without stations. A simulated world
        draws other random numbers at each.

        Parameters
        ----------
        name : str, optional
            Which; may be left out if there is only one, or none.

        Raises
        ------
        ConfigurationError
            If there is no such station, or the job has several and none is named.
        """
        names = self.station_names
        if name is None and len(names) > 1:
            raise ConfigurationError(
                f"has several stations; choose one with --station: {', '.join(names)}",
                key="station",
            )
        if name is not None and name not in names:
            known = f"did you mean: {nearest_word(name, names)}?" if names else "it has none"
            raise ConfigurationError(f"there is no station {name!r}; {known}", key="station")
        return self._job_at_number(names.index(name or names[0])) if names else self

    @property
    def jobs_at_stations(self) -> tuple[Self, ...]:
        """The job at each of its stations where the arm is, one job a station.

        A simulated arm is at all of them, and one on a carrier gets there, but for start poses that
        another station gives; any other is at one.

        Raises
        ------
        ConfigurationError
            If the arm is a real one, and the job has several stations.
        """
        carried = self.carrier is not None
        if self.station and (carried or self.arm.driver_kind is DriverKind.SIMULATED):
            taught = [one.name for one in self.station if one.first or not carried]
            return tuple(self.job_at_station(name) for name in taught)
        return (self.job_at_station(),)

    def _job_at_number(self, i: int) -> Self:
        station, simulation = self.station[i], self.simulation
        if simulation is not None:
            truly = tuple(table for table in simulation.station if table.name == station.name)
            # Other errors of every move and profile, and yet the same arm and laser.
            simulation = simulation.with_seeds_of_devices()
            arm = simulation.arm
            if arm is not None and truly and truly[0].home is not None:
                arm = replace(arm, home=truly[0].home)
            simulation = simulation.model_copy(
                update={"seed": simulation.seed + i, "station": truly, "arm": arm}
            )
        return self.model_copy(update={"station": (station,), "simulation": simulation})


class CarrierFile(StrictFileModel):
    """A file with the table of a carrier alone."""

    carrier: CarrierSettings


class LaserJob(StrictFileModel):
    """The tables of a laser without an arm: the laser, and how its profiles are read."""

    laser: LaserSettings = LaserSettings()
    groove: GrooveSettings = GrooveSettings()


class ScanJob(CellJob):
    """A job file that describes a scan."""

    scan: ScanPlan
    groove: GrooveSettings = GrooveSettings()

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Yield also what of the groove and the start poses does not fit a scan."""
        yield from super().contradictions()
        if not self.groove.model.has_section_points:
            able = [repr(name) for name, model in GROOVE_MODELS.items() if model.has_section_points]
            yield (
                "groove.model",
                f"{self.groove.model.name!r} has no section of five points, which a scan needs; "
                f"choose one of {', '.join(able)}",
            )
        if self.scan.mode == "continuous" and self.scan.sections is not None:
            yield (
                "scan.sections",
                'a continuous scan (mode = "continuous") has a section every section_mm: say how '
                "far it shall go with length_mm",
            )
        if self.scan.mode == "continuous" and self.scan.settle is not None:
            yield (
                "scan.settle",
                'a continuous scan (mode = "continuous") never rests, so nothing settles: leave '
                'the table out, or scan with mode = "stepwise"',
            )
        if self.scan.mode == "continuous" and self.arm.shaper is not None:
            yield "arm.shaper", 'a continuous scan (mode = "continuous") shapes no moves'
        tables = {"scan": self.scan} | {f"station.{i}": one for i, one in enumerate(self.station)}
        for name, table in tables.items():
            for which in ("first", "second"):
                start = getattr(table, which)
                if start is not None and 0 < max(map(abs, start.position)) < LEAST_FLANGE_DISTANCE:
                    found = [float(f"{1e3 * value:.6g}") for value in start.position]
                    meant = [float(f"{1e6 * value:.6g}") for value in start.position]
                    yield (
                        f"{name}.{which}.position_mm",
                        f"no flange is in the middle of its base; {found} looks like metres: "
                        f"write {meant}",
                    )
        for which in ("first", "second"):
            for i, one in enumerate(self.station):
                if getattr(one, which) is None and (self.carrier is None or i == 0):
                    yield f"station.{i}.{which}", "this key is required"
            taught = getattr(self.scan, which) is not None
            if taught == bool(self.station):
                yield (
                    f"scan.{which}",
                    f"each station has its own start poses: move it to [station.{which}]"
                    if taught
                    else "this key is required, or [[station]] tables with their own start poses",
                )

    @property
    def start_poses(self) -> tuple[PoseSettings, PoseSettings]:
        """The first and the second taught pose of the flange in frame b.

        Raises
        ------
        ConfigurationError
            If the job has several stations.
        """
        table = self.job_at_station().station[0] if self.station else self.scan
        if table.first is None or table.second is None:
            raise ConfigurationError(
                "a taught pose is required here, or the scan of the station before", key="scan"
            )
        return table.first, table.second

    def _job_at_number(self, i: int) -> Self:
        job, station = super()._job_at_number(i), self.station[i]
        own = {key: getattr(station, key) for key in ("direction", "length", "sections")}
        scan = replace(self.scan, **{key: value for key, value in own.items() if value is not None})
        bare = replace(station, direction=None, length=None, sections=None)
        return job.model_copy(update={"scan": scan, "station": (bare,)})


class CalibrationJob(CellJob):
    """A job file that describes a calibration; it may have a [scan] table too."""

    board: surroundings.BoardSettings
    scan: ScanPlan | None = None
    groove: GrooveSettings | None = None


class AcceptanceJob(CellJob):
    """A job file of a cell with an artefact; it may have a [scan] table too."""

    ball: surroundings.BallSettings
    artefact: surroundings.ArtefactSettings
    scan: ScanPlan | None = None
    groove: GrooveSettings | None = None


class RecordedJob(StrictFileModel):
    """A job file of a calibration from recorded profiles: nothing moves."""

    recorded: Annotated[tuple[RecordedSettings, ...], MinLen(1), MaxLen(50), LIST_OR_WORD_IN_FILE]
    solve: SolveSettings = SolveSettings()
    arm: ArmSettings = ArmSettings()
    laser: LaserSettings = LaserSettings()
    noise: NoiseModel = NoiseModel()


J = TypeVar("J", bound=ScanJob | CalibrationJob | AcceptanceJob | RecordedJob)


def read_scan_job(file: Path, overrides: dict[str, Any] | None = None) -> ScanJob:
    """Read the job of a scan, with single keys replaced; see `read_job`."""
    return read_located_job(ScanJob, file, overrides)


def read_calibration_job(file: Path, overrides: dict[str, Any] | None = None) -> CalibrationJob:
    """Read the job of a calibration, with single keys replaced; see `read_job`."""
    return read_located_job(CalibrationJob, file, overrides)


def read_acceptance_job(file: Path, overrides: dict[str, Any] | None = None) -> AcceptanceJob:
    """Read the job of an acceptance, with single keys replaced; see `read_job`."""
    return read_located_job(AcceptanceJob, file, overrides)


def read_recorded_job(file: Path, overrides: dict[str, Any] | None = None) -> RecordedJob:
    """Read the job of a calibration from recorded profiles; see `read_job`."""
    return read_located_job(RecordedJob, file, overrides)


def recorded_job_of_files(
    recording: Path, table: dict[str, Any], overrides: dict[str, Any]
) -> RecordedJob:
    """The job of a recording that has none.

    Parameters
    ----------
    recording : Path
        Profiles of one target, in a file or a folder; flange poses are in a file beside them.
    table : dict
        Keys of the table [[recorded]]; without poses, the one file of poses is found.
    overrides : dict
        Further keys of the job, dotted.

    Raises
    ------
    ConfigurationError
        If the target is not stated, no file or several hold poses, or a key is wrong.
    """
    if "target" not in table:
        raise ConfigurationError(
            "what do these profiles show? --target ball, roof or plane, or points; the radius of a "
            "ball is checked if it is stated: --radius-mm",
            file=recording,
        )
    folder = recording if recording.is_dir() else recording.parent
    if table["target"] != "points" and (folder == recording or "poses" not in table):
        found = [file for file in sorted(folder.iterdir()) if _holds_poses(file, recording)]
        named = f" (found: {', '.join(file.name for file in found[:8])})" * bool(found)
        if len(found) > 1 or not (found or "poses" in table):
            raise ConfigurationError(
                f"which file holds the flange's poses, one for each profile?{named} State it with "
                "--poses, and one set's profiles by their own file or folder",
                file=folder,
            )
        table = {"poses": str(found[0])} | table if found else table
    paths = {k: str(Path(table[k]).absolute()) for k in ("poses", "touched") if k in table}
    data = {"recorded": [table | paths | {"profiles": str(recording.absolute())}]}
    replace_keys(data, overrides)
    return validate_table(RecordedJob, data)


def _holds_poses(file: Path, recording: Path) -> bool:
    if file == recording or file.suffix.lower() not in POSE_FILE_SUFFIXES:
        return False
    with suppress(ConfigurationError):
        return bool(read_flange_poses(file).T_b_f)
    return False


def is_recording(file: Path) -> bool:
    """Whether these are profiles themselves, by name, and no job."""
    return file.is_dir() or file.suffix.lower() in PROFILE_SUFFIXES


def has_recorded_profiles(file: Path) -> bool:
    """Whether the job of a calibration has recorded profiles, so that nothing moves.

    Raises
    ------
    ConfigurationError
        If the file can't be read.
    """
    return "recorded" in read_toml(file)


def read_laser_job(file: Path, overrides: dict[str, Any] | None = None) -> LaserJob:
    """Read the tables of a laser and its reading alone, from a job of any kind or a file of these.

    Parameters
    ----------
    file, overrides
        As for `read_job`.

    Raises
    ------
    ConfigurationError
        If the file can't be read, or a key of these tables is wrong.
    """
    data = read_toml(file)
    with add_file_to_errors(file):
        replace_keys(data, overrides or {})
        return validate_table(LaserJob, {k: data[k] for k in LaserJob.model_fields if k in data})


def read_located_job(model: type[J], file: Path, overrides: dict[str, Any] | None) -> J:
    """Read a job; its arm's URDF and its recording are sought from its folder, as other files."""
    job = read_job(model, file, overrides)
    arm, laser = job.arm, job.laser
    if Path(arm.model).suffix == ".urdf":
        arm = replace(arm, model=str(file.parent / arm.model))
    if laser.recording is not None:
        # Absolute: the job is copied into its run directory, a recording is not.
        laser = replace(laser, recording=str((file.parent / laser.recording).absolute()))
    return cast(J, job.model_copy(update={"arm": arm, "laser": laser}))
