"""Calibration on a ball, its radius known or not."""

import numpy as np
import pytest
from calibration_stage import NOISE, T_F_S, WINDOW, error
from scipy.spatial.transform import Rotation

from tjscan.calibration.circle_fit import fit_dominant_circle
from tjscan.calibration.hand_eye import ArcSample, calibrate_on_sphere
from tjscan.calibration.sphere_model import SphereModel
from tjscan.calibration.targets import SphereTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose, pose, transform_points
from tjscan.core.pose_vector import boxplus
from tjscan.laser.faults import correlated_noise
from tjscan.laser.profile import Profile

BALL_B = np.array((0.8, 0.1, 0.3))
RADIUS = 0.030


def see_ball(T_b_f: Array, rng: np.random.Generator) -> Profile:
    """The near side of the ball in the laser plane, from a pose that errs as stated."""
    slip = pose(Rotation.from_rotvec(NOISE.rotation * rng.standard_normal(3)).as_matrix())
    T_b_f = T_b_f @ slip
    T_b_f[:3, 3] += NOISE.position * rng.standard_normal(3)
    centre = transform_points(inverse_pose(T_b_f @ T_F_S), BALL_B)
    edge = np.tan(WINDOW.half_angle)
    tangent = np.linspace(-edge, edge, WINDOW.columns)
    ray = np.column_stack((tangent, np.zeros_like(tangent), np.ones_like(tangent)))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    away = centre - (0, 0, WINDOW.apex_z)
    nearest = ray @ away
    depth = nearest**2 - away @ away + RADIUS**2
    along = nearest - np.sqrt(np.where(depth > 0, depth, np.nan))
    z = WINDOW.apex_z + along * ray[:, 2]
    return Profile(
        along * ray[:, 0], z + correlated_noise(rng, len(z), NOISE.range, NOISE.correlation)
    )


def arcs(rng: np.random.Generator, count: int = 15, tilt: float = 35.0) -> list[ArcSample]:
    found = []
    for i in range(count):
        turn = rng.uniform(-1, 1, 3) * (tilt, tilt, 1.7 * tilt)
        R = Rotation.from_euler("xyz", np.add(turn, (180, 0, 0)), degrees=True).as_matrix()
        seen_at = rng.uniform((-0.01, -0.018, 0.22), (0.01, 0.018, 0.27))
        T_b_f = pose(R, BALL_B - R @ seen_at) @ inverse_pose(T_F_S)
        found.append(
            ArcSample(f"arc {i + 1}", T_b_f, fit_dominant_circle(see_ball(T_b_f, rng), NOISE))
        )
    return found


@pytest.mark.parametrize("radius", [RADIUS, None])
def test_the_sensor_is_found_without_a_guess(radius: float | None) -> None:
    squares = []
    for seed in range(5):
        taken = arcs(np.random.default_rng(seed))
        result = calibrate_on_sphere(taken, SphereTarget(radius), NOISE)
        away = error(result.T_f_s)
        squares.append(away @ np.linalg.solve(result.covariance, away))
        assert result.radius == pytest.approx(RADIUS, abs=0.2e-3)
        assert result.centre_b is not None
        np.testing.assert_allclose(result.centre_b, BALL_B, atol=1e-3)
    # Chi-square with 6 degrees; the mean of five is known to 1.5; three of those.
    assert np.mean(squares) < 10.6


def test_a_guess_leads_to_the_same_place() -> None:
    taken = arcs(np.random.default_rng(0))
    free = calibrate_on_sphere(taken, SphereTarget(RADIUS), NOISE)
    led = calibrate_on_sphere(taken, SphereTarget(RADIUS), NOISE, T_f_s_guess=T_F_S)
    np.testing.assert_allclose(led.T_f_s, free.T_f_s, atol=1e-7)


def test_the_derivatives_are_those_of_the_residuals() -> None:
    rng = np.random.default_rng(0)
    taken = arcs(rng, 6)
    poses = np.stack([s.T_b_f for s in taken])
    model = SphereModel.from_arc_fits(poses, [s.fit for s in taken], SphereTarget(), NOISE)
    T, where = boxplus(T_F_S, 0.01 * rng.standard_normal(6)), np.append(BALL_B + 0.01, 0.031)
    found, h = model.linearise(T, where), 1e-6
    for i in range(6):
        step = h * np.eye(6)[i]
        up, down = (model.linearise(boxplus(T, s * step), where).residuals for s in (1, -1))
        np.testing.assert_allclose(found.by_pose[:, :, i], (up - down) / (2 * h), atol=1e-7)
    for i in range(4):
        step = h * np.eye(4)[i]
        up, down = (model.linearise(T, where + s * step).residuals for s in (1, -1))
        np.testing.assert_allclose(found.by_target[:, :, i], (up - down) / (2 * h), atol=1e-7)


def test_a_bad_pose_is_named() -> None:
    taken = arcs(np.random.default_rng(1))
    T = taken[3].T_b_f.copy()
    T[:3, 3] += 2e-3
    taken[3] = ArcSample("arc 4", T, taken[3].fit)
    assert calibrate_on_sphere(taken, SphereTarget(RADIUS), NOISE).rejected_sample_names == (
        "arc 4",
    )


def test_poses_that_only_translate_are_refused() -> None:
    with pytest.raises(CalibrationRefused, match="only translations"):
        calibrate_on_sphere(arcs(np.random.default_rng(0), tilt=0.1), SphereTarget(RADIUS), NOISE)
