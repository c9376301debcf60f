"""What stations share, against stitching them again with that error put in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from budgets import covariance_between
from exact_stations import exact_station
from free_stations import joint_named
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, inverse_pose, pose
from tjscan.core.pose_vector import pose_to_vector
from tjscan.laser.model import LaserModel
from tjscan.laser.profile import Profile
from tjscan.scanning.section import ScannedSection
from tjscan.stitching.stations import Station, StitchSettings, fit_tubes_to_stations
from tjscan.stitching.stitch import StitchedGroove
from tjscan.stitching.unrolled_views import moves_of_wall_points
from tjscan.uncertainty.causes import (
    HAND_EYE_CAUSE,
    LINEARITY_CAUSE,
    ViewCause,
    hand_eye_cause,
    linearity_cause,
    motion_cause,
)

T_F_S = inverse_pose(pose(p=(0.1, 0.0, -0.15)))
"""How `exact_stations` mounts its sensor."""

SMALL = StitchSettings(out_of_round=1e-5)

LINEAR = 0.03
"""Of what an error does: the rest is its square, and what neighbours are carried by."""


def two(oval: float = 0.0) -> list[Station]:
    azimuths = [np.radians(np.arange(a, b, 10.0)) for a, b in ((-15.0, 196.0), (167.0, 378.0))]
    return [
        exact_station(joint_named("tjoint-600x457"), name, arc, oval=oval)[0]
        for name, arc in zip(("left", "right"), azimuths, strict=True)
    ]


def with_cause(station: Station, make: Callable[[Station], ViewCause]) -> Station:
    return replace(station, causes=(make(station),))


def moved(station: Station, change: Callable[[ScannedSection], Array]) -> Station:
    """A station whose views are believed to stand elsewhere: at `change` of each."""
    sections = tuple(
        replace(one, view=replace(one.view, T_b_s=change(one))) for one in station.sections
    )
    return replace(station, sections=sections, all_sections=sections)


def stepped(T: Array, step: Array) -> Array:
    turn = Rotation.from_rotvec(step[3:]).as_matrix()
    return pose(turn @ T[:3, :3], T[:3, 3] + step[:3])


def component_of(stitched: StitchedGroove, name: str) -> Array:
    """How all points move with each draw of a cause, shape (n, 5, 3, m)."""
    return next(one.points for one in stitched.budget.components if one.name == name)


@pytest.mark.parametrize("axis", range(6))
def test_a_wrong_calibration_moves_stitched_sections_as_stated(axis: int) -> None:
    size = np.repeat((3e-5, 5e-5), 3)[axis]  # about the arm's own: no robust weight changes
    step = size * np.eye(6)[axis]
    stations = [
        with_cause(s, lambda s: hand_eye_cause(s.sections, T_F_S, np.outer(step, step), "stated"))
        for s in two()
    ]
    stated = StitchedGroove(stations, SMALL)
    truth = np.array([section.points for section in stated.sections])
    wrong = [moved(s, lambda one: one.view.T_b_f @ stepped(T_F_S, step)) for s in stations]
    found = StitchedGroove(wrong, SMALL)
    off = np.array([section.points for section in found.sections]) - truth
    (by,) = np.moveaxis(component_of(stated, HAND_EYE_CAUSE), -1, 0)
    sign = np.sign(np.sum(off * by))
    corners = slice(1, 4)
    size_off = np.linalg.norm(off[:, corners])
    assert np.linalg.norm(off[:, corners] - sign * by[:, corners]) < LINEAR * size_off + 1e-7 + 1e-7
    for one, other in zip(stated.stations, found.stations, strict=True):
        turned = other.T_j_b @ inverse_pose(one.T_j_b)
        assert np.linalg.norm(turned[:3, 3]) > 0


LENS = LaserModel(near=0.15, far=0.31)
"""Its window holds all that `exact_stations` see."""

BEND = 3e-5
"""Metres that it bends by somewhere in its window."""


def lens(station: Station) -> ViewCause:
    return linearity_cause(station.sections, BEND, LENS, "stated")


def bent(station: Station, draw: int) -> Station:
    """A station whose laser bends all profiles, and what is read in them, as one draw does."""
    bend = lens(station).bend
    assert bend is not None

    def bent_points(points_s: Array) -> Array:
        xz = points_s[:, [0, 2]]
        return points_s + np.insert(bend(xz, np.zeros_like(xz))[..., draw], 1, 0.0, axis=1)

    sections = []
    for one in station.sections:
        seen = bent_points(one.view.profile.points_s)
        groove = replace(one.groove, points_s=bent_points(one.groove.points_s))
        view = replace(one.view, profile=Profile(seen[:, 0], seen[:, 2]))
        sections.append(replace(one, view=view, groove=groove))
    return replace(station, sections=tuple(sections), all_sections=tuple(sections))


def drawn_alone(cause: ViewCause, draw: int) -> ViewCause:
    """The cause with one of its draws."""
    one = slice(draw, draw + 1)
    bend = cause.bend
    assert bend is not None
    return replace(
        cause,
        twists=cause.twists[..., one],
        points=cause.points[..., one],
        measures=cause.measures[..., one],
        bend=lambda xz, tangents: bend(xz, tangents)[..., one],
    )


@pytest.mark.parametrize("draw", range(18))
def test_a_bent_lens_moves_fitted_tubes_as_stated(draw: int) -> None:
    """Frame j and the tubes' dimensions, against fitting what the bent laser sees."""
    station = two()[0]
    (fit,), (found,) = (fit_tubes_to_stations([s], SMALL) for s in (station, bent(station, draw)))
    moved = moves_of_wall_points(fit.walls, station.all_sections, lens(station))[..., draw]
    stated = np.einsum("nik,nk->i", fit.frame.by_points, moved)
    off = np.concatenate(
        (
            pose_to_vector(inverse_pose(fit.frame.T) @ found.frame.T),
            found.frame.shape.as_array - fit.frame.shape.as_array,
        )
    )
    size = np.linalg.norm(off)
    assert np.linalg.norm(stated - off) < LINEAR * size + 1e-7
    assert size > 1e-6


@pytest.mark.parametrize("draw", [2, 9, 15])
def test_a_bent_lens_moves_stitched_sections_as_stated(draw: int) -> None:
    """Corners bend by themselves, and move with stations that are placed by bent walls."""
    stations = [with_cause(s, lambda s: drawn_alone(lens(s), draw)) for s in two()]
    stated = StitchedGroove(stations, SMALL)
    found = StitchedGroove([bent(s, draw) for s in stations], SMALL)
    off = np.array([section.points for section in found.sections])
    off = (off - [section.points for section in stated.sections])[:, 1:4]
    (by,) = np.moveaxis(component_of(stated, LINEARITY_CAUSE)[:, 1:4], -1, 0)
    assert np.linalg.norm(off - by) < LINEAR * np.linalg.norm(off)


def test_an_error_that_moves_all_views_alike_is_taken_up_by_the_stations_place() -> None:
    """A base that is not where it was believed to be moves no section of a stitched groove."""
    twists = np.repeat((1e-3, 1e-3), 3)[:, None] * np.eye(6)

    def base_moves(station: Station) -> ViewCause:
        all_alike = np.tile(twists, (len(station.sections), 1, 1))
        return motion_cause("base", "stated", station.sections, all_alike, is_shared=True)

    stitched = StitchedGroove([with_cause(s, base_moves) for s in two()], SMALL)
    by = component_of(stitched, "base")
    assert np.abs(by[:, 1:4]).max() < 1e-3 * 1e-3


def test_without_shared_causes_the_budget_is_of_reading_arm_and_places_alone() -> None:
    stitched = StitchedGroove(two())
    names = [one.name for one in stitched.budget.components]
    assert names == ["reading of the profile", "arm's repeatability", "stations' places"]
    assert all(
        np.allclose(section.covariances, covariance)
        for section, covariance in zip(
            stitched.sections, stitched.budget.corner_covariances, strict=True
        )
    )


def test_causes_of_other_names_are_not_shared() -> None:
    """Two devices err each by itself: less alike than one that errs the same at both stations."""
    covariance = np.diag(np.repeat((3e-5, 5e-5), 3) ** 2)

    def stitched(names: tuple[str, str]) -> StitchedGroove:
        stations = []
        for station, name in zip(two(), names, strict=True):
            cause = hand_eye_cause(station.sections, T_F_S, covariance, "stated")
            stations.append(replace(station, causes=(replace(cause, name=name),)))
        return StitchedGroove(stations, SMALL)

    same, apart = stitched(("hand", "hand")), stitched(("hand 1", "hand 2"))
    assert len(apart.budget.components) == len(same.budget.components) + 1
    first = [k for k, one in enumerate(apart.sections) if one.station == "left"]
    second = [k for k, one in enumerate(apart.sections) if one.station == "right"]
    pair = (first[3], 2), (second[3], 2)
    alike, unlike = (covariance_between(one.budget, *pair) for one in (same, apart))
    assert np.linalg.norm(alike - unlike) > 0.1 * np.linalg.norm(alike)
