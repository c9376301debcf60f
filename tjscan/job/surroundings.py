"""What is about the arm: solids, board, ball, joint and stations; and where they truly are.

The tables of a cell's job and of a simulation's true world.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import date
from math import radians
from typing import Annotated, Final, Literal

from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from pydantic import Field

from tjscan.calibration.noise import NoiseModel
from tjscan.core import units
from tjscan.core.config import StrictFileModel
from tjscan.core.frames import Array, pose_from_euler_zyx
from tjscan.laser.model import LaserModel
from tjscan.robot import settings as arm_settings
from tjscan.robot.settings import SolidSettings
from tjscan.scanning.target import ScanDirection

MOST_SOLIDS_OF_CELL: Final = MaxLen(300)
"""Of a cell: each is checked against every link of the arm, at every step of a path."""

SMALLEST_BOARD_SIZE: Final = 0.1
"""Metres."""

LengthMm = Annotated[float, Gt(0), Le(units.FARTHEST_DISTANCE_MM)]
"""In the unit of the file; a unit after it converts it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedSolidSettings(SolidSettings):
    """A solid with its pose in the base frame, b, or in the workpiece's, w."""

    frame: Literal["b", "w"] = "b"


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearanceSettings(arm_settings.ClearanceMargins):
    """The table [clearance]: what the arm keeps clear of, and how far.

    Parameters
    ----------
    self_collision : bool
        Whether the arm is kept clear of itself.
    lifts : tuple of float
        How far detours draw the sensor back, one after the other, metres.
    ignore : tuple of (str, str)
        Pairs of links that may come near each other.
    solid : tuple of PlacedSolidSettings
        Solids in frame b or w.
    tool : tuple of SolidSettings
        Solids on the flange, frame f.
    """

    self_collision: bool = True
    lifts: Annotated[tuple[LengthMm, ...], MaxLen(20), units.MM] = (0.05, 0.1, 0.2, 0.3)
    ignore: Annotated[
        tuple[Annotated[tuple[str, str], units.LIST_OR_WORD_IN_FILE], ...],
        units.LIST_OR_WORD_IN_FILE,
    ] = ()
    solid: Annotated[
        tuple[PlacedSolidSettings, ...], MOST_SOLIDS_OF_CELL, units.LIST_OR_WORD_IN_FILE
    ] = ()
    tool: Annotated[tuple[SolidSettings, ...], MOST_SOLIDS_OF_CELL, units.LIST_OR_WORD_IN_FILE] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardSettings(units.PoseSettings):
    """The table [board]: the flat board to calibrate on, about where it is, and what to take.

    The frame's origin is the middle of the board's face, x along the first side, z away from it.

    Parameters
    ----------
    size : tuple of float
        Of both sides, metres.
    probe_tip : tuple of float
        The tip that touches it, in frame f, metres.
    approach : float
        Height from which the tip comes down, metres.
    touches, lines : int
        How many points are touched, and how many profiles are taken.
    noise : NoiseModel
        What measurements are assumed to err by.
    """

    size: Annotated[tuple[float, float], units.MM]
    probe_tip: units.Position
    approach: Annotated[float, Gt(0), Le(500), units.MM] = 0.03
    touches: Annotated[int, Ge(3), Le(100)] = 9
    lines: Annotated[int, Ge(5), Le(100)] = 12
    noise: NoiseModel = field(default_factory=NoiseModel)

    def __post_init__(self) -> None:
        units.PoseSettings.__post_init__(self)
        if min(self.size) < SMALLEST_BOARD_SIZE:
            raise ValueError(f"size_mm: a board is {1e3 * SMALLEST_BOARD_SIZE:g} mm wide or wider")


@dataclass(frozen=True, slots=True, kw_only=True)
class BallSettings(units.SettingsTable):
    """The table [ball]: the ball to calibrate the arm on, about where it is, and what to take.

    Parameters
    ----------
    position : tuple of float
        About where its centre is, frame b, metres.
    radius : float
        About its radius, metres; it is found too.
    poses, held_out : int
        From how many postures the arm is calibrated, and from how many it is checked.
    tolerance : PlacementTolerance
        What the arm's maker leaves of deviations.
    noise : NoiseModel
        What profiles and poses err by; of poses, what the arm does not repeat: an assumption,
        after the ±0.05 mm the maker states for a UR10e.
    """

    position: units.Position
    radius: Annotated[float, Ge(10), Le(200), units.MM]
    poses: Annotated[int, Ge(20), Le(500)] = 44
    held_out: Annotated[int, Ge(5), Le(200)] = 12
    tolerance: arm_settings.PlacementTolerance = field(
        default_factory=arm_settings.PlacementTolerance
    )
    noise: NoiseModel = field(
        default_factory=lambda: NoiseModel(position=3e-5, rotation=radians(0.004))
    )


Certified = Annotated[float, Gt(0), Le(units.FARTHEST_DISTANCE_MM), units.MM]
"""A certified length, metres."""

Expanded = Annotated[float, Gt(0), Le(10), units.MM]
"""Its expanded uncertainty, metres."""

Day = Annotated[date, Field(strict=False)]
"""A date, such as 2026-01-12."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArtefactSettings(units.SettingsTable):
    """The table [artefact]: the certificate of the ball in [ball], or of a bar with a second one.

    Parameters
    ----------
    kind : str
        ``ball`` or ``ball bar``.
    certificate, laboratory : str
        Number of the certificate, and who issued it, or the instrument that measured it.
    date, valid_until : datetime.date
        When it was issued, and the last day on which it holds.
    radius, radius_expanded : float
        Of the ball, of both of a bar, and its expanded uncertainty, metres.
    second : tuple of float, optional
        About where the centre of a bar's second ball is, frame b, metres.
    distance, distance_expanded : float, optional
        Between a bar's centres, and its expanded uncertainty, metres.
    fixed : bool
        Whether it stays in its place: earlier acceptances then saw it there, too.
    """

    kind: Literal["ball", "ball bar"] = "ball"
    certificate: Annotated[str, MinLen(1)]
    laboratory: Annotated[str, MinLen(1)]
    date: Day
    valid_until: Day
    radius: Certified
    radius_expanded: Expanded
    second: units.Position | None = None
    distance: Certified | None = None
    distance_expanded: Expanded | None = None
    fixed: bool = False

    def __post_init__(self) -> None:
        given = [self.second, self.distance, self.distance_expanded]
        if (self.kind == "ball bar") != all(one is not None for one in given) or (
            self.kind == "ball" and any(one is not None for one in given)
        ):
            raise ValueError(
                'second_mm, distance_mm and distance_expanded_mm belong to kind = "ball bar", '
                "which needs all three"
            )
        if self.valid_until < self.date:
            raise ValueError("valid_until is before date")


@dataclass(frozen=True, slots=True, kw_only=True)
class AcceptanceSettings(units.SettingsTable):
    """The table [accept]: how often an acceptance looks, and limits that nothing else states.

    Parameters
    ----------
    returns : int
        To one pose, for its repeatability; ISO 9283 has 30.
    postures : int
        From which the calibration is checked.
    stopping : float, optional
        Longest stopping distance of the flange from the job's speed, metres; if left out, what its
        acceleration in [arm] allows after a tenth of a second.
    clock_drift : float
        Largest drift of the laser's clock against the arm's, as a share: quartz is good to 100 ppm.
    """

    returns: Annotated[int, Ge(10), Le(1000)] = 30
    postures: Annotated[int, Ge(10), Le(500)] = 24
    stopping: Annotated[float | None, Gt(0), Le(5000), units.MM] = None
    clock_drift: Annotated[float, Gt(0), Le(1000), units.PPM_UNIT] = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSettings(units.PoseSettings):
    """The table [joint]: the joint as designed, for comparisons and for the simulated world.

    Its pose is in frame w, which is b for a job without stations. The scanner itself never
    looks at it.

    Parameters
    ----------
    file : str
        The file that describes it, sought from the job's folder.
    """

    file: str

    @property
    def T_w_j(self) -> Array:
        """Pose of the joint in frame w, shape (4, 4), metres."""
        return self.T


StationName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]
"""Name of a station, and of its folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StationSettings(units.SettingsTable):
    """The table [[station]]: about where the arm's base is in frame w, and its start poses.

    Parameters
    ----------
    name : str
        Name of the station, and of its folder.
    position, euler_zyx : tuple of float, optional
        Pose of the arm's base in frame w, metres and radians; required without a carrier.
    carrier : tuple of float, optional
        Values of the carrier's axes in their order, millimetres and degrees; instead of the pose.
    overlap : float
        With a carrier, how much of what the station before scanned is scanned again if no start
        poses are stated, metres.
    posture : tuple of float, optional
        With a carrier, joint angles near which the arm takes the first start pose, radians; those
        nearest to where it is if left out.
    direction : ScanDirection, optional
        As in [scan], which holds if this is left out.
    length : float, optional
        As in [scan], metres.
    sections : int, optional
        As in [scan].
    first, second : PoseSettings, optional
        The taught poses of the flange, in this station's frame b; required without a carrier, and
        at its first station.
    """

    name: StationName
    position: units.Position | None = None
    euler_zyx: units.EulerAngles | None = None
    carrier: Annotated[tuple[float, ...] | None, units.LIST_OR_WORD_IN_FILE] = None
    overlap: Annotated[float, Ge(20), Le(2000), units.MM] = 0.12
    posture: arm_settings.JointAngles | None = None
    direction: Annotated[ScanDirection, units.LIST_OR_WORD_IN_FILE] | None = None
    length: Annotated[float | None, Ge(5), units.MM] = None
    sections: Annotated[int | None, Ge(3)] = None
    first: units.PoseSettings | None = None
    second: units.PoseSettings | None = None

    def __post_init__(self) -> None:
        if self.carrier is None:
            for key, given in (("position_mm", self.position), ("euler_zyx_deg", self.euler_zyx)):
                if given is None:
                    raise ValueError(f"{key}: this key is required")
        elif self.position is not None or self.euler_zyx is not None:
            raise ValueError("carrier: gives the pose: leave out position_mm and euler_zyx_deg")
        units.refuse_radians("euler_zyx_deg", self.euler_zyx or (0.0, 0.0, 0.0), right=True)
        units.refuse_radians("posture_deg", self.posture or (), right=False)

    @property
    def T(self) -> Array:
        """The pose as stated, shape (4, 4), metres."""
        origin = (0.0, 0.0, 0.0)
        return pose_from_euler_zyx(self.position or origin, self.euler_zyx or origin)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedBoardSettings(units.PoseSettings):
    """The table [simulation.board]: the true pose of the board, and how well it is touched.

    Parameters
    ----------
    touch : float
        Standard deviation of a touched point in each axis, metres.
    """

    touch: Annotated[float, Ge(0), Le(5), units.MM] = 5e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedBallSettings(units.SettingsTable):
    """The table [simulation.ball]: where the ball truly is, frame b, and its radius, metres."""

    position: units.Position
    radius: Annotated[float, Ge(10), Le(200), units.MM]


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedStationSettings(units.PoseSettings):
    """The table [[simulation.station]]: the true pose of a station's base in frame w.

    Parameters
    ----------
    name : str
        Name of the station.
    home : tuple of float, optional
        Joint angles the arm starts with there, radians; those in [simulation.arm] if left out.
    """

    name: StationName
    home: arm_settings.JointAngles | None = None


class SimulationSettings(StrictFileModel):
    """The table [simulation]: the simulated world.

    `T_f_s_mm` is where the laser truly sits, `board` and `ball` where these truly are, `station`
    where stations truly are; if left out, they are as the job states them.
    """

    seed: int = Field(default=1, ge=0)
    T_f_s_mm: units.PoseRows | None = None
    board: SimulatedBoardSettings | None = None
    ball: SimulatedBallSettings | None = None
    station: Annotated[tuple[SimulatedStationSettings, ...], units.LIST_OR_WORD_IN_FILE] = ()
    arm: arm_settings.ArmSimulationSettings | None = None
    laser: LaserModel = LaserModel()

    def with_seeds_of_devices(self) -> SimulationSettings:
        """Return the same with the seeds stated that draw which arm and which laser it is."""
        arm, laser = self.arm, self.laser
        if arm is not None and arm.errors is not None and arm.errors.seed is None:
            arm = replace(arm, errors=replace(arm.errors, seed=self.seed))
        if laser.linearity_seed is None:
            laser = replace(laser, linearity_seed=self.seed)
        return self.model_copy(update={"arm": arm, "laser": laser})
