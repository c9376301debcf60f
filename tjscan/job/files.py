"""The jobs of an arm with a line laser, a scan or a calibration, and how they are read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import numpy as np
from annotated_types import MaxLen, MinLen
from pydantic import model_validator

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.recorded_settings import RecordedSettings, SolveSettings
from tjscan.core.config import StrictFileModel, add_file_to_errors, read_toml, validate_table
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.frames import Array
from tjscan.core.units import LIST_OR_WORD_IN_FILE, PoseSettings
from tjscan.groove.settings import GROOVE_MODELS, GrooveSettings
from tjscan.job.devices import ArmSettings, CalibrationSettings, LaserSettings
from tjscan.job.reading import casefolded_name, read_job, replace_keys
from tjscan.job.simulation import SimulationSettings
from tjscan.job.surroundings import (
    BallSettings,
    BoardSettings,
    ClearanceSettings,
    JointSettings,
    StationSettings,
)
from tjscan.scanning.plan import ScanPlan


class CellJob(StrictFileModel):
    """Base of scan and calibration jobs: arm, laser, calibration, stations and surroundings."""

    arm: ArmSettings = ArmSettings()
    laser: LaserSettings = LaserSettings()
    calibration: CalibrationSettings
    board: BoardSettings | None = None
    ball: BallSettings | None = None
    joint: JointSettings | None = None
    station: Annotated[tuple[StationSettings, ...], MaxLen(50), LIST_OR_WORD_IN_FILE] = ()
    clearance: ClearanceSettings = ClearanceSettings()
    simulation: SimulationSettings | None = None

    @model_validator(mode="after")
    def _drivers_fit_together(self) -> CellJob:
        arm, laser = self.arm.driver_kind, self.laser.driver_kind
        if arm is DriverKind.REPLAYED and laser is not DriverKind.REPLAYED:
            raise ConfigurationError(
                'a replayed arm takes its poses from a recording: laser.driver must be "replay"',
                key="arm.driver",
            )
        if laser is DriverKind.REAL and arm is not DriverKind.REAL:
            raise ConfigurationError(
                f"a real laser can't sit on a {arm} arm: name the arm that carries it",
                key="arm.driver",
            )
        return self

    @model_validator(mode="after")
    def _stations_have_names_of_their_own(self) -> CellJob:
        simulated = () if self.simulation is None else self.simulation.station
        for key, tables in (("station", self.station), ("simulation.station", simulated)):
            names = [casefolded_name(table.name) for table in tables]
            for i, name in enumerate(names):
                if name in names[:i]:
                    raise ConfigurationError(
                        f"two stations are called {tables[i].name!r}; each needs a name of its "
                        "own, and upper and lower case, - and _ are alike",
                        key=f"{key}.{i}.name",
                    )
        for i, table in enumerate(simulated):
            if table.name not in self.station_names:
                nearest = nearest_word(table.name, self.station_names)
                raise ConfigurationError(
                    f"there is no station {table.name!r}; did you mean: "
                    f"{nearest or 'to name it under [[station]]'}?",
                    key=f"simulation.station.{i}.name",
                )
        return self

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
        return np.eye(4) if not self.station else self.job_at_station().station[0].T

    @property
    def T_w_b_true(self) -> Array:
        """True pose of the base in a simulated world; otherwise as `T_w_b`."""
        simulation = self.job_at_station().simulation
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
        if name is None and len(self.station) > 1:
            raise ConfigurationError(
                f"has several stations; choose one with --station: {', '.join(self.station_names)}",
                key="station",
            )
        if not self.station and name is None:
            return self
        if name is not None and name not in self.station_names:
            known = (
                f"did you mean: {nearest_word(name, self.station_names)}?"
                if self.station
                else "it has none"
            )
            raise ConfigurationError(f"there is no station {name!r}; {known}", key="station")
        i = 0 if name is None else self.station_names.index(name)
        return self._at(i)

    @property
    def jobs_at_stations(self) -> tuple[Self, ...]:
        """The job at each of its stations where the arm is, one job a station.

        A simulated arm is at all of them, a real one at one.

        Raises
        ------
        ConfigurationError
            If the arm is a real one, and the job has several stations.
        """
        if self.station and self.arm.driver_kind is DriverKind.SIMULATED:
            return tuple(self.job_at_station(name) for name in self.station_names)
        return (self.job_at_station(),)

    def _at(self, i: int) -> Self:
        station, simulation = self.station[i], self.simulation
        if simulation is not None:
            truly = tuple(table for table in simulation.station if table.name == station.name)
            home = truly[0].home if truly else None
            # Other errors of every move and profile, and yet the same arm and laser.
            simulation = simulation.with_seeds_of_devices()
            arm = simulation.arm
            if arm is not None and home is not None:
                arm = replace(arm, home=home)
            simulation = simulation.model_copy(
                update={"seed": simulation.seed + i, "station": truly, "arm": arm}
            )
        return self.model_copy(update={"station": (station,), "simulation": simulation})


class LaserJob(StrictFileModel):
    """The tables of a laser without an arm: the laser, and how its profiles are read."""

    laser: LaserSettings = LaserSettings()
    groove: GrooveSettings = GrooveSettings()


class ScanJob(CellJob):
    """A job file that describes a scan."""

    scan: ScanPlan
    groove: GrooveSettings = GrooveSettings()

    @model_validator(mode="after")
    def _groove_has_a_section(self) -> ScanJob:
        if not self.groove.model.has_section_points:
            able = ", ".join(
                repr(name) for name, model in GROOVE_MODELS.items() if model.has_section_points
            )
            raise ConfigurationError(
                f"{self.groove.model.name!r} has no section of five points, which a scan needs; "
                f"choose one of {able}",
                key="groove.model",
            )
        return self

    @model_validator(mode="after")
    def _has_its_start_poses(self) -> ScanJob:
        for which in ("first", "second"):
            taught = getattr(self.scan, which) is not None
            if taught == bool(self.station):
                raise ConfigurationError(
                    f"each station has its own start poses: move it to [station.{which}]"
                    if taught
                    else "this key is required, or [[station]] tables with their own start poses",
                    key=f"scan.{which}",
                )
        return self

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
            raise ConfigurationError("a taught pose is required here", key="scan")
        return table.first, table.second

    def _at(self, i: int) -> Self:
        job, station = super()._at(i), self.station[i]
        own = {key: getattr(station, key) for key in ("direction", "length", "sections")}
        stated = {key: value for key, value in own.items() if value is not None}
        bare = replace(station, direction=None, length=None, sections=None)
        scan = replace(self.scan, **stated)
        return job.model_copy(update={"scan": scan, "station": (bare,)})


class CalibrationJob(CellJob):
    """A job file that describes a calibration; it may have a [scan] table too."""

    board: BoardSettings
    scan: ScanPlan | None = None
    groove: GrooveSettings | None = None


class RecordedJob(StrictFileModel):
    """A job file of a calibration from recorded profiles: nothing moves."""

    recorded: Annotated[tuple[RecordedSettings, ...], MinLen(1), MaxLen(50), LIST_OR_WORD_IN_FILE]
    solve: SolveSettings = SolveSettings()
    arm: ArmSettings = ArmSettings()
    laser: LaserSettings = LaserSettings()
    noise: NoiseModel = NoiseModel()


J = TypeVar("J", CellJob, ScanJob, CalibrationJob, RecordedJob)


def read_scan_job(file: Path, overrides: dict[str, Any] | None = None) -> ScanJob:
    """Read the job of a scan, with single keys replaced; see `read_job`."""
    return _located(read_job(ScanJob, file, overrides), file.parent)


def read_calibration_job(file: Path, overrides: dict[str, Any] | None = None) -> CalibrationJob:
    """Read the job of a calibration, with single keys replaced; see `read_job`."""
    return _located(read_job(CalibrationJob, file, overrides), file.parent)


def read_recorded_job(file: Path, overrides: dict[str, Any] | None = None) -> RecordedJob:
    """Read the job of a calibration from recorded profiles; see `read_job`."""
    return _located(read_job(RecordedJob, file, overrides), file.parent)


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


def _located(job: J, folder: Path) -> J:
    """Seek an arm's URDF and a recording from the job's folder, as other files that a job names."""
    if Path(job.arm.model).suffix == ".urdf":
        arm = replace(job.arm, model=str(folder / job.arm.model))
        job = job.model_copy(update={"arm": arm})
    if job.laser.recording is not None:
        # Absolute: the job is copied into its run directory, a recording is not.
        recording = str((folder / job.laser.recording).absolute())
        job = job.model_copy(update={"laser": replace(job.laser, recording=recording)})
    return job
