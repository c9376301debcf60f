"""What a tow job asks for: cable, area, seam, weights, limits, and what to do when halted."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import hypot, radians
from typing import Annotated, Final

from annotated_types import Ge, Gt, Le, MaxLen, MinLen

from tjscan.core.units import DEG, FARTHEST_DISTANCE_MM, MM, SECONDS, FileUnit, SettingsTable

MM_MIN: Final = FileUnit("mm_min", 1e-3 / 60)
NEWTON_METRE_PER_RADIAN: Final = FileUnit("n_m_rad")
NEWTON_METRE_SECOND_PER_RADIAN: Final = FileUnit("n_m_s_rad")
NEWTON: Final = FileUnit("n")
NEWTON_SQUARE_METRE: Final = FileUnit("n_m2")
NEWTON_PER_METRE: Final = FileUnit("n_m")
DEG_PER_METRE: Final = FileUnit("deg_m", radians(1.0))
KG_PER_METRE: Final = FileUnit("kg_m")

MOST_CABLE_LINKS: Final = 1000

Coordinate = Annotated[float, Ge(-FARTHEST_DISTANCE_MM), Le(FARTHEST_DISTANCE_MM)]
Point = tuple[Coordinate, Coordinate]
Ring = Annotated[tuple[Point, ...], MinLen(3), MaxLen(1000)]
Path = Annotated[tuple[Point, ...], MinLen(1), MaxLen(1000)]


@dataclass(frozen=True, slots=True, kw_only=True)
class CableSettings(SettingsTable):
    """The table [cable]: the cable as a chain of links; defaults are from the paper's table I.

    Parameters
    ----------
    length, link : float
        Of the cable and of a link, metres; the length is a whole number of links.
    stiffness : float
        Of a joint between two links, N m/rad.
    damping : float
        Of a joint, N m s/rad.
    least_radius : float
        Smallest radius to which the cable may be bent, metres.
    radius : float
        Of its cross-section, metres.
    mass : float
        Of a metre, kg/m.
    friction : float
        Coefficient between cable and floor.
    """

    length: Annotated[float, Gt(0), Le(2 * FARTHEST_DISTANCE_MM), MM] = 6.0
    link: Annotated[float, Gt(0), Le(5000), MM] = 0.1
    stiffness: Annotated[float, Gt(0), Le(1e4), NEWTON_METRE_PER_RADIAN] = 1.7
    damping: Annotated[float, Ge(0), Le(1e4), NEWTON_METRE_SECOND_PER_RADIAN] = 0.15
    least_radius: Annotated[float, Gt(0), Le(FARTHEST_DISTANCE_MM), MM] = 0.1332
    radius: Annotated[float, Gt(0), Le(200), MM] = 8.5e-3
    mass: Annotated[float, Gt(0), Le(100), KG_PER_METRE] = 1.0
    friction: Annotated[float, Ge(0), Le(2)] = 0.87

    def __post_init__(self) -> None:
        count = self.length / self.link
        if abs(count - round(count)) > 1e-6 or not 2 <= round(count) <= MOST_CABLE_LINKS:
            raise ValueError(
                f"length_mm must be a whole number of links, 2 to {MOST_CABLE_LINKS}: it is "
                f"{count:g} times link_mm"
            )
        if self.link >= 2 * self.least_radius:
            raise ValueError(
                "link_mm must be shorter than twice least_radius_mm: such links can't show a bend"
            )

    @property
    def links(self) -> int:
        """Number of links."""
        return round(self.length / self.link)


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedCable(SettingsTable):
    """The table [identified], or a file of its keys: the cable as ``tjscan tow identify`` found it.

    Parameters
    ----------
    stiffness : float
        Against bending, N m²; over the length of a link, that of a joint.
    drag : float
        With which the floor holds a metre that slides, N/m.
    curvature : float
        Of a piece that nothing bends, 1/m.
    stiffness_sd, drag_sd, curvature_sd : float
        Their standard deviations.
    """

    stiffness: Annotated[float, Gt(0), Le(1e4), NEWTON_SQUARE_METRE]
    stiffness_sd: Annotated[float, Ge(0), Le(1e4), NEWTON_SQUARE_METRE]
    drag: Annotated[float, Gt(0), Le(1e4), NEWTON_PER_METRE]
    drag_sd: Annotated[float, Ge(0), Le(1e4), NEWTON_PER_METRE]
    curvature: Annotated[float, Ge(-720), Le(720), DEG_PER_METRE]
    curvature_sd: Annotated[float, Ge(0), Le(720), DEG_PER_METRE]


@dataclass(frozen=True, slots=True, kw_only=True)
class CableRootSettings(SettingsTable):
    """The table [root]: where the cable begins, for instance at the wire feeder.

    Parameters
    ----------
    position : tuple of float
        In frame w, metres.
    heading : float
        Of the cable there, from x towards y, radians.
    """

    position: Annotated[Point, MM] = (0.0, 0.0)
    heading: Annotated[float, Ge(-360), Le(360), DEG] = 0.0

    @property
    def pose(self) -> tuple[float, float, float]:
        """x, y and heading."""
        return (*self.position, self.heading)


@dataclass(frozen=True, slots=True, kw_only=True)
class AreaSettings(SettingsTable):
    """The table [area]: where vehicles and cable may be.

    Parameters
    ----------
    outline : tuple of points
        A polygon that does not cross itself, frame w, metres.
    holes : tuple of tuple of points
        Polygons inside it where nothing may be: pillars, for instance.
    """

    outline: Annotated[Ring, MM]
    holes: Annotated[tuple[Ring, ...], MaxLen(100), MM] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class SeamSettings(SettingsTable):
    """The table [seam]: where the welder goes; it has a plan of its own, and follows it alone.

    Parameters
    ----------
    points : tuple of points
        A polyline, frame w, metres; with one point the welder stays there.
    speed : float
        Of welding, m/s.
    heading : float or None
        Of the torch, and so of the cable's end, from x towards y of frame w, radians; None where
        it is the seam's direction.
    corner : float
        If the heading follows the seam, it turns over this length before and after each
        corner, metres.
    seconds : float
        For which the welder stays, if there is one point.
    """

    points: Annotated[Path, MM]
    speed: Annotated[float, Gt(0), Le(1e5), MM_MIN] = 0.01
    heading: Annotated[float | None, Ge(-360), Le(360), DEG] = None
    corner: Annotated[float, Gt(0), Le(1e4), MM] = 0.3
    seconds: Annotated[float, Gt(0), Le(1e5), SECONDS.with_key("stand_s")] = 360.0

    def __post_init__(self) -> None:
        if any(hypot(x - u, y - v) < 1e-6 for (x, y), (u, v) in pairwise(self.points)):
            raise ValueError("points_mm must not hold the same point twice in a row")
        if len(self.points) == 1 and self.heading is None:
            raise ValueError("one point has no direction: state heading_deg")


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleSettings(SettingsTable):
    """A table of [[obstacles]]: a disc that is fixed, or goes along a path and stops at its end.

    While it goes, the localisation reports where it is.

    Parameters
    ----------
    name : str
        For messages.
    points : tuple of points
        Its fixed centre, or the path of its centre, frame w, metres.
    radius : float
        Of a disc, metres.
    speed : float
        Along its path, m/s.
    start : float
        Seconds after the beginning at which it goes.
    """

    name: Annotated[str, MinLen(1)] = "obstacle"
    points: Annotated[Path, MM]
    radius: Annotated[float, Gt(0), Le(1e4), MM] = 0.2
    speed: Annotated[float, Ge(0), Le(1e6), MM_MIN] = 0.0
    start: Annotated[float, Ge(0), Le(1e6), SECONDS] = 0.0

    def __post_init__(self) -> None:
        if len(self.points) > 1 and self.speed == 0:
            raise ValueError("an obstacle with a path needs speed_mm_min")


@dataclass(frozen=True, slots=True, kw_only=True)
class WeightSettings(SettingsTable):
    """The table [weights]: of the objective's three terms, equation (5).

    Parameters
    ----------
    bending, distance, change : float
        Of bending stress, of nearness to obstacles, and of change; the paper's w_θ, w_d, w_c.
    pace : float
        Of the vehicles' steps, s/m²; the paper has none.
    pull : float
        Of the cable's force on the welder; the paper has none.
    """

    bending: Annotated[float, Gt(0), Le(1e6)] = 75.0
    distance: Annotated[float, Gt(0), Le(1e6)] = 24.0
    change: Annotated[float, Gt(0), Le(1e6)] = 1.0
    pace: Annotated[float, Ge(0), Le(1e9)] = 200.0
    pull: Annotated[float, Ge(0), Le(1e6)] = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetSettings(SettingsTable):
    """The table [targets]: the effort targets, where the loss functions turn, equation (9).

    Parameters
    ----------
    bending : float
        Angle of a joint, radians.
    distance : float
        From a link to the next obstacle, metres.
    change : float
        Of a joint's angle, radians.
    pull : float
        Of the cable on the welder, newton.
    """

    bending: Annotated[float, Gt(0), Le(180), DEG] = 0.77
    distance: Annotated[float, Gt(0), Le(1e4), MM] = 0.30
    change: Annotated[float, Gt(0), Le(180), DEG] = 0.60
    pull: Annotated[float, Gt(0), Le(1e5), NEWTON] = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitSettings(SettingsTable):
    """The table [limits]: what neither plans nor vehicles and cable break.

    Parameters
    ----------
    link_clearance : float
        Between the cable's middle line and walls, pillars and obstacles, metres.
    vehicle_clearance : float
        Between a vehicle's body and these, metres.
    vehicle_gap : float
        Between the bodies of two vehicles, metres.
    cable_gap : float
        Between middle lines where the cable comes near itself, metres.
    free_links : int
        Links at the root and at the welder that need no clearance from walls and pillars: a weld
        begins and ends at a wall.
    """

    link_clearance: Annotated[float, Ge(0), Le(1e4), MM] = 0.012
    vehicle_clearance: Annotated[float, Ge(0), Le(1e4), MM] = 0.020
    vehicle_gap: Annotated[float, Ge(0), Le(1e4), MM] = 0.050
    cable_gap: Annotated[float, Ge(0), Le(1e4), MM] = 0.040
    free_links: Annotated[int, Ge(0), Le(100)] = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalisationSettings(SettingsTable):
    """What is known of how well poses are measured, in the table [localisation].

    Parameters
    ----------
    position_sigma, heading_sigma : float
        Standard deviations, metres and radians.
    lost : float
        Seconds without a pose of a vehicle after which the weld halts.
    """

    position_sigma: Annotated[float, Gt(0), Le(1000), MM] = 0.5e-3
    heading_sigma: Annotated[float, Gt(0), Le(90), DEG] = radians(0.1)
    lost: Annotated[float, Gt(0), Le(60), SECONDS] = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowingSettings(SettingsTable):
    """The table [following]: how vehicles are led to their poses, and for how long a weld waits.

    Parameters
    ----------
    proportional, integral, derivative : float
        Gains of the PID controller, 1/s, 1/s² and 1.
    patience : float
        Seconds for which the welder waits where it was halted, before the tow is given up.
    """

    proportional: Annotated[float, Gt(0), Le(100)] = 2.0
    integral: Annotated[float, Ge(0), Le(100)] = 0.2
    derivative: Annotated[float, Ge(0), Le(10)] = 0.0
    patience: Annotated[float, Ge(0), Le(1e5), SECONDS] = 30.0
