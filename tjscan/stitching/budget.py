"""The uncertainty of stitched sections: what stations share, and how sure their places are.

Stitching finds the joint in the same data that err. What looks like another place of the joint
from all of a station's views is taken up by that station's place, and does no harm; what looks
like other tubes, or moves stations apart, is left. Both follow from how the fits answer to a
motion of every view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tjscan.core.frames import Array, inverse_pose, transform_points
from tjscan.joint.tubes.fit import ArmRepeatability
from tjscan.stitching.graph import StationErrorDraws, StationPoses
from tjscan.stitching.registration import Registrations
from tjscan.stitching.stations import StationTubeFit, TubeFits
from tjscan.stitching.unrolled_views import NODES_PER_SIDE, moves_of_wall_points
from tjscan.uncertainty.budget import (
    CORNER_POINTS,
    BudgetComponent,
    UncertaintyBudget,
    covariance_factor,
    points_moved_by_twist,
)
from tjscan.uncertainty.causes import ViewCause, reading_cause, repeatability_cause

STATION_PLACES_CAUSE: Final = "stations' places"


class SharedCauses:
    """Causes that stations share, and how what is fitted to their views errs with them.

    Parameters
    ----------
    fits : sequence of StationTubeFit
        Of k stations.
    registrations : sequence of StationRegistration
        Of all overlaps.

    Attributes
    ----------
    of_station : list of tuple of (ViewCause or None)
        Each cause as each station has it; None if it has not.
    errors : list of StationErrors
        Of tube fits and overlaps, by each cause.
    """

    def __init__(self, fits: TubeFits, registrations: Registrations) -> None:
        names = dict.fromkeys(cause.name for fit in fits for cause in fit.station.causes)
        by_station = [{cause.name: cause for cause in fit.station.causes} for fit in fits]
        self.of_station = [tuple(causes.get(name) for causes in by_station) for name in names]
        self.errors = [_station_errors(one, fits, registrations) for one in self.of_station]

    @property
    def all_errors(self) -> StationErrorDraws | None:
        """Errors by all draws of all causes; None if stations share nothing."""
        if not self.errors:
            return None
        return StationErrorDraws(
            np.concatenate([one.frames for one in self.errors], axis=2),
            np.concatenate([one.overlaps for one in self.errors], axis=2),
        )


def _station_errors(
    causes: Sequence[ViewCause | None], fits: TubeFits, registrations: Registrations
) -> StationErrorDraws:
    """Errors of all that is fitted, by one cause."""
    m = next(cause.twists.shape[-1] for cause in causes if cause is not None)
    frames, moves = np.zeros((len(fits), 10, m)), []
    for i, (fit, cause) in enumerate(zip(fits, causes, strict=True)):
        walls = np.zeros((len(fit.walls), 3, m))
        corners = np.zeros((len(fit.station.all_sections), 3, 3, m))
        if cause is not None:
            walls = moves_of_wall_points(fit.walls, fit.station.all_sections, cause)
            corners = cause.points[:, CORNER_POINTS]
        frames[i] = np.einsum("nik,nkm->im", fit.frame.by_points, walls)
        # Seen in the station's own j, which moves with what the station saw.
        T = inverse_pose(fit.frame.T)
        at = [section.points_b[CORNER_POINTS] for section in fit.station.all_sections]
        places = transform_points(T, _points_by_view(fit, np.array(at), fit.walls.points))
        in_j = np.einsum("ij,vkjm->vkim", T[:3, :3], _points_by_view(fit, corners, walls))
        moves.append(in_j - points_moved_by_twist(places, frames[i, :6]))
    overlaps = np.zeros((len(registrations), 6, m))
    for i, edge in enumerate(registrations):
        for is_second, k in enumerate((edge.overlap.first, edge.overlap.second)):
            by_points = edge.by_points[edge.of_second == is_second]
            if is_second:  # both are compared in the frame of the first
                by_points = by_points @ edge.T[:3, :3]
            numbers = edge.number[edge.of_second == is_second]
            overlaps[i] += np.einsum("nikc,nkcm->im", by_points, moves[k][numbers])
    return StationErrorDraws(frames, overlaps)


def _points_by_view(fit: StationTubeFit, corners: Array, walls: Array) -> Array:
    """What a registration's views are made of, shape (n, 3 + k, ...): corners, then wall points.

    Views that lack a wall, and take no part, have zeros there.
    """
    nodes = np.zeros((len(corners), 2 * NODES_PER_SIDE, *corners.shape[2:]))
    for chosen in fit.walls.indices_by_view():
        if len(chosen) == 2 * NODES_PER_SIDE:
            nodes[fit.walls.view[chosen[0]]] = walls[chosen]
    return np.concatenate((corners, nodes), axis=1)


def stitching_budget(
    fits: TubeFits,
    registrations: Registrations,
    placement: StationPoses,
    shared: SharedCauses,
    repeatability: ArmRepeatability,
) -> tuple[UncertaintyBudget, Array, Array]:
    """Budget of the sections of placed stations, before these are fused.

    Parameters
    ----------
    fits : sequence of StationTubeFit
        Of k stations.
    registrations : sequence of StationRegistration
        Of all overlaps.
    placement : StationPoses
        Where the stations are.
    shared : SharedCauses
        What stations share.
    repeatability : ArmRepeatability
        Of their arms.

    Returns
    -------
    sections : UncertaintyBudget
        Of the sections of all stations, one station after the other, in the common j.
    station_covariances : ndarray, shape (k, 6, 6)
        Of the stations' places: translation and rotation vector in j, about its origin.
    shape_covariance : ndarray, shape (4, 4)
        Of the tubes' dimensions.
    """
    T_j_b = [T @ inverse_pose(fit.frame.T) for T, fit in zip(placement.T, fits, strict=True)]
    scans = [fit.station.sections for fit in fits]
    readings = [reading_cause(sections) for sections in scans]
    moves = [repeatability_cause(sections, repeatability, "assumed") for sections in scans]
    k, noise = len(fits), placement.noise_covariance
    places = np.split(covariance_factor(noise[: 6 * k, : 6 * k]), k)
    placed = zip(fits, T_j_b, places, strict=True)
    components = [
        *(_component_in_frame_j(causes, T_j_b) for causes in (readings, moves)),
        _join_components([_section_moves_by_twists(fit, T, L) for fit, T, L in placed]),
    ]
    stations, shape = placement.covariance, np.array(noise[6 * k :, 6 * k :])
    for causes, errors in zip(shared.of_station, shared.errors, strict=True):
        found = placement.by_residuals @ errors.residuals(registrations)
        shape += found[6 * k :] @ found[6 * k :].T
        parts = []
        for i, (fit, T, cause) in enumerate(zip(fits, T_j_b, causes, strict=True)):
            place = found[6 * i : 6 * i + 6]
            stations[i] += place @ place.T
            part = _section_moves_by_twists(fit, T, place)
            if cause is not None:
                own = cause.component(T[:3, :3], len(fit.station.sections))
                points, measures = own.points + part.points, own.measures + part.measures
                part = replace(own, points=points, measures=measures)
            parts.append(part)
        components.append(_join_components(parts).with_fewest_draws())
    return UncertaintyBudget(tuple(components)), stations, shape


def _component_in_frame_j(causes: Sequence[ViewCause], T_j_b: Sequence[Array]) -> BudgetComponent:
    pairs = zip(causes, T_j_b, strict=True)
    return _join_components([cause.component(T[:3, :3], len(cause.points)) for cause, T in pairs])


def _section_moves_by_twists(fit: StationTubeFit, T_j_b: Array, twists: Array) -> BudgetComponent:
    """How a station's sections move with its place, by twists (6, m) in j."""
    points = np.array([section.points_b for section in fit.station.sections])
    moved = points_moved_by_twist(transform_points(T_j_b, points), twists)
    measures = np.zeros((len(points), 4, twists.shape[-1]))
    return BudgetComponent(STATION_PLACES_CAUSE, "observed", True, moved, measures)


def _join_components(parts: Sequence[BudgetComponent]) -> BudgetComponent:
    """One component of the sections of all stations."""
    named = next((part for part in parts if part.name != STATION_PLACES_CAUSE), parts[0])
    return replace(
        named,
        points=np.concatenate([part.points for part in parts]),
        measures=np.concatenate([part.measures for part in parts]),
    )
