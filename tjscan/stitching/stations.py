"""Stations: their sections, the tubes fitted to them, and where two saw the same groove."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import pi, radians
from typing import Final

import numpy as np

from tjscan.core import frames
from tjscan.core.errors import GrooveNotFound, StitchingRefused, TubesNotFound
from tjscan.groove.section import GrooveSection
from tjscan.joint.tubes import fit as tube_fit
from tjscan.joint.tubes.cylinder import Cylinder, cylinder_from_normals
from tjscan.laser.profile import Profile
from tjscan.scanning.section import ProfileView, ScannedSection, Sections, Substep
from tjscan.stitching.unrolled_views import moves_of_wall_points, wall_points_of_views
from tjscan.uncertainty.causes import ViewCause


@dataclass(frozen=True, slots=True)
class StitchSettings:
    """How stations are stitched. The defaults of the first two are assumptions.

    Parameters
    ----------
    repeatability : ArmRepeatability
        How exactly the arm reports where it is; it weighs views against points.
    out_of_round : float
        How far a tube's wall may bulge from a circle, metres: what each station finds of the
        joint's frame is taken to be no surer than that.
    most_out_of_round : float
        How far it may be found to, if the tubes as stations found them disagree with their
        overlaps.
    least_overlap : float
        Azimuth that two stations must share, radians.
    fewest_sections : int
        Sections that each of them must have there.
    largest_sigma : float
        How uncertain an overlap may leave its place, metres.
    largest_reduced_chi2 : float
        Chi-squared per degree of freedom that the overlap's residuals may have.
    least_counted : float
        Share of the overlap's views to which the robust kernel must give weight.
    """

    repeatability: tube_fit.ArmRepeatability = field(default_factory=tube_fit.ArmRepeatability)
    out_of_round: float = 2e-5
    most_out_of_round: float = 4e-3
    least_overlap: float = radians(10.0)
    fewest_sections: int = 2
    largest_sigma: float = 0.2e-3
    largest_reduced_chi2: float = 6.0
    least_counted: float = 0.75


DEFAULT_STITCH_SETTINGS = StitchSettings()


FRAME_J_X_DIRECTION_W = frames.unit_vector(np.array((4.0, 2.0, 1.0)))
"""What x of j points to, in frame w, where half a turn makes no difference: +x of w if it lies
along ±x, else +y, else +z."""

LARGEST_POSE_DISAGREEMENT = radians(30.0)
"""By which nominal poses may disagree; at 90° nothing would show which side is which."""

FEWEST_STATION_SECTIONS = 4
"""Sections needed to start the fit of the tubes."""

SAME_FLANGE_POSE_TOLERANCE = 1e-9
"""Metres and shares of one, by which the poses of an arm that did not move differ."""


@frames.array_dataclass
class Station:
    """Sections that were scanned from one station, and where the arm's base nominally was.

    Parameters
    ----------
    name : str
        Unlike any other's.
    T_w_b : ndarray, shape (4, 4)
        Where the arm's base was meant to be; good to some millimetres and degrees.
    sections : tuple of ScannedSection
        The finished sections in the order in which they were scanned.
    all_sections : tuple of ScannedSection
        One for each view in which a groove was read, the finished ones first: every view has
        an error of its own.
    causes : tuple of ViewCause
        What errs alike in all of these views. Causes of one name are one and the same cause in
        all stations that have it.
    carrier_sigma : tuple of float, optional
        Where a carrier went from station to station, the standard deviations of where it stopped,
        all directions together, metres and radians; `T_w_b` is what it says then.
    """

    name: str
    T_w_b: frames.Array
    sections: tuple[ScannedSection, ...]
    all_sections: tuple[ScannedSection, ...]
    causes: tuple[ViewCause, ...] = ()
    carrier_sigma: tuple[float, float] | None = None

    def shares_views_with(self, other: Station) -> bool:
        """Whether any view of both is one and the same: noise never comes twice alike."""
        own = {_view_fingerprint(section.view) for section in self.all_sections}
        return not own.isdisjoint(_view_fingerprint(one.view) for one in other.all_sections)


def _view_fingerprint(view: ProfileView) -> bytes:
    """Bytes that no other view has."""
    return view.T_b_f.tobytes() + view.profile.x_s.tobytes() + view.profile.z_s.tobytes()


def station_from_recording(
    name: str,
    T_w_b: frames.Array,
    sections: Sections,
    views: Sequence[ProfileView],
    read: Callable[[Profile], GrooveSection],
) -> Station:
    """Make a station from a scan's recording.

    Parameters
    ----------
    name : str
        Unlike any other's.
    T_w_b : ndarray, shape (4, 4)
        Where the arm's base was meant to be.
    sections : sequence of ScannedSection
        Finished sections in the order of the scan.
    views : sequence of ProfileView
        All views; those that made no section are read again, but for those taken in passing,
        of which sections were made together.
    read : callable
        Reads the groove in a profile.
    """
    every = list(sections)
    for view in views:
        if view.substep is Substep.PASSING:
            continue
        # Views from one pose share one error of the arm: together they show no more of it.
        if any(
            np.abs(view.T_b_f - other.view.T_b_f).max() < SAME_FLANGE_POSE_TOLERANCE
            for other in every
        ):
            continue
        try:
            every.append(ScannedSection(view, read(view.profile), np.eye(4)))
        except GrooveNotFound:  # so did the scan, which went on with another view
            continue
    return Station(name, T_w_b, tuple(sections), tuple(every))


@dataclass(frozen=True, slots=True, eq=False)
class StationTubeFit:
    """Brace and leg, and frame j, as fitted to what one station saw.

    Parameters
    ----------
    station : Station
        Which one.
    walls : WallPoints
        What it saw of the tubes' walls, in its base frame.
    tubes : FittedTubes
        Leg and brace, in its base frame.
    frame : JointFrame
        Frame j in its base frame.
    """

    station: Station
    walls: tube_fit.WallPoints
    tubes: tube_fit.FittedTubes
    frame: tube_fit.JointFrame


TubeFits = Sequence[StationTubeFit]


def fit_tubes_to_stations(
    stations: Sequence[Station], settings: StitchSettings
) -> list[StationTubeFit]:
    """Fit the tubes to what every station saw, x of all frames j to the same side.

    Parameters
    ----------
    stations : sequence of Station
        The first decides on the side.
    settings : StitchSettings
        Gives the arms' repeatability.

    Raises
    ------
    StitchingRefused
        If one does not see enough of the tubes.
    """
    fits: list[StationTubeFit] = []
    side_w = FRAME_J_X_DIRECTION_W
    for station in stations:
        try:
            brace, leg = _initial_tubes(station)
            sections = station.all_sections
            walls = wall_points_of_views(sections)
            shared = [moves_of_wall_points(walls, sections, cause) for cause in station.causes]
            moves = np.concatenate(shared, axis=2) if shared else None
            tubes = tube_fit.fit_tubes_to_walls(walls, settings.repeatability, brace, leg, moves)
            found = tube_fit.joint_frame_from_tubes(tubes, station.T_w_b[:3, :3].T @ side_w)
        except TubesNotFound as error:
            raise StitchingRefused(
                "joint not found",
                f"station {station.name}, {len(station.sections)} sections: {error}",
            ) from None
        fits.append(StationTubeFit(station, walls, tubes, found))
        if len(fits) == 1:
            side_w = station.T_w_b[:3, :3] @ found.T[:3, 0]
        _check_nominal_poses_agree(fits[0], fits[-1])
    return fits


def _check_nominal_poses_agree(first: StationTubeFit, other: StationTubeFit) -> None:
    """Refuse nominal poses too far off to decide which side of the joint a station saw."""
    a, b = (one.station.T_w_b @ one.frame.T for one in (first, other))
    if (turned := frames.rotation_angle_between(a, b)) > LARGEST_POSE_DISAGREEMENT:
        raise StitchingRefused(
            "nominal poses disagree",
            f"by the nominal places of their bases, stations {first.station.name} and "
            f"{other.station.name} see the joint turned by {np.degrees(turned):.0f}°, "
            f"{np.degrees(LARGEST_POSE_DISAGREEMENT):.0f}° are allowed: which side of it each saw "
            "stays open. Put euler_zyx_deg of their [[station]] right in job.toml, and stitch "
            "again",
        )


def _initial_tubes(station: Station) -> tuple[Cylinder, Cylinder]:
    """Rough brace and leg: tangents across and along the groove span the walls' planes."""
    sections = station.sections
    corners = np.array([scan.points_b[[1, 3]] for scan in sections])
    if len(corners) < FEWEST_STATION_SECTIONS:
        message = f"they are too few, {FEWEST_STATION_SECTIONS} at least are needed: scan further"
        raise TubesNotFound(message)
    # A chord over two steps is parallel to the tangent half-way, also on a curve.
    along = corners[2:] - corners[:-2]
    cylinders = []
    for k, name in enumerate(("wall_s", "leg_s")):
        across = np.array([s.view.T_b_s[:3, :3] @ getattr(s.groove, name) for s in sections[1:-1]])
        normals = frames.unit_vectors(np.cross(along[:, k], across))
        cylinders.append(cylinder_from_normals(corners[1:-1, k], normals))
    return cylinders[0], cylinders[1]


def widen_frame_for_out_of_round(
    frame: tube_fit.JointFrame, out_of_round: float
) -> tube_fit.JointFrame:
    """Widen a joint frame's covariance for tubes that are out of round.

    Parameters
    ----------
    frame : JointFrame
        As fitted to cylinders.
    out_of_round : float
        How far the tubes' walls may bulge from circles, metres.
    """
    radius = frame.shape.brace_radius
    allowance = np.repeat((out_of_round, out_of_round / radius, out_of_round), (3, 3, 4))
    allowance[8] = out_of_round / radius  # the angle between the axes
    return replace(frame, covariance=frame.covariance + np.diag(allowance**2))


FULL_TURN_ANGLE: Final = 2 * pi

STATION_GAP_IN_STEPS: Final = 1.6
"""Usual steps between neighbouring sections beyond which it is a gap between stations."""


@dataclass(frozen=True, slots=True)
class AzimuthArc:
    """An arc of azimuths, from start to end.

    Parameters
    ----------
    start, end : float
        Radians; the end is beyond the start.
    """

    start: float
    end: float

    @property
    def span_angle(self) -> float:
        """Angle of the arc from start to end, radians."""
        return self.end - self.start

    @property
    def middle_azimuth(self) -> float:
        """Azimuth of the arc's middle, radians, -pi to pi."""
        return float(np.angle(np.exp(0.5j * (self.start + self.end))))

    def offset_from_middle(self, azimuth: frames.Array) -> frames.Array:
        """Angles of azimuths from the arc's middle, -pi to pi."""
        return np.asarray(np.angle(np.exp(1j * (azimuth - 0.5 * (self.start + self.end)))))

    def contains(self, azimuth: frames.Array) -> frames.Array:
        """Whether azimuths lie within the arc."""
        return np.asarray(np.abs(self.offset_from_middle(azimuth)) <= 0.5 * self.span_angle + 1e-9)


@dataclass(frozen=True, slots=True)
class StationOverlap:
    """Two stations and the arc of azimuths that both saw.

    Parameters
    ----------
    first, second : int
        Which stations.
    arc : AzimuthArc
        The azimuth that both saw.
    sections : tuple of (int, int)
        How many sections each has there.
    """

    first: int
    second: int
    arc: AzimuthArc
    sections: tuple[int, int]


def section_azimuths(fit: StationTubeFit) -> frames.Array:
    """Azimuths of a station's sections in their order, without jumps, shape (n,)."""
    T_j_b = frames.inverse_pose(fit.frame.T)
    middle = np.array([scan.points_b[2:4].mean(axis=0) for scan in fit.station.sections])
    x, y, _ = frames.transform_points(T_j_b, middle).T
    return np.unwrap(np.arctan2(y, x))


def arc_of_azimuths(azimuths: frames.Array) -> AzimuthArc:
    """Arc that a station's section azimuths reach over."""
    return AzimuthArc(float(azimuths.min()), float(azimuths.max()))


def find_overlaps(azimuths: Sequence[frames.Array]) -> list[StationOverlap]:
    """Find every arc that two stations share, however short; two stations may share two.

    Parameters
    ----------
    azimuths : sequence of ndarray
        Of each station's sections.
    """
    overlaps = []
    for a, b in combinations(range(len(azimuths)), 2):
        one, other = arc_of_azimuths(azimuths[a]), arc_of_azimuths(azimuths[b])
        for turn in range(-3, 4):
            shift = turn * FULL_TURN_ANGLE
            start, end = max(one.start, other.start + shift), min(one.end, other.end + shift)
            shared = AzimuthArc(start, end)
            if shared.span_angle > 0:
                first, second = (int(shared.contains(azimuths[k]).sum()) for k in (a, b))
                overlaps.append(StationOverlap(a, b, shared, (first, second)))
    return overlaps


def azimuth_coverage(azimuths: Sequence[frames.Array]) -> tuple[float, list[AzimuthArc]]:
    """How much of the full turn stations cover, in radians, and the gaps.

    Neighbouring sections further apart than `STATION_GAP_IN_STEPS` usual steps have a gap
    between them.
    """
    around = np.sort(np.concatenate(azimuths) % FULL_TURN_ANGLE)
    steps = np.diff(np.append(around, around[0] + FULL_TURN_ANGLE))
    usual = float(np.median(np.concatenate([np.abs(np.diff(a)) for a in azimuths])))
    gaps = [AzimuthArc(float(around[k]), float(around[k] + steps[k])) for k in range(len(around))]
    gaps = [gap for gap in gaps if gap.span_angle > STATION_GAP_IN_STEPS * usual]
    return FULL_TURN_ANGLE - sum(gap.span_angle for gap in gaps), gaps
