"""First-order answers to causes against draws of them through the geometry itself."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from budgets import covariance_between
from numpy.polynomial.legendre import legval2d
from rings import GROOVE
from scipy.spatial.transform import Rotation
from views_on_arm import T_F_S, ur10e, views

from tjscan.core.frames import Array, transform_points, unit_vector
from tjscan.groove.section import GrooveSection, section_from_points
from tjscan.joint.tubes.fit import ArmRepeatability
from tjscan.laser.deviation import DISTORTION_SIGMAS_BY_DEGREE
from tjscan.laser.model import LaserModel
from tjscan.robot.deviations import deviate_joint_frames, deviation_jacobian
from tjscan.robot.settings import PlacementTolerance
from tjscan.uncertainty.budget import BudgetComponent, UncertaintyBudget, points_moved_by_twist
from tjscan.uncertainty.causes import (
    ViewCause,
    arm_geometry_cause,
    budget_of_causes,
    hand_eye_cause,
    linearity_cause,
    range_bias_cause,
    reading_cause,
    repeatability_cause,
    sway_cause,
)

SECTIONS = views(4)
DRAWS = 4000
AGREE = 0.1
"""Of covariances from so many draws: each is good to 2 %, and small entries to less."""


def stacked(cause: ViewCause) -> Array:
    """Covariance of all points of all sections, shape (15 n, 15 n)."""
    by = cause.points.reshape(-1, cause.points.shape[-1])
    if cause.is_shared:
        return by @ by.T
    n = len(cause.points)
    whole = np.zeros((n, 15, n, 15))
    for k in range(n):
        own = cause.points[k].reshape(15, -1)
        whole[k, :, k] = own @ own.T
    return whole.reshape(15 * n, 15 * n)


def assert_drawn_alike(cause: ViewCause, drawn: Array) -> None:
    """`drawn`, shape (draws, n, 5, 3): points of each draw."""
    stated = stacked(cause)
    found = np.cov(drawn.reshape(len(drawn), -1), rowvar=False)
    assert np.linalg.norm(found - stated) < AGREE * np.linalg.norm(stated)


def turned(T: Array, step: Array) -> Array:
    """A pose moved by a step, written out: shifted, and turned about its own origin."""
    moved = T.copy()
    moved[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix() @ T[:3, :3]
    moved[:3, 3] += step[:3]
    return moved


def test_a_calibrations_error_moves_all_views_as_its_covariance_says() -> None:
    rng = np.random.default_rng(1)
    half = rng.normal(size=(6, 6)) * np.repeat((1e-4, 3e-4), 3)[:, None]
    covariance = half @ half.T
    cause = hand_eye_cause(SECTIONS, T_F_S, covariance, "calibrated")
    drawn = np.array(
        [
            [
                transform_points(s.view.T_b_f @ turned(T_F_S, step), GROOVE.points_s)
                for s in SECTIONS
            ]
            for step in rng.multivariate_normal(np.zeros(6), covariance, DRAWS)
        ]
    )
    assert_drawn_alike(cause, drawn)


def by_deviations() -> Array:
    return np.array([deviation_jacobian(ur10e(), section.view.q) for section in SECTIONS])


def test_joints_that_are_not_as_modelled_move_views_as_stated() -> None:
    rng, sigmas = np.random.default_rng(2), PlacementTolerance().sigmas
    cause = arm_geometry_cause(SECTIONS, by_deviations(), sigmas, "assumed")
    drawn = []
    for _ in range(DRAWS // 4):
        arm = deviate_joint_frames(ur10e(), sigmas * rng.standard_normal((6, 6)))
        drawn.append(
            [transform_points(arm.forward(s.view.q) @ T_F_S, GROOVE.points_s) for s in SECTIONS]
        )
    assert_drawn_alike(cause, np.array(drawn))


def test_a_stated_absolute_error_is_that_of_the_flange() -> None:
    sigmas = PlacementTolerance().sigmas
    cause = arm_geometry_cause(SECTIONS, by_deviations(), sigmas, "stated", 7e-4)
    flanges = np.array([section.view.T_b_f[:3, 3] for section in SECTIONS])
    moved = points_moved_by_twist(flanges[:, None], cause.twists)
    assert np.sqrt(np.mean(np.sum(moved**2, axis=(1, 2, 3)))) == pytest.approx(7e-4)


def test_sensor_and_arm_calibrated_together_err_together() -> None:
    """Their covariance counts with what links both, drawn through the calibrated arm."""
    rng = np.random.default_rng(6)
    size = np.concatenate((np.repeat((1e-4, 3e-4), 3), np.tile(PlacementTolerance().sigmas, 6)))
    half = rng.normal(size=(42, 42)) * size[:, None] / 6
    covariance = half @ half.T
    cause = hand_eye_cause(SECTIONS, T_F_S, covariance, "calibrated", by_deviations())
    drawn = []
    for step in rng.multivariate_normal(np.zeros(42), covariance, DRAWS // 4):
        arm, T_f_s = deviate_joint_frames(ur10e(), step[6:].reshape(6, 6)), turned(T_F_S, step[:6])
        drawn.append(
            [transform_points(arm.forward(s.view.q) @ T_f_s, GROOVE.points_s) for s in SECTIONS]
        )
    assert_drawn_alike(cause, np.array(drawn))


def test_what_an_arm_does_not_repeat_turns_each_view_about_its_flange() -> None:
    rng, repeatability = np.random.default_rng(3), ArmRepeatability()
    cause = repeatability_cause(SECTIONS, repeatability, "assumed")
    drawn = []
    for _ in range(DRAWS):
        here = []
        for section in SECTIONS:
            step = rng.multivariate_normal(np.zeros(6), repeatability.covariance)
            view = section.view
            T_b_s = turned(view.T_b_f, step) @ T_F_S
            here.append(transform_points(T_b_s, GROOVE.points_s))
        drawn.append(here)
    assert_drawn_alike(cause, np.array(drawn))


def test_a_sway_that_is_left_moves_views_along_the_groove_and_across_it_as_stated() -> None:
    across, along = 2e-5, 3e-4
    left = np.array((across, along))
    swayed = [replace(one, view=replace(one.view, sway=left)) for one in SECTIONS]
    origins = np.array([one.T_b_g[:3, 3] for one in swayed])
    for k, C in enumerate(sway_cause(swayed).component(np.eye(3), len(swayed)).corner_covariances):
        ways = np.delete(origins, k, axis=0) - origins[k]
        ahead = unit_vector(ways[np.argmin(np.linalg.norm(ways, axis=1))])
        stated = across**2 * np.eye(3) + (along**2 - across**2) * np.outer(ahead, ahead)
        np.testing.assert_allclose(C, np.tile(stated, (3, 1, 1)), rtol=0, atol=1e-15)


def test_views_that_were_taken_as_the_arm_arrived_have_no_sway() -> None:
    assert not sway_cause(SECTIONS).points.any()


def test_a_wrong_calibration_seen_from_one_pose_is_a_rigid_motion() -> None:
    """It moves all points of one view as one body: no distance between them changes."""
    one = [SECTIONS[0], SECTIONS[0]]
    cause = hand_eye_cause(one, T_F_S, np.diag(np.repeat((1e-8, 1e-6), 3)), "calibrated")
    assert np.allclose(cause.points[0], cause.points[1])
    points = one[0].points_b
    for m in range(6):
        moved = cause.points[0, :, :, m]
        for i in range(5):
            for j in range(i):
                along = points[i] - points[j]
                assert abs(along @ (moved[i] - moved[j])) < 1e-15
    assert not cause.measures.any()


LASER = LaserModel()


def smooth_field(xz: Array, coefficients: Array) -> Array:
    """Deviations of a laser's x and z, coefficients (2, 4, 4) of what NumPy makes of them."""
    half = ((LASER.far - LASER.emitter_z) * np.tan(LASER.half_angle), 0.05)
    u, v = (xz - (0.0, 0.24)).T / np.array(half)[:, None]
    return np.column_stack([legval2d(u, v, c) for c in coefficients])


def each_term(size: float) -> list[Array]:
    """Coefficients of each term alone, in the order of the draws."""
    terms = []
    for axis in range(2):
        for i in range(4):
            for j in range(4):
                if 0 < i + j < 4:
                    one = np.zeros((2, 4, 4))
                    one[axis, i, j] = size * DISTORTION_SIGMAS_BY_DEGREE[i + j - 1]
                    terms.append(one)
    return terms


def bent(coefficients: Array) -> GrooveSection:
    """The groove of `rings`, its points moved and its tangents taken again."""
    p, near = GROOVE.points_s[:, [0, 2]], 1e-5
    wall, leg = (
        np.diff(line + smooth_field(line, coefficients), axis=0)[0]
        for line in (
            np.array((at, at + near * t))
            for at, t in ((p[1], GROOVE.wall_s[[0, 2]]), (p[3], GROOVE.leg_s[[0, 2]]))
        )
    )
    return section_from_points(
        np.insert(p + smooth_field(p, coefficients), 1, 0.0, axis=1),
        wall_s=np.insert(wall, 1, 0.0),
        leg_s=np.insert(leg, 1, 0.0),
    )


def test_a_bent_laser_changes_points_and_measures_as_stated() -> None:
    limit = 6e-7  # so small that squares of it do not count
    cause = linearity_cause(SECTIONS[:1], limit, LASER, "stated")
    R_b_s, plain = SECTIONS[0].view.T_b_s[:3, :3], bent(np.zeros((2, 4, 4)))
    for which, term in enumerate(each_term(limit)):
        found = bent(term)
        moved = (found.points_s - plain.points_s) @ R_b_s.T
        assert np.allclose(cause.points[0, :, :, which], moved, atol=1e-14)
        for name, k in (("groove_angle", 0), ("root_width", 1), ("depth", 2), ("area", 3)):
            change = getattr(found, name) - getattr(plain, name)
            assert cause.measures[0, k, which] == pytest.approx(change, rel=0.01, abs=1e-10)


def test_coefficients_are_those_of_lasers_that_deviate_by_as_much_as_stated() -> None:
    rng = np.random.default_rng(4)
    x, z = np.meshgrid(np.linspace(-1, 1, 15), np.linspace(LASER.near, LASER.far, 15))
    width = (z - LASER.emitter_z) * np.tan(LASER.half_angle)
    xz = np.column_stack(((x * width).ravel(), z.ravel()))
    degree = np.add.outer(np.arange(4), np.arange(4))
    drawn = []
    for _ in range(2000):
        one = np.where((degree > 0) & (degree < 4), rng.standard_normal((2, 4, 4)), 0.0)
        one /= np.maximum(degree, 1)
        drawn.append(one / np.abs(smooth_field(xz, one)).max())
    for k, stated in enumerate(DISTORTION_SIGMAS_BY_DEGREE, start=1):
        found = np.sqrt(np.mean(np.square(np.array(drawn)[:, :, degree == k])))
        assert found == pytest.approx(stated, rel=0.04)


def test_a_range_bias_moves_corners_to_where_the_moved_sides_meet() -> None:
    bias = 2e-5
    cause = range_bias_cause(SECTIONS[:1], bias, "assumed")
    p = GROOVE.points_s[:, [0, 2]]
    lines: list[list[tuple[Array, Array]]] = []
    for a, b in pairwise(p):
        # Near the corners alone, where the incidence is that of the corner.
        along = (b - a) / np.linalg.norm(b - a)
        lines.append([])
        for at in (a, b):
            ray = at / np.linalg.norm(at)
            square = abs(ray[0] * along[1] - ray[1] * along[0])
            away = bias * min(abs(ray @ along) / square, 5.0) * ray
            lines[-1].append((at + away, along))
    for i in (1, 2, 3):
        (q, d), (r, e) = lines[i - 1][1], lines[i][0]
        s, _ = np.linalg.solve(np.column_stack((d, -e)), r - q)
        moved = SECTIONS[0].view.T_b_s[:3, [0, 2]] @ (q + s * d - p[i])
        assert np.allclose(cause.points[0, i, :, 0], moved, atol=1e-10)


def test_reading_states_what_the_groove_states() -> None:
    budget = budget_of_causes([reading_cause(SECTIONS)], np.eye(4), len(SECTIONS))
    for k, section in enumerate(SECTIONS):
        in_plane = section.view.T_b_s[:3, [0, 2]]
        stated = in_plane @ section.groove.corner_covariances_s @ in_plane.T
        assert np.allclose(budget.corner_covariances[k], stated, atol=1e-18)
        assert np.allclose(budget.measure_covariances[k], section.groove.measure_covariance)


def test_a_shared_cause_compressed_says_the_same() -> None:
    cause = arm_geometry_cause(SECTIONS, by_deviations(), PlacementTolerance().sigmas, "assumed")
    whole = BudgetComponent("arm", "stated", True, cause.points, cause.measures)
    less = whole.with_fewest_draws()
    assert less.points.shape[-1] < whole.points.shape[-1]
    a, b = UncertaintyBudget((whole,)), UncertaintyBudget((less,))
    for pair in (((0, 1), (3, 2)), ((2, 3), (2, 3))):
        one, other = covariance_between(a, *pair), covariance_between(b, *pair)
        assert np.allclose(one, other, atol=1e-6 * np.abs(one).max())


def test_a_budget_turned_into_another_frame_turns_its_covariances() -> None:
    R = Rotation.random(rng=5).as_matrix()
    budget = budget_of_causes([reading_cause(SECTIONS)], np.eye(4), 4)
    moved = budget.rotated_budget(R)
    assert np.allclose(moved.corner_covariances, R @ budget.corner_covariances @ R.T)
