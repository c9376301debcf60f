"""The job file: one scan, or one calibration, in millimetres and degrees, as a person writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self, TypeVar

import numpy as np
from pydantic import Field, model_validator

from tjscan.calibration.file import NoiseTable, PoseRows, rows_to_pose
from tjscan.config import FileModel, naming, read_toml, validate
from tjscan.errors import ConfigurationError, nearest
from tjscan.frames import Array, from_euler_zyx
from tjscan.groove.models import MODELS
from tjscan.groove.settings import DEFAULT, GrooveSettings
from tjscan.robot.solids import Box, Capsule, Cylinder, Shape, Solid

FARTHEST_MM: Final = 1e5
"""A hundred metres: nothing in a cell is further."""

MOST: Final = 300
"""Solids of a cell: each is held against every link of the arm, at every step of a path."""

Coordinate = Annotated[float, Field(ge=-FARTHEST_MM, le=FARTHEST_MM)]
Vector3 = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
JointAngle = Annotated[float, Field(ge=-720, le=720)]
Length = Annotated[float, Field(gt=0, le=FARTHEST_MM)]
Lengths = Annotated[tuple[Length, ...], Field(strict=False, max_length=20)]

SMALLEST_BOARD_MM: Final = 100.0
EXCLUDED: Final = {"calibration.file": "T_f_s_mm", "calibration.T_f_s_mm": "file"}
"""What a replaced key leaves no room for in its table."""


class PoseTable(FileModel):
    """A pose as controllers show it: position and Z-Y-X Euler angles."""

    position_mm: Vector3
    euler_zyx_deg: Vector3

    @property
    def T(self) -> Array:
        """The pose, shape (4, 4), metres."""
        return from_euler_zyx(
            1e-3 * np.array(self.position_mm), np.radians(np.array(self.euler_zyx_deg))
        )


class SkipTable(FileModel):
    """When a correction is not worth its move: the view is as near as this to the ideal one.

    Unless `enabled` says otherwise, the paper's cases always make the correction.
    """

    enabled: bool | None = None
    position_mm: float = Field(default=8.0, gt=0, le=50)
    work_angle_deg: float = Field(default=5.0, gt=0, le=30)
    rotation_deg: float = Field(default=8.0, gt=0, le=30)


class AdaptiveTable(FileModel):
    """How much may change from section to section: steps are as long as that allows.

    `turn_deg` is the bend of the groove's direction. While there is this table, `step_mm` counts
    for the taught poses alone.
    """

    least_mm: float = Field(default=10.0, ge=5, le=300)
    most_mm: float = Field(default=80.0, ge=5, le=300)
    angle_change_deg: float = Field(default=3.0, gt=0, le=90)
    area_change_mm2: float = Field(default=50.0, gt=0, le=1e5)
    turn_deg: float = Field(default=20.0, gt=0, le=90)

    @model_validator(mode="after")
    def _range_is_one(self) -> AdaptiveTable:
        if self.least_mm > self.most_mm:
            raise ValueError("least_mm must not be larger than most_mm")
        return self


class ScanTable(FileModel):
    """What to scan, from where, and when to stop."""

    direction: Literal["counterclockwise", "clockwise"] = "counterclockwise"
    step_mm: float = Field(default=40.0, ge=5, le=300)
    prediction_case: Literal[1, 2, 3, 4, "smooth"] = 3
    pull_angle_deg: float = Field(default=10.0, ge=-45, le=45)
    standoff_mm: float = Field(default=230.0, ge=10, le=2000)
    view_offset_mm: float = Field(default=-15.0, ge=-500, le=500)
    length_mm: float | None = Field(default=None, gt=0)
    sections: int | None = Field(default=None, ge=3)
    resume_tolerance_mm: float = Field(default=0.5, gt=0, le=50)
    skip: SkipTable = SkipTable()
    adaptive: AdaptiveTable | None = None
    first: PoseTable | None = None
    second: PoseTable | None = None


class NamedPoseTable(PoseTable):
    """The pose of a station's base, in frame w. Its name is one of a folder, too."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]


class StationTable(NamedPoseTable):
    """A place that is scanned from: where the arm's base stands in frame w, about, and its start.

    What it leaves out holds as in [scan].
    """

    direction: Literal["counterclockwise", "clockwise"] | None = None
    length_mm: float | None = Field(default=None, gt=0)
    sections: int | None = Field(default=None, ge=3)
    first: PoseTable
    second: PoseTable


class ReadingTable(FileModel):
    """How a groove is looked for in a profile; see `tjscan.groove.settings.GrooveSettings`."""

    model: Literal["tee", "butt-v", "butt-v-sharp"] = "tee"
    noise_mm: float = Field(default=1e3 * DEFAULT.noise, gt=0, le=5)
    minimum_points: int = Field(default=DEFAULT.minimum_points, ge=20, le=10_000)
    largest_sigma_mm: float = Field(default=1e3 * DEFAULT.largest_sigma, gt=0, le=10)
    largest_rms_mm: float = Field(default=1e3 * DEFAULT.largest_rms, gt=0, le=10)
    inlier_share: float = Field(default=DEFAULT.inlier_share, gt=0, le=1)

    @property
    def settings(self) -> GrooveSettings:
        """In metres."""
        return GrooveSettings(
            model=MODELS[self.model],
            noise=1e-3 * self.noise_mm,
            minimum_points=self.minimum_points,
            largest_sigma=1e-3 * self.largest_sigma_mm,
            largest_rms=1e-3 * self.largest_rms_mm,
            inlier_share=self.inlier_share,
        )


class GrooveTable(ReadingTable):
    """How a scan reads its grooves: a scan needs the five points of a section."""

    model: Literal["tee", "butt-v-sharp"] = "tee"


class UrTable(FileModel):
    """A Universal Robots arm: where its controller is, what it carries, what it is held to.

    Without `payload_kg` the payload of its pendant holds.
    """

    host: str = Field(min_length=1)
    payload_kg: float | None = Field(default=None, ge=0, le=50)
    payload_centre_mm: Vector3 = (0.0, 0.0, 0.0)
    position_tolerance_mm: float = Field(default=0.5, gt=0, le=10)
    rotation_tolerance_deg: float = Field(default=0.1, gt=0, le=5)
    connect_s: float = Field(default=15.0, ge=1, le=120)
    silence_s: float = Field(default=1.0, ge=0.1, le=60)

    @model_validator(mode="after")
    def _payload_is_whole(self) -> UrTable:
        if self.payload_kg is None and any(self.payload_centre_mm):
            raise ValueError("payload_centre_mm needs payload_kg beside it")
        return self


class ArmTable(FileModel):
    """The arm and the bounds it moves within."""

    driver: Literal["simulated", "ur"] = "simulated"
    model: str = "ur10e"
    id: str | None = Field(default=None, min_length=1)
    speed_mm_s: float = Field(default=250.0, ge=1, le=3000)
    acceleration_mm_s2: float = Field(default=1200.0, ge=10, le=50_000)
    ur: UrTable | None = None

    @model_validator(mode="after")
    def _has_its_table(self) -> ArmTable:
        if self.driver == "ur" and self.ur is None:
            raise ValueError('driver "ur" needs a table [arm.ur] with the host of the controller')
        return self

    @property
    def device(self) -> str:
        """What a calibration calls this arm: its id, or its model where it has none."""
        return self.id or self.model


class LaserTable(FileModel):
    """The line laser and the window it measures in.

    The driver "replay" sees again what a recording holds, `recording` being a run directory or
    a file of its; then the arm, whatever its driver, stands where it stood, and nothing moves.
    """

    driver: Literal["simulated", "replay"] = "simulated"
    recording: str | None = Field(default=None, min_length=1)
    replay_tolerance_mm: float = Field(default=5.0, ge=0, le=1000)
    replay_tolerance_deg: float = Field(default=2.0, ge=0, le=180)
    id: str | None = Field(default=None, min_length=1)
    points: int = Field(default=640, ge=160, le=640, multiple_of=80)
    near_mm: float = Field(default=190.0, ge=1, le=5000)
    far_mm: float = Field(default=290.0, ge=1, le=5000)

    @model_validator(mode="after")
    def _range_is_one(self) -> LaserTable:
        if self.near_mm >= self.far_mm:
            raise ValueError("near_mm must be smaller than far_mm")
        return self

    @model_validator(mode="after")
    def _replay_has_a_recording(self) -> LaserTable:
        if self.driver == "replay" and self.recording is None:
            raise ValueError('driver "replay" needs a recording: a run directory, or its scan.mcap')
        return self

    @property
    def is_replay(self) -> bool:
        """Whether no device is there, neither laser nor arm."""
        return self.driver == "replay"

    @property
    def device(self) -> str:
        """What a calibration calls this laser: its id, or its driver where it has none."""
        return self.id or self.driver


class CalibrationTable(FileModel):
    """Where the laser sits on the hand: rows of T_f_s, or the file that a calibration left."""

    T_f_s_mm: PoseRows | None = None
    file: str | None = None

    @model_validator(mode="after")
    def _is_one_of_both(self) -> CalibrationTable:
        if (self.T_f_s_mm is None) == (self.file is None):
            raise ValueError("needs either T_f_s_mm or file, and not both")
        return self

    @property
    def T_f_s(self) -> Array | None:
        """Pose of the sensor in the flange frame, shape (4, 4), metres, where it stands here."""
        return None if self.T_f_s_mm is None else rows_to_pose(self.T_f_s_mm)


class SolidTable(PoseTable):
    """A simple solid about the origin of its frame; cylinder and capsule lie along its z axis."""

    name: str = Field(min_length=1)
    kind: Literal["box", "cylinder", "capsule"]
    size_mm: Annotated[tuple[Length, Length, Length], Field(strict=False)] | None = None
    radius_mm: Length | None = None
    length_mm: Length | None = None
    euler_zyx_deg: Vector3 = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _has_its_sizes(self) -> SolidTable:
        is_box = self.kind == "box"
        round_sizes = (self.radius_mm, self.length_mm)
        if is_box != (self.size_mm is not None) or any(is_box != (s is None) for s in round_sizes):
            raise ValueError(
                f"a {self.kind} takes {'size_mm' if is_box else 'radius_mm and length_mm'} alone"
            )
        return self

    @property
    def solid(self) -> Solid:
        """In metres."""
        return Solid(self.name, self._shape, self.T)

    @property
    def _shape(self) -> Shape:
        if self.size_mm is not None:
            x, y, z = self.size_mm
            return Box((1e-3 * x, 1e-3 * y, 1e-3 * z))
        shape = Cylinder if self.kind == "cylinder" else Capsule
        return shape(1e-3 * (self.radius_mm or 0.0), 1e-3 * (self.length_mm or 0.0))


class StandingTable(SolidTable):
    """A solid that stands in the base frame, b, or about the workpiece, w."""

    frame: Literal["b", "w"] = "b"


class ClearanceTable(FileModel):
    """What the arm keeps clear of: `solid` stands in b or w, `tool` sits on the flange, frame f.

    The defaults are assumptions about a cell that was measured with a tape.
    """

    margin_mm: float = Field(default=10.0, ge=0, le=500)
    self_margin_mm: float = Field(default=5.0, ge=0, le=500)
    self_collision: bool = True
    smallest_singular_value: float = Field(default=0.02, ge=0, le=1)
    lifts_mm: Lengths = (50.0, 100.0, 200.0, 300.0)
    ignore: Annotated[
        tuple[Annotated[tuple[str, str], Field(strict=False)], ...], Field(strict=False)
    ] = ()
    solid: Annotated[tuple[StandingTable, ...], Field(strict=False, max_length=MOST)] = ()
    tool: Annotated[tuple[SolidTable, ...], Field(strict=False, max_length=MOST)] = ()


class BoardTable(FileModel):
    """The flat board to calibrate on: where it is about, and what to take of it.

    The frame's origin is the middle of the board's face, x along the first side, z away from it.
    """

    position_mm: Vector3
    euler_zyx_deg: Vector3
    size_mm: Annotated[tuple[float, float], Field(strict=False)]
    probe_tip_mm: Vector3
    approach_mm: float = Field(default=30.0, gt=0, le=500)
    touches: int = Field(default=9, ge=3, le=100)
    lines: int = Field(default=12, ge=5, le=100)
    noise: NoiseTable = NoiseTable()

    @model_validator(mode="after")
    def _has_a_size(self) -> BoardTable:
        if min(self.size_mm) < SMALLEST_BOARD_MM:
            raise ValueError(f"size_mm: a board is {SMALLEST_BOARD_MM:g} mm wide or wider")
        return self

    @property
    def T(self) -> Array:
        """Nominal pose of the board in the base frame, shape (4, 4), metres."""
        return PoseTable(position_mm=self.position_mm, euler_zyx_deg=self.euler_zyx_deg).T


class JointTable(FileModel):
    """The joint as designed: what the comparison measures against, and the simulated world.

    Its place is told in frame w, which is b for a job without stations. The scanner itself never
    looks at it.
    """

    file: str
    position_mm: Vector3
    euler_zyx_deg: Vector3

    @property
    def T_w_j(self) -> Array:
        """Pose of the joint in frame w, shape (4, 4), metres."""
        return PoseTable(position_mm=self.position_mm, euler_zyx_deg=self.euler_zyx_deg).T


class SimulatedArmTable(FileModel):
    """What only a simulated arm needs to be told."""

    home_deg: Annotated[tuple[JointAngle, ...], Field(strict=False)]
    repeatability_mm: float = Field(default=0.05, ge=0, le=5)
    repeatability_deg: float = Field(default=0.006, ge=0, le=5)
    realtime: bool = False


class SimulatedLaserTable(FileModel):
    """The faults of the simulated laser; zero switches one off.

    What each means, and which are assumptions, stands at `tjscan.laser.model.LaserModel`.
    """

    noise_mm: float = Field(default=0.03, ge=0, le=5)
    noise_correlation_points: float = Field(default=4.0, ge=0, le=100)
    bias_mm: float = Field(default=0.02, ge=0, le=5)
    dropout: Fraction = 1.0
    missing: Fraction = 0.02
    ghosts: Fraction = 0.065
    flyers: Fraction = 0.3
    occlusion: bool = True
    resolution_mm: float = Field(default=0.005, ge=0, le=1)


class SimulatedBoardTable(PoseTable):
    """Where the board truly is, and how well it is touched."""

    touch_mm: float = Field(default=0.05, ge=0, le=5)


class SimulatedStationTable(NamedPoseTable):
    """Where a station's base truly stands in frame w, and how the arm stands on it before."""

    home_deg: Annotated[tuple[JointAngle, ...], Field(strict=False)] | None = None


class SimulationTable(FileModel):
    """The simulated world.

    `T_f_s_mm` is where the laser truly sits, `board` where the board truly is, `station` where
    stations truly are; where left out, they are where the job believes them to be.
    """

    seed: int = Field(default=1, ge=0)
    T_f_s_mm: PoseRows | None = None
    board: SimulatedBoardTable | None = None
    station: Annotated[tuple[SimulatedStationTable, ...], Field(strict=False)] = ()
    arm: SimulatedArmTable
    laser: SimulatedLaserTable = SimulatedLaserTable()


class CellFile(FileModel):
    """What a scan and a calibration have in common: the cell."""

    arm: ArmTable = ArmTable()
    laser: LaserTable = LaserTable()
    calibration: CalibrationTable
    board: BoardTable | None = None
    joint: JointTable | None = None
    station: Annotated[tuple[StationTable, ...], Field(strict=False)] = ()
    clearance: ClearanceTable = ClearanceTable()
    simulation: SimulationTable | None = None

    @model_validator(mode="after")
    def _simulation_is_whole(self) -> CellFile:
        drivers = () if self.laser.is_replay else (self.arm.driver, self.laser.driver)
        if "simulated" in drivers and self.simulation is None:
            raise ValueError("a simulated arm or laser needs a [simulation] table")
        return self

    @model_validator(mode="after")
    def _stations_are_told_apart(self) -> CellFile:
        simulated = () if self.simulation is None else self.simulation.station
        for key, tables in (("station", self.station), ("simulation.station", simulated)):
            names = [_folded(table.name) for table in tables]
            for i, name in enumerate(names):
                if name in names[:i]:
                    raise ConfigurationError(
                        f"two stations are called {tables[i].name!r}; each needs a name of its "
                        "own, and upper and lower case, - and _ are alike",
                        key=f"{key}.{i}.name",
                    )
        for i, table in enumerate(simulated):
            if table.name not in self.stations:
                raise ConfigurationError(
                    f"there is no station {table.name!r}; did you mean: "
                    f"{nearest(table.name, self.stations) or 'to name it under [[station]]'}?",
                    key=f"simulation.station.{i}.name",
                )
        return self

    @property
    def stations(self) -> tuple[str, ...]:
        """Names of the stations, in their order."""
        return tuple(table.name for table in self.station)

    @property
    def T_w_b(self) -> Array:
        """Where the base is believed to stand in frame w, shape (4, 4), metres.

        Frame w is b for a job without stations.

        Raises
        ------
        ConfigurationError
            If the job has several stations.
        """
        return np.eye(4) if not self.station else self.at().station[0].T

    @property
    def T_w_b_true(self) -> Array:
        """Where the base of a simulated world truly stands; otherwise as `T_w_b`."""
        simulation = self.at().simulation
        stands = () if simulation is None else simulation.station
        return stands[0].T if stands else self.T_w_b

    def at(self, name: str | None = None) -> Self:
        """The same job at one of its stations, which then is its only one.

        What the station says for itself stands where it would for a job without stations. A
        simulated world draws other random numbers at each.

        Parameters
        ----------
        name : str, optional
            Which; may be left out where there is but one, or none.

        Raises
        ------
        ConfigurationError
            If there is no such station, or the job has several and none is named.
        """
        if name is None and len(self.station) > 1:
            raise ConfigurationError(
                f"has several stations; choose one with --station: {', '.join(self.stations)}",
                key="station",
            )
        if not self.station and name is None:
            return self
        if name is not None and name not in self.stations:
            known = (
                f"did you mean: {nearest(name, self.stations)}?" if self.station else "it has none"
            )
            raise ConfigurationError(f"there is no station {name!r}; {known}", key="station")
        i = 0 if name is None else self.stations.index(name)
        return self._at(i)

    @property
    def places(self) -> tuple[Self, ...]:
        """The job at each station that its arm stands at.

        A simulated arm stands at all of them, a real one at one.

        Raises
        ------
        ConfigurationError
            If the arm is a real one, and the job has several stations.
        """
        if self.station and self.arm.driver == "simulated":
            return tuple(self.at(name) for name in self.stations)
        return (self.at(),)

    def _at(self, i: int) -> Self:
        station, simulation = self.station[i], self.simulation
        if simulation is not None:
            truly = tuple(table for table in simulation.station if table.name == station.name)
            home = truly[0].home_deg if truly else None
            arm = simulation.arm
            arm = arm if home is None else arm.model_copy(update={"home_deg": home})
            simulation = simulation.model_copy(
                update={"seed": simulation.seed + i, "station": truly, "arm": arm}
            )
        return self.model_copy(update={"station": (station,), "simulation": simulation})


class JobFile(CellFile):
    """One scan."""

    scan: ScanTable
    groove: GrooveTable = GrooveTable()

    @model_validator(mode="after")
    def _laser_has_a_joint(self) -> JobFile:
        if self.laser.driver == "simulated" and self.joint is None:
            raise ValueError("a simulated laser needs a [joint] table to look at")
        return self

    @model_validator(mode="after")
    def _has_its_start_poses(self) -> JobFile:
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
    def starts(self) -> tuple[PoseTable, PoseTable]:
        """The first and the second taught pose of the flange in frame b.

        Raises
        ------
        ConfigurationError
            If the job has several stations.
        """
        table = self.at().station[0] if self.station else self.scan
        if table.first is None or table.second is None:
            raise ConfigurationError("a taught pose is required here", key="scan")
        return table.first, table.second

    def _at(self, i: int) -> Self:
        job, station = super()._at(i), self.station[i]
        own = {key: getattr(station, key) for key in ("direction", "length_mm", "sections")}
        said = {key: value for key, value in own.items() if value is not None}
        bare = station.model_copy(update=dict.fromkeys(own))
        scan = self.scan.model_copy(update=said)
        return job.model_copy(update={"scan": scan, "station": (bare,)})


class CalibrationJob(CellFile):
    """One calibration. A [scan] table may stand beside it, so that one file serves both."""

    board: BoardTable
    scan: ScanTable | None = None
    groove: GrooveTable | None = None


J = TypeVar("J", bound=CellFile)


def read_job(file: Path, overrides: dict[str, Any] | None = None) -> JobFile:
    """Read the job of a scan, with single keys replaced.

    Parameters
    ----------
    file : Path
        The TOML file.
    overrides : dict, optional
        Dotted keys such as ``scan.step_mm`` and their values. One of two keys that exclude each
        other displaces the other.

    Raises
    ------
    ConfigurationError
        If the file can't be read, or a key is unknown, missing or of a wrong type or value.
    """
    return _read(JobFile, file, overrides)


def read_calibration_job(file: Path, overrides: dict[str, Any] | None = None) -> CalibrationJob:
    """Read the job of a calibration, with single keys replaced; see `read_job`."""
    return _read(CalibrationJob, file, overrides)


def _read(model: type[J], file: Path, overrides: dict[str, Any] | None) -> J:
    data = read_toml(file)
    with naming(file):
        for key, value in (overrides or {}).items():
            *tables, last = key.split(".")
            table: Any = data
            for name in tables:
                table = _inner(table, name, key)
            if isinstance(table, list):
                raise ConfigurationError(
                    f"is an array of tables; say which one: {'.'.join(tables)}.NAME.{last}", key=key
                )
            table[last] = value
            if key in EXCLUDED:
                table.pop(EXCLUDED[key], None)
        return _located(validate(model, data, file), file.parent)


def _inner(tables: Any, name: str, key: str) -> Any:
    """A table in a table; in an array of tables the one of that name, or number from 0."""
    if isinstance(tables, dict):
        return _table(tables.setdefault(name, {}), name, key)
    named = {_folded(str(entry.get("name"))): entry for entry in tables if isinstance(entry, dict)}
    if (found := named.get(_folded(name))) is None and name.isdigit() and int(name) < len(tables):
        found = tables[int(name)]
    if found is None:
        known = f"; there are: {', '.join(named)}" if named else ""
        raise ConfigurationError(f"no table of it is called {name}{known}", key=key)
    return _table(found, name, key)


def _table(found: Any, name: str, key: str) -> Any:
    if not isinstance(found, dict | list):
        raise ConfigurationError(f"{name} is no table", key=key)
    return found


def _folded(name: str) -> str:
    """A name as folders of some systems, and options, have it."""
    return name.casefold().replace("-", "_")


def _located(job: J, folder: Path) -> J:
    """Seek an arm's URDF and a recording from the job's folder, as other files that a job names."""
    if Path(job.arm.model).suffix == ".urdf":
        arm = job.arm.model_copy(update={"model": str(folder / job.arm.model)})
        job = job.model_copy(update={"arm": arm})
    if job.laser.recording is not None:
        # Absolute: the job is copied into its run directory, a recording is not.
        recording = str((folder / job.laser.recording).absolute())
        job = job.model_copy(
            update={"laser": job.laser.model_copy(update={"recording": recording})}
        )
    return job
