"""Roof edges: fitted, calibrated on, alone, with a ball, and with the sensor fixed in the room."""

from dataclasses import replace

import numpy as np
import pytest
from _targets import EDGE_B, TargetSimulator
from calibration_stage import NOISE, T_F_S, WINDOW, error
from scipy.spatial.transform import Rotation

from tjscan.calibration.hand_eye import calibrate_on_targets
from tjscan.calibration.noise import geometry_error_correlation
from tjscan.calibration.solve.refine import CombinedModel
from tjscan.calibration.solve.solution import inverse_pose_errors
from tjscan.calibration.targets.ball import CircleFit, SeenBall, SphereTarget
from tjscan.calibration.targets.line import stack_lines
from tjscan.calibration.targets.plane import PlaneModel, PlaneTarget
from tjscan.calibration.targets.roof import RoofFit, RoofModel, RoofTarget, SeenRoof, fit_roof
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose, pose, unit_vector
from tjscan.core.pose_vector import boxminus, boxplus
from tjscan.laser.profile import Profile

HAND = TargetSimulator(T_F_S, WINDOW, NOISE)
PLANES = HAND.planes


def roofs(rng: np.random.Generator, count: int = 15) -> list[PosedFit[RoofFit]]:
    poses = HAND.poses(rng, count, "roof")
    return HAND.roofs(poses, poses, rng)


def arcs(rng: np.random.Generator, count: int) -> list[PosedFit[CircleFit]]:
    poses = HAND.poses(rng, count, "ball")
    return HAND.arcs(poses, poses, rng)


def edge_of(roof: RoofTarget) -> tuple[Array, Array]:
    """A point of the edge, metres, and its unit direction."""
    normals = np.stack((roof.left.plane.u, roof.right.plane.u))
    heights = np.array((roof.left.plane.u0, roof.right.plane.u0))
    near = roof.left.centre_b
    return near - np.linalg.pinv(normals) @ (normals @ near + heights), unit_vector(
        np.cross(*normals)
    )


def model_of(T_b_f: Array, fits: list[RoofFit], roof: RoofTarget) -> RoofModel:
    lefts, rights = [fit.left for fit in fits], [fit.right for fit in fits]
    return RoofModel(
        PlaneModel(stack_lines(T_b_f, lefts), roof.left, NOISE),
        PlaneModel(stack_lines(T_b_f, rights), roof.right, NOISE),
    )


def test_the_edge_is_where_both_planes_meet() -> None:
    rng = np.random.default_rng(0)
    for T_b_f in HAND.poses(rng, 10, "roof"):
        fit = fit_roof(HAND.roof_profile(T_b_f, rng), NOISE)
        edge_b = (T_b_f @ T_F_S @ np.append(fit.edge_s, 1.0))[:3]
        # Four of the pose's errors, a lever of 0.3 m included.
        np.testing.assert_allclose(edge_b[[0, 2]], EDGE_B[[0, 2]], atol=3e-4)


def test_a_table_beside_the_roof_is_left_out() -> None:
    x = np.linspace(-0.05, 0.05, 640)
    z = 0.24 + np.abs(x - 0.02)
    z[x < -0.005] = 0.29
    noise = np.random.default_rng(0).normal(0, NOISE.range / 3, len(x))
    fit = fit_roof(Profile(x, z + noise), NOISE)
    np.testing.assert_allclose(fit.edge_s, (0.02, 0, 0.24), atol=3e-5)


@pytest.mark.parametrize("shape", ["line", "ball", "nothing"])
def test_what_is_no_roof_is_refused(shape: str) -> None:
    x = np.linspace(-0.04, 0.04, 640)
    z = {
        "line": 0.24 + 0.2 * x,
        "ball": 0.29 - np.sqrt(0.045**2 - x**2),
        "nothing": np.full_like(x, np.nan),
    }[shape]
    with pytest.raises(CalibrationRefused, match="no roof edge seen"):
        fit_roof(Profile(x, z), NOISE)


def test_the_sensor_is_found_on_a_roof_without_a_guess() -> None:
    squares = []
    for seed in range(6):
        result = calibrate_on_targets([SeenRoof(roofs(np.random.default_rng(seed)), NOISE)], NOISE)
        away = error(result.T_f_s)
        squares.append(away @ np.linalg.solve(result.covariance, away))
        assert result.roof is not None
        assert np.degrees(result.roof.angle) == pytest.approx(95.0, abs=0.2)
        point, direction = edge_of(result.roof)
        away_b = point - EDGE_B
        assert np.linalg.norm(away_b - (away_b @ direction) * direction) < 1e-3
    # Chi-square with 6 degrees; the mean of six is known to 1.4; three of those.
    assert np.mean(squares) < 10.3


def test_the_derivatives_are_those_of_the_residuals() -> None:
    rng = np.random.default_rng(0)
    taken = roofs(rng, 6)
    T_b_f, fits = np.stack([s.T_b_f for s in taken]), [s.fit for s in taken]
    target = RoofTarget(*(PlaneTarget.from_unknown_plane(p, EDGE_B) for p in PLANES))
    T, where = boxplus(T_F_S, 0.01 * rng.standard_normal(6)), 0.01 * rng.standard_normal(6)
    found, h = model_of(T_b_f, fits, target).linearise(T, where), 1e-6
    for i in range(6):
        up, down = (
            model_of(
                np.stack([boxplus(pose_, s * h * np.eye(6)[i]) for pose_ in T_b_f]),
                fits,
                target,
            )
            .linearise(T, where)
            .residuals
            for s in (1, -1)
        )
        np.testing.assert_allclose(found.by_arm[:, :, i], (up - down) / (2 * h), atol=1e-7)


def test_roof_and_ball_of_one_sensor_are_one_problem() -> None:
    """Together they leave less than either alone, and the truth is within what is stated."""
    rng = np.random.default_rng(3)
    edge, ball = SeenRoof(roofs(rng, 8), NOISE), SeenBall(arcs(rng, 8), SphereTarget(0.030), NOISE)
    alone = [calibrate_on_targets([one], NOISE).uncertainty.position for one in (edge, ball)]
    both = calibrate_on_targets([edge, ball], NOISE)
    assert both.uncertainty.position < min(alone)
    assert both.method == "roof edge and sphere of known radius"
    assert both.roof is not None
    assert both.centre_b is not None
    away = error(both.T_f_s)
    assert away @ np.linalg.solve(both.covariance, away) < 30  # p = 4e-5 with 6 degrees


def test_a_target_on_the_arm_is_seen_by_a_fixed_sensor() -> None:
    """The same geometry, base and flange swapped: what was T_f_s is now the sensor in the base."""
    taken = roofs(np.random.default_rng(4))
    swapped = [PosedFit(s.name, inverse_pose(s.T_b_f), s.fit) for s in taken]
    moving = calibrate_on_targets([SeenRoof(taken, NOISE)], NOISE)
    fixed = calibrate_on_targets([SeenRoof(swapped, NOISE)], NOISE, sensor_is_fixed=True)
    assert fixed.sensor_is_fixed
    away = boxminus(fixed.T_f_s, moving.T_f_s)
    # The same profiles; the weights differ a little, for the arm errs at its other end.
    assert np.linalg.norm(away[:3]) < 3 * moving.uncertainty.position


def test_errors_of_an_inverse_pose_are_those_of_the_pose() -> None:
    T = pose(Rotation.random(rng=1).as_matrix(), (0.3, -0.5, 0.7))
    h, found = 1e-6, inverse_pose_errors(T[None])[0]
    for i, step in enumerate(h * np.eye(6)):
        up, down = (boxminus(inverse_pose(boxplus(T, s * step)), inverse_pose(T)) for s in (1, -1))
        np.testing.assert_allclose(found[:, i], (up - down) / (2 * h), atol=1e-8)


def test_what_models_share_is_one_pose() -> None:
    """The stacked covariance holds no correlation between profiles but by the arm's geometry."""
    taken = roofs(np.random.default_rng(5), 6)
    seen = SeenRoof(taken, NOISE)
    model = CombinedModel(
        (seen.model_at_sensor_pose(T_F_S)[0],), geometry_error_correlation(seen.T_b_f)
    )
    plain = model.linearise(T_F_S, np.zeros(6))
    other = plain.profile[:, None] != plain.profile
    assert np.abs(plain.covariance[other]).max() == 0
    off = replace(model, geometry=1e-4).linearise(T_F_S, np.zeros(6))
    assert np.abs(off.covariance[other]).max() > 0
