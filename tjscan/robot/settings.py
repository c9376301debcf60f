"""Settings of arms: clearances, tolerances of joints, simulation, and solids to keep clear of."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from tjscan.core import units
from tjscan.core.frames import Array, array_dataclass, rotation_angle_between
from tjscan.core.units import PoseSettings, SettingsTable


@dataclass(frozen=True, slots=True)
class ControllerSettings(SettingsTable):
    """Settings of every driver of a real arm: its controller's address, time limits, tolerances.

    Parameters
    ----------
    host : str
        The controller's address.
    position_tolerance, rotation_tolerance : float, optional
        Between the pose asked for and the one reached, metres and radians.
    connect_limit : float, optional
        Seconds a connection may take.
    silence_limit : float, optional
        Seconds for which the controller's clock may not advance.
    """

    host: Annotated[str, MinLen(1)]
    position_tolerance: Annotated[float, Gt(0), Le(10), units.MM] = 5e-4
    rotation_tolerance: Annotated[float, Gt(0), Le(5), units.DEG] = radians(0.1)
    connect_limit: Annotated[float, Ge(1), Le(120), units.SECONDS.with_key("connect_s")] = 15.0
    silence_limit: Annotated[float, Ge(0.1), Le(60), units.SECONDS.with_key("silence_s")] = 1.0

    def compare_with_wanted_pose(self, T: Array, T_wanted: Array) -> tuple[float, float, bool]:
        """Distance, metres, and angle, radians, between two poses; whether both are tolerated."""
        distance = float(np.linalg.norm(T[:3, 3] - T_wanted[:3, 3]))
        angle = rotation_angle_between(T, T_wanted)
        near = distance <= self.position_tolerance and angle <= self.rotation_tolerance
        return distance, angle, near


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearanceMargins(SettingsTable):
    """Margins of a path: distances from obstacles and itself, and from singularities.

    Parameters
    ----------
    solids : float
        Distance in metres of the arm and what it carries from everything around.
    own : float
        Distance in metres of the arm from itself and from what it carries.
    singular : float
        Smallest singular value, see `Kinematics.smallest_singular_value`.

    Notes
    -----
    The defaults are assumptions about a cell that was measured with a tape.
    """

    solids: Annotated[
        float, Ge(0), Le(500), units.ZeroOrAtLeast(0.05), units.MM.with_key("margin_mm")
    ] = 0.01
    own: Annotated[
        float, Ge(0), Le(500), units.ZeroOrAtLeast(0.05), units.MM.with_key("self_margin_mm")
    ] = 0.005
    singular: Annotated[float, Ge(0), Le(1), units.FileKey("smallest_singular_value")] = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementTolerance(SettingsTable):
    """Standard deviations of the placement of an arm's joints from its model.

    **The defaults are assumptions**: what a maker's calibration leaves of an arm of one metre and
    more, 0.3 to 0.5 mm RMS at the flange.

    Parameters
    ----------
    offset : float
        Of a joint's zero, radians.
    length : float
        Of the place of a joint's axis, in each direction, metres.
    twist : float
        Of the tilt of a joint's axis, each way, radians.
    """

    offset: Annotated[float, Ge(0), Le(5), units.DEG] = radians(0.007)
    length: Annotated[float, Ge(0), Le(5), units.MM] = 7.5e-5
    twist: Annotated[float, Ge(0), Le(5), units.DEG] = radians(0.007)

    @property
    def sigmas(self) -> Array:
        """Of one joint, shape (6,): along x, y, z; about x, y, z, where z is the joint's axis."""
        return np.array((*[self.length] * 3, self.twist, self.twist, self.offset))


JointAngles = Annotated[tuple[Annotated[float, Ge(-720), Le(720)], ...], units.DEG]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmErrorSettings(PlacementTolerance):
    """The table [simulation.arm.errors]: how the true arm differs from what its controller knows.

    `offset`, `length` and `twist` are what the maker's calibration leaves; with the defaults a
    UR10e is about 0.4 mm RMS off over its work space. All of it is drawn by `seed`. **The sizes
    are assumptions.**

    Parameters
    ----------
    seed : int, optional
        Which arm of the kind it is; the simulation's seed if left out.
    eccentricity : float
        Standard deviation of the amplitude of each joint's error once a turn, radians.
    backlash : float
        Angle that each joint turns back before it moves the other way, radians.
    growth : float
        Share by which the links are longer once the arm is warm.
    warm_up : float
        Seconds on the arm's clock after which it has got there but for 1/e.
    """

    seed: Annotated[int, Ge(0)] | None = None
    eccentricity: Annotated[float, Ge(0), Le(1), units.DEG] = 0.0
    backlash: Annotated[float, Ge(0), Le(1), units.DEG] = 0.0
    growth: Annotated[float, Ge(0), Le(0.01)] = 0.0
    warm_up: Annotated[float, Ge(1), Le(100_000), units.SECONDS] = 1800.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SwayMode(SettingsTable):
    """A table [[simulation.arm.sway.mode]]: one way in which what carries the arm sways.

    Parameters
    ----------
    frequency : float
        Hertz, of the damped motion but for the root of ``1 - damping**2``.
    damping : float
        Share of the critical one.
    direction : tuple of float
        Along which the base's origin moves, in b, of any length.
    pivot : tuple of float, optional
        A point in b, metres, about which the base turns as it moves, such as the beam of a
        gantry; left out, it does not turn. The origin then moves along what of `direction` is
        square to the way from this point.
    mass : float
        Effective mass of the mode at the base's origin, the arm's own included, kg.
    wind : float
        Root mean square displacement of the origin that gusts keep up, metres.
    """

    frequency: Annotated[float, Ge(0.2), Le(50), units.HERTZ_UNIT]
    damping: Annotated[float, Ge(0.001), Le(0.5)]
    direction: Annotated[tuple[float, float, float], units.NO_UNIT.with_key("direction")]
    pivot: units.Position | None = None
    mass: Annotated[float, Ge(0.1), Le(1_000_000), units.KG]
    wind: Annotated[float, Ge(0), Le(5), units.MM] = 0.0

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.twist) > 0:
            raise ValueError("direction must not be zero, nor lead to the pivot")

    @property
    def twist(self) -> Array:
        """Motion of the base when its origin moves by one metre, shape (6,).

        Translation of b's origin, metres, and rotation vector, radians; zero if there is none.
        """
        d = np.array(self.direction)
        arm = np.zeros(3) if self.pivot is None else -np.array(self.pivot)
        turn = np.cross(arm, d) / max(float(arm @ arm), 1e-12)
        moves = np.cross(turn, arm) if arm.any() else d
        length = float(np.linalg.norm(moves))
        return np.concatenate((moves, turn)) / length if length > 1e-9 else np.zeros(6)


@dataclass(frozen=True, slots=True, kw_only=True)
class SwaySettings(SettingsTable):
    """The table [simulation.arm.sway]: how what carries the simulated arm sways.

    Parameters
    ----------
    mode : tuple of SwayMode
        Its ways to sway.
    payload : float
        Mass that the flange carries, kg. The URDF states the masses of the arm's links; where it
        states none, this is all that moves.
    """

    mode: Annotated[tuple[SwayMode, ...], MinLen(1), units.LIST_OR_WORD_IN_FILE]
    payload: Annotated[float, Ge(0), Le(1000), units.KG] = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class InputShaper(SettingsTable):
    """The table [arm.shaper]: moves that leave no sway of about this frequency [1]_.

    Each move is spread over one period of the sway, in three shares whose sways cancel each
    other, also to first order of an error of the frequency (zero vibration and derivative).

    Parameters
    ----------
    frequency : float
        Of the sway, hertz.
    damping : float
        Share of the critical one.

    References
    ----------
    .. [1] Singer, Seering (1990): Preshaping command inputs to reduce system vibration. J. Dyn.
       Sys., Meas., Control 112(1). https://doi.org/10.1115/1.2894142
    """

    frequency: Annotated[float, Ge(0.5), Le(50), units.HERTZ_UNIT]
    damping: Annotated[float, Ge(0), Le(0.5)] = 0.02

    @property
    def impulses(self) -> Array:
        """Delays in seconds and shares of the move, shape (3, 2)."""
        root = np.sqrt(1 - self.damping**2)
        K = np.exp(-np.pi * self.damping / root)
        half = 0.5 / (self.frequency * root)
        return np.column_stack((half * np.arange(3), np.array((1, 2 * K, K**2)) / (1 + K) ** 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmSimulationSettings(SettingsTable):
    """The table [simulation.arm]: home position and repeatability of the simulated arm.

    Parameters
    ----------
    home : tuple of float
        Joint angles it starts with, radians.
    repeatability : float
        Root mean square of the distance between the true and the reported flange, metres.
        Assumption, after the ±0.05 mm the maker states for a UR10e.
    angular_repeatability : float
        The same of the angle, radians. Assumption: about the above over half a metre of arm.
    realtime : bool
        Whether moves take their time.
    lag : float
        Seconds by which the arm follows a path late, in a continuous scan. Assumption.
    wander : float
        Seconds over which its error correlates while it does. Assumption.
    errors : ArmErrorSettings, optional
        How the true arm differs from what its controller knows; not at all if left out.
    sway : SwaySettings, optional
        How what carries it sways; not at all if left out.
    """

    home: JointAngles
    repeatability: Annotated[float, Ge(0), Le(5), units.MM] = 5e-5
    angular_repeatability: Annotated[
        float, Ge(0), Le(5), units.DEG.with_key("repeatability_deg")
    ] = radians(0.006)
    realtime: bool = False
    lag: Annotated[float, Ge(0), Le(500), units.MILLISECONDS] = 0.05
    wander: Annotated[float, Gt(0), Le(100), units.SECONDS] = 0.5
    errors: ArmErrorSettings | None = None
    sway: SwaySettings | None = None

    def __post_init__(self) -> None:
        units.refuse_radians("home_deg", self.home, right=False)


@dataclass(frozen=True, slots=True)
class Box:
    """A box about its frame's origin.

    Parameters
    ----------
    size : tuple of float
        Lengths of its edges along x, y, z in metres.
    """

    size: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder about its frame's z axis, its middle at the origin.

    Parameters
    ----------
    radius, length : float
        Metres.
    """

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Capsule:
    """All that is within `radius` of a segment on the frame's z axis, its middle at the origin.

    Parameters
    ----------
    radius : float
        Metres.
    length : float
        Of the segment, in metres; the round ends come on top.
    """

    radius: float
    length: float


SolidShape = Box | Cylinder | Capsule


@array_dataclass
class Solid:
    """A solid body: a shape, its pose and its name.

    Parameters
    ----------
    name : str
        What a refusal calls it.
    shape : Box, Cylinder or Capsule
        What it is like.
    T : ndarray, shape (4, 4)
        Its pose: in frame b of a solid in the cell, in frame f of one that the arm carries.
    """

    name: str
    shape: SolidShape
    T: Array


_LengthMm = Annotated[float, Ge(1), Le(units.FARTHEST_DISTANCE_MM)]
_RadiusMm = Annotated[float, Ge(0.5), Le(units.FARTHEST_DISTANCE_MM)]
_SideMm = Annotated[float, Ge(0.1), Le(units.FARTHEST_DISTANCE_MM)]


@dataclass(frozen=True, slots=True, kw_only=True)
class SolidSettings(PoseSettings):
    """Settings of a simple solid; the axis of a cylinder or capsule is the z axis of its frame.

    Parameters
    ----------
    name : str
        What messages call it.
    kind : str
        Box, cylinder or capsule.
    size : tuple of float, optional
        Of a box along x, y and z, metres.
    radius, length : float, optional
        Of a cylinder or capsule, metres.
    """

    euler_zyx: units.EulerAngles = (0.0, 0.0, 0.0)
    name: Annotated[str, MinLen(1)]
    kind: Literal["box", "cylinder", "capsule"]
    size: Annotated[tuple[_SideMm, _SideMm, _SideMm] | None, units.MM] = None
    radius: Annotated[_RadiusMm | None, units.MM] = None
    length: Annotated[_LengthMm | None, units.MM] = None

    def __post_init__(self) -> None:
        PoseSettings.__post_init__(self)
        is_box = self.kind == "box"
        round_sizes = (self.radius, self.length)
        if is_box != (self.size is not None) or any(is_box != (s is None) for s in round_sizes):
            raise ValueError(
                f"a {self.kind} takes {'size_mm' if is_box else 'radius_mm and length_mm'} alone"
            )

    @property
    def solid(self) -> Solid:
        """The solid as collision checks take it, in its place."""
        if self.size is not None:
            return Solid(self.name, Box(self.size), self.T)
        shape = Cylinder if self.kind == "cylinder" else Capsule
        return Solid(self.name, shape(self.radius or 0.0, self.length or 0.0), self.T)
