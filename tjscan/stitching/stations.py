"""Stations: their sections and views, and the tubes fitted to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import radians

import numpy as np

from tjscan.core.errors import GrooveNotFound, StitchingRefused, TubesNotFound
from tjscan.core.frames import Array, frozen_arrays, rotation_angle_between, unit_vector
from tjscan.groove.section import GrooveSection
from tjscan.joint.tubes.cylinder import Cylinder, cylinder_from_normals
from tjscan.joint.tubes.fit import ArmRepeatability, FittedTubes, WallPoints, fit_tubes_to_walls
from tjscan.joint.tubes.frame import JointFrame, joint_frame_from_tubes
from tjscan.laser.profile import Profile
from tjscan.scanning.section import ProfileView, ScannedSection
from tjscan.stitching.sides import moves_of_walls, wall_points_of_views
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

    repeatability: ArmRepeatability = field(default_factory=ArmRepeatability)
    out_of_round: float = 2e-5
    most_out_of_round: float = 4e-3
    least_overlap: float = radians(10.0)
    fewest_sections: int = 2
    largest_sigma: float = 0.2e-3
    largest_reduced_chi2: float = 6.0
    least_counted: float = 0.75


DEFAULT_STITCH_SETTINGS = StitchSettings()


SIDE_W = unit_vector(np.array((4.0, 2.0, 1.0)))
"""What x of j points to, in frame w, where half a turn makes no difference: +x of w if it lies
along ±x, else +y, else +z."""

MOST_TURNED = radians(30.0)
"""By which nominal poses may disagree; at 90° nothing would show which side is which."""

FEWEST_SECTIONS = 4
"""Sections needed to start the fit of the tubes."""

SAME_POSE = 1e-9
"""Metres and shares of one, by which the poses of an arm that did not move differ."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
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
    """

    name: str
    T_w_b: Array
    sections: tuple[ScannedSection, ...]
    all_sections: tuple[ScannedSection, ...]
    causes: tuple[ViewCause, ...] = ()

    def shares_views_with(self, other: Station) -> bool:
        """Whether any view of both is one and the same: noise never comes twice alike."""
        own = {_fingerprint(section.view) for section in self.all_sections}
        return not own.isdisjoint(_fingerprint(one.view) for one in other.all_sections)


def _fingerprint(view: ProfileView) -> bytes:
    """Bytes that no other view has."""
    return view.T_b_f.tobytes() + view.profile.x_s.tobytes() + view.profile.z_s.tobytes()


def station_from_recording(
    name: str,
    T_w_b: Array,
    sections: Sequence[ScannedSection],
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
        All views; those that made no section are read again.
    read : callable
        Reads the groove in a profile.
    """
    every = list(sections)
    for view in views:
        # Views from one pose share one error of the arm: together they show no more of it.
        if any(np.abs(view.T_b_f - other.view.T_b_f).max() < SAME_POSE for other in every):
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
    walls: WallPoints
    tubes: FittedTubes
    frame: JointFrame


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
    side_w = SIDE_W
    for station in stations:
        try:
            brace, leg = _start(station)
            walls = wall_points_of_views(station.all_sections)
            shared = [
                moves_of_walls(walls, station.all_sections, cause) for cause in station.causes
            ]
            tubes = fit_tubes_to_walls(
                walls,
                settings.repeatability,
                brace,
                leg,
                np.concatenate(shared, axis=2) if shared else None,
            )
            found = joint_frame_from_tubes(tubes, station.T_w_b[:3, :3].T @ side_w)
        except TubesNotFound as error:
            raise StitchingRefused(
                "joint not found",
                f"station {station.name}, {len(station.sections)} sections: {error}",
            ) from None
        fits.append(StationTubeFit(station, walls, tubes, found))
        if len(fits) == 1:
            side_w = station.T_w_b[:3, :3] @ found.T[:3, 0]
        _check_nominal(fits[0], fits[-1])
    return fits


def _check_nominal(first: StationTubeFit, other: StationTubeFit) -> None:
    """Refuse nominal poses too far off to decide which side of the joint a station saw."""
    a, b = (one.station.T_w_b @ one.frame.T for one in (first, other))
    if (turned := rotation_angle_between(a, b)) > MOST_TURNED:
        raise StitchingRefused(
            "nominal poses disagree",
            f"by where their bases were meant to stand, stations {first.station.name} and "
            f"{other.station.name} see the joint turned by {np.degrees(turned):.0f}°, "
            f"{np.degrees(MOST_TURNED):.0f}° are allowed: which side of it each saw stays open. "
            "Put euler_zyx_deg of their [[station]] right in job.toml, and stitch again",
        )


def _start(station: Station) -> tuple[Cylinder, Cylinder]:
    """Rough brace and leg: tangents across and along the groove span the walls' planes."""
    sections = station.sections
    corners = np.array([scan.points_b[[1, 3]] for scan in sections])
    if len(corners) < FEWEST_SECTIONS:
        raise TubesNotFound(
            f"they are too few, {FEWEST_SECTIONS} at least are needed: scan further"
        )
    # A chord over two steps is parallel to the tangent half-way, also on a curve.
    along = corners[2:] - corners[:-2]
    cylinders = []
    for k, name in enumerate(("wall_s", "leg_s")):
        across = np.array([s.view.T_b_s[:3, :3] @ getattr(s.groove, name) for s in sections[1:-1]])
        normals = np.cross(along[:, k], across)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        cylinders.append(cylinder_from_normals(corners[1:-1, k], normals))
    brace, leg = cylinders
    return brace, leg


def widen_for_out_of_round(frame: JointFrame, out_of_round: float) -> JointFrame:
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
