"""Settings of arms: clearances of their paths, tolerances of their joints, their simulation."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le

from tjscan.core.units import DEG, MM, SECONDS, FileKey, SettingsTable

if TYPE_CHECKING:
    from tjscan.core.frames import Array


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

    solids: Annotated[float, Ge(0), Le(500), MM.with_key("margin_mm")] = 0.01
    own: Annotated[float, Ge(0), Le(500), MM.with_key("self_margin_mm")] = 0.005
    singular: Annotated[float, Ge(0), Le(1), FileKey("smallest_singular_value")] = 0.02


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

    offset: Annotated[float, Ge(0), Le(5), DEG] = radians(0.007)
    length: Annotated[float, Ge(0), Le(5), MM] = 7.5e-5
    twist: Annotated[float, Ge(0), Le(5), DEG] = radians(0.007)

    @property
    def sigmas(self) -> Array:
        """Of one joint, shape (6,): along x, y, z; about x, y, z, where z is the joint's axis."""
        import numpy as np

        return np.array((*[self.length] * 3, self.twist, self.twist, self.offset))


JointAngles = Annotated[tuple[Annotated[float, Ge(-720), Le(720)], ...], DEG]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmErrorSettings(PlacementTolerance):
    """The table [simulation.arm.errors]: how the true arm differs from what its controller knows.

    `offset`, `length` and `twist` are what the maker's calibration leaves; with the defaults a
    UR10e is about 0.4 mm RMS off over its work space. All of it is drawn by `seed`. **The sizes
    are assumptions.**

    Parameters
    ----------
    seed : int, optional
        Which arm of the kind it is; the simulation's seed where left out.
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
    eccentricity: Annotated[float, Ge(0), Le(1), DEG] = 0.0
    backlash: Annotated[float, Ge(0), Le(1), DEG] = 0.0
    growth: Annotated[float, Ge(0), Le(0.01)] = 0.0
    warm_up: Annotated[float, Ge(1), Le(100_000), SECONDS] = 1800.0


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
    errors : ArmErrorSettings, optional
        How the true arm differs from what its controller knows; not at all where left out.
    """

    home: JointAngles
    repeatability: Annotated[float, Ge(0), Le(5), MM] = 5e-5
    angular_repeatability: Annotated[float, Ge(0), Le(5), DEG.with_key("repeatability_deg")] = (
        radians(0.006)
    )
    realtime: bool = False
    errors: ArmErrorSettings | None = None
