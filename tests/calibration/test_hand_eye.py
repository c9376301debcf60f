"""Laws of the hand-eye calibration: closed form, refinement, uncertainty, bad poses, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from _board import BoardSimulator, points_rms
from _targets import calibrate_on_plane
from calibration_stage import (
    AXES,
    CENTRE,
    EXACT_HAND,
    HAND,
    MM,
    NOISE,
    PLANE,
    T_F_S,
    circle,
    error,
    looking,
    raised,
    samples,
    shots,
    target,
    varied,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tjscan.calibration.checks import verify_with_fresh_line
from tjscan.calibration.closed_form import (
    PluckerPlane,
    incidence_residuals,
    line_through_point,
    solve_closed_form,
    transform_line,
)
from tjscan.calibration.noise import NoiseModel, geometry_error_correlation
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.solve.refine import (
    CombinedModel,
    leave_one_out_changes,
    refine_by_least_squares,
)
from tjscan.calibration.targets.line import LineFit, stack_lines
from tjscan.calibration.targets.plane import PlaneModel, SeenBoard
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, pose
from tjscan.core.pose_vector import boxplus

RECOVERED = 1e-9
"""Metres and radians: rounding alone."""
POSES = circle(30)


def calibrated(seed: int, poses: Array = POSES, hand: BoardSimulator = HAND) -> HandEyeCalibration:
    rng = np.random.default_rng(seed)
    return calibrate_on_plane(samples(poses, shots(poses, hand, rng)), target(rng), NOISE)


def exact_samples(poses: Array = POSES) -> list[PosedFit[LineFit]]:
    return samples(poses, shots(poses, EXACT_HAND, np.random.default_rng(0)))


def test_the_closed_form_recovers_the_papers_transform() -> None:
    taken = exact_samples()
    found = solve_closed_form(stack_lines(POSES, [s.fit for s in taken]), PLANE)
    np.testing.assert_allclose(found.T_f_s, T_F_S, atol=RECOVERED)
    assert found.residual < RECOVERED
    assert found.singular_values[5] < RECOVERED


def test_the_refinement_recovers_the_papers_transform() -> None:
    result = calibrate_on_plane(exact_samples(), target(), NOISE)
    np.testing.assert_allclose(result.T_f_s, T_F_S, atol=RECOVERED)
    assert result.caveats == ()
    for sample in exact_samples():
        line_b = transform_line(
            sample.T_b_f @ result.T_f_s,
            line_through_point(sample.fit.point_s, sample.fit.direction_s),
        )
        np.testing.assert_allclose(incidence_residuals(line_b, PLANE), 0, atol=1e-8)  # (17)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_any_mount_is_recovered_without_a_guess(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T_f_s = pose(Rotation.random(rng=rng).as_matrix(), 0.2 * rng.standard_normal(3))
    hand = BoardSimulator(T_f_s, PLANE, EXACT_HAND.window)
    poses = POSES @ T_F_S @ np.linalg.inv(T_f_s)
    result = calibrate_on_plane(samples(poses, shots(poses, hand, rng)), target(), NOISE)
    np.testing.assert_allclose(result.T_f_s, T_f_s, atol=RECOVERED)


@pytest.mark.parametrize("depth", [0.20, 0.24, 0.28])
def test_the_sign_is_not_luck_where_all_lines_are_at_one_depth(depth: float) -> None:
    """The mirrored sensor then leaves no residual either: it looks from behind the board."""
    turns = np.arange(12) * np.pi / 6
    poses = np.stack([looking(25 * np.cos(a), 25 * np.sin(a), depth=depth) for a in turns])
    for sign in (1, -1):
        flipped = replace(PLANE, u=sign * PLANE.u, u0=sign * PLANE.u0)
        taken = exact_samples(poses)
        found = solve_closed_form(stack_lines(poses, [s.fit for s in taken]), flipped)
        np.testing.assert_allclose(found.T_f_s, T_F_S, atol=RECOVERED)


def test_it_needs_no_more_than_five_lines() -> None:
    poses = np.stack([looking(*tilts) for tilts in ((0, 0), (25, 0), (0, 25), (-20, 20), (20, 20))])
    result = calibrate_on_plane(exact_samples(poses), target(), NOISE)
    np.testing.assert_allclose(result.T_f_s, T_F_S, atol=1e-8)


def test_the_derivatives_are_those_of_the_residuals() -> None:
    rng = np.random.default_rng(0)
    taken = samples(POSES, shots(POSES, HAND, rng))
    model = PlaneModel(stack_lines(POSES, [s.fit for s in taken]), target(rng), NOISE)
    T, by = boxplus(T_F_S, 0.01 * rng.standard_normal(6)), 0.02 * rng.standard_normal(3)
    found, h = model.linearise(T, by), 1e-6
    for i in range(6):
        step = np.zeros(6)
        step[i] = h
        up, down = (model.linearise(boxplus(T, s * step), by).residuals for s in (1, -1))
        np.testing.assert_allclose(found.by_pose[:, :, i], (up - down) / (2 * h), atol=1e-8)
    for i in range(3):
        step = h * np.eye(3)[i]
        up, down = (model.linearise(T, by + s * step).residuals for s in (1, -1))
        np.testing.assert_allclose(found.by_target[:, :, i], (up - down) / (2 * h), atol=1e-8)


def test_residuals_scatter_as_their_covariance_says() -> None:
    """Range noise and pose noise of a real fit, against the covariance that weighs it."""
    rng = np.random.default_rng(0)
    steep = looking(25, -15, 30, 0.27)
    T_b_f = np.repeat(steep[None], 1500, axis=0)
    taken = samples(T_b_f, shots(T_b_f, HAND, rng))
    exact = replace(target(), plane=PLANE)
    found = PlaneModel(stack_lines(T_b_f, [s.fit for s in taken]), exact, NOISE).linearise(
        T_F_S, np.zeros(3)
    )
    # 1,500 draws give a variance to 3.7 %; four of those.
    stated = found.covariance.mean(axis=0)
    sigma = np.sqrt(np.diag(stated))
    difference = (np.cov(found.residuals.T) - stated) / np.outer(sigma, sigma)
    np.testing.assert_allclose(difference, 0, atol=0.15)


def test_the_claimed_covariance_is_honest() -> None:
    squares, closed, refined = [], [], []
    for seed in range(150):
        result = calibrated(seed)
        away = error(result.T_f_s)
        squares.append(away @ np.linalg.solve(result.covariance, away) / 6)
        refined.append(np.linalg.norm(away[:3]))
        assert result.closed_form is not None
        closed.append(np.linalg.norm(error(result.closed_form.T_f_s)[:3]))
    # Chi-square over 6: 150 draws give its mean to 0.047; three and a half of those.
    assert np.mean(squares) == pytest.approx(1.0, abs=0.165)
    assert np.sqrt(np.mean(np.square(refined))) < np.sqrt(np.mean(np.square(closed)))


def test_errors_shrink_with_the_root_of_the_number_of_lines() -> None:
    few = calibrated(1, circle(30, 12)).uncertainty
    many = calibrated(1, np.tile(circle(30, 12), (4, 1, 1))).uncertainty
    assert many.rotation < 0.75 * few.rotation  # the touched plane's share does not shrink
    assert many.position < 0.6 * few.position


def test_results_do_not_depend_on_the_base_frame() -> None:
    rng = np.random.default_rng(3)
    taken, board = samples(POSES, shots(POSES, HAND, rng)), target(rng)
    T = pose(Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3))
    R = T[:3, :3]
    u = R @ board.plane.u
    elsewhere = replace(
        board,
        plane=PluckerPlane(u, board.plane.u0 - float(u @ T[:3, 3])),
        centre_b=R @ board.centre_b + T[:3, 3],
        axes_b=board.axes_b @ R.T,
    )
    moved = [replace(s, T_b_f=T @ s.T_b_f) for s in taken]
    here, there = (
        calibrate_on_plane(taken, board, NOISE),
        calibrate_on_plane(moved, elsewhere, NOISE),
    )
    np.testing.assert_allclose(here.T_f_s, there.T_f_s, atol=1e-8)
    np.testing.assert_allclose(here.covariance, there.covariance, rtol=1e-4, atol=1e-14)


@pytest.mark.parametrize("k", range(12))
def test_one_spoiled_line_is_named_and_left_out(k: int) -> None:
    rng = np.random.default_rng(k)
    profiles, board = shots(POSES, HAND, rng), target(rng)
    clean = calibrate_on_plane(samples(POSES, profiles), board, NOISE)
    profiles[k] = raised(profiles[k], 2 * MM * (-1) ** k)
    spoiled = calibrate_on_plane(samples(POSES, profiles), board, NOISE)
    assert spoiled.rejected_sample_names == (f"line {k + 1}",)
    assert f"line {k + 1}" in spoiled.caveats[0]
    assert spoiled.uncertainty.position < 1.5 * clean.uncertainty.position
    assert abs(spoiled.residuals[k].offset) == pytest.approx(2 * MM, rel=0.4)
    away = error(spoiled.T_f_s)
    assert away @ np.linalg.solve(spoiled.covariance, away) < 30  # p = 4e-5 with 6 degrees


@pytest.mark.parametrize("seed", range(6))
def test_two_spoiled_lines_are_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    profiles, board = shots(POSES, HAND, rng), target(rng)
    bad = [int(k) for k in np.sort(rng.choice(12, 2, replace=False))]
    for k in bad:
        profiles[k] = raised(profiles[k], 2 * MM)
    result = calibrate_on_plane(samples(POSES, profiles), board, NOISE)
    assert result.rejected_sample_names == tuple(f"line {k + 1}" for k in bad)


def test_good_lines_are_seldom_blamed() -> None:
    assert (
        sum(len(calibrated(seed).rejected_sample_names) for seed in range(100, 160)) <= 1
    )  # 0.06 expected


def test_leaving_a_line_out_moves_the_result_as_foretold() -> None:
    rng = np.random.default_rng(5)
    taken = samples(POSES, shots(POSES, HAND, rng))
    board = target(rng)
    lines = PlaneModel(stack_lines(POSES, [s.fit for s in taken]), board, NOISE)
    model = CombinedModel((lines,), geometry_error_correlation(POSES))
    every = np.ones(12, dtype=bool)
    whole = refine_by_least_squares(model, T_F_S, np.zeros(3), every)
    foretold_falls, foretold_steps = leave_one_out_changes(whole)
    for k in range(12):
        used = every.copy()
        used[k] = False
        without = refine_by_least_squares(model, whole.T_f_s, whole.target, used)
        turn = Rotation.from_matrix(without.T_f_s[:3, :3] @ whole.T_f_s[:3, :3].T).as_rotvec()
        step = np.concatenate((without.T_f_s[:3, 3] - whole.T_f_s[:3, 3], turn))
        # To first order; weights change a little with the estimate.
        np.testing.assert_allclose(foretold_steps[k], step, atol=0.02 * np.abs(step).max() + 1e-7)
        assert whole.chi2 - without.chi2 == pytest.approx(foretold_falls[k], rel=0.02, abs=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_an_unknown_plane_is_found_with_the_sensor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = varied(rng, 14)
    taken = samples(poses, shots(poses, HAND, rng))
    result = calibrate_on_plane(taken, None, NOISE)
    away = error(result.T_f_s)
    assert away @ np.linalg.solve(result.covariance, away) < 30  # p = 4e-5 with 6 degrees
    assert result.board is not None
    assert result.method == "plane unknown"
    assert np.degrees(np.arccos(np.minimum(result.board.plane.u @ PLANE.u, 1))) < 0.5
    assert points_rms(result, taken) < 0.2 * MM


def test_an_unknown_plane_needs_tilts_of_several_sizes() -> None:
    poses = circle(25)
    taken = samples(poses, shots(poses, HAND, np.random.default_rng(0)))
    with pytest.raises(CalibrationRefused, match=r"all tilts alike.*square to the board"):
        calibrate_on_plane(taken, None, NOISE)


def refusal(poses: Array, guess: Array | None = T_F_S) -> CalibrationRefused:
    rng = np.random.default_rng(0)
    with pytest.raises(CalibrationRefused) as caught:
        calibrate_on_plane(
            samples(poses, shots(poses, HAND, rng)), target(rng), NOISE, T_f_s_guess=guess
        )
    return caught.value


def test_too_few_lines_are_refused() -> None:
    assert refusal(POSES[:4]).reason == "too few lines"


def test_translations_alone_are_refused() -> None:
    grid = np.linspace(-0.02, 0.02, 4)
    said = refusal(np.stack([looking(shift=(x, y)) for x in grid for y in grid]))
    assert said.reason == "only translations"
    assert "about the sensor's x and y axes" in said.evidence


@pytest.mark.parametrize(
    ("axis", "missing"),
    [
        (0, "tilt about the sensor's y axis,"),
        (1, "tilt about the sensor's x axis,"),
        (2, "tilt about the sensor's x axis and the sensor's y axis,"),
    ],
)
@pytest.mark.parametrize("guessed", [True, False])
def test_turns_about_one_axis_are_refused(axis: int, missing: str, guessed: bool) -> None:
    sizes = np.linspace(-30, 30, 12)
    poses = np.stack([looking(*(a * np.eye(3)[axis])) for a in sizes])
    said = refusal(poses, T_F_S if guessed else None)
    assert said.reason == "turns about one axis only"
    # The paper's sensor sits square on the flange: only the owner of the axes differs.
    assert (missing if guessed else missing.replace("sensor", "flange")) in said.evidence


def test_tilts_one_way_and_turns_about_the_normal_are_refused() -> None:
    sizes = np.linspace(-30, 30, 12)
    poses = np.stack([looking(a, 0, 60 * np.cos(3 * a)) for a in sizes])
    said = refusal(poses)
    assert said.reason == "plane normals do not span space"
    assert "tilt about the sensor's y axis" in said.evidence


def test_a_set_is_judged_by_its_covariance_and_not_by_its_condition_number() -> None:
    weights = []
    for seed in range(12):
        rng, poses = np.random.default_rng([8, seed]), circle(7)
        result = calibrate_on_plane(samples(poses, shots(poses, HAND, rng)), target(rng), NOISE)
        assert result.condition > 100
        assert 1 * MM < result.uncertainty.position < 5 * MM
        assert any("certain to" in said for said in result.caveats)
        off = error(result.T_f_s)
        weights.append(off @ np.linalg.solve(result.covariance, off) / 6)
    assert max(weights) < 4.6  # chi-squared of six over six, one in ten thousand
    assert np.mean(weights) < 1.5


def test_tilts_too_small_to_beat_a_drawing_are_refused() -> None:
    said = refusal(circle(3))
    assert said.reason == "too uncertain"
    assert "the limits are 5 mm and 1°" in said.evidence
    assert "the sensor's x axis and the sensor's y axis" in said.evidence


def test_residuals_beyond_the_noise_model_are_refused() -> None:
    rng = np.random.default_rng(0)
    profiles = [raised(p, 0.8 * MM * rng.standard_normal()) for p in shots(POSES, HAND, rng)]
    with pytest.raises(CalibrationRefused, match=r"times larger than stated.*worst are line"):
        calibrate_on_plane(samples(POSES, profiles), target(rng), NOISE)


def test_a_little_more_noise_than_stated_widens_the_covariance() -> None:
    rng = np.random.default_rng(0)
    loud = replace(HAND, noise=NoiseModel(position=0.1 * MM, rotation=float(np.radians(0.02))))
    result = calibrate_on_plane(samples(POSES, shots(POSES, loud, rng)), target(rng), NOISE)
    assert 1.5 < result.sigma_scale < 3.0
    assert any("widened" in said for said in result.caveats)


def test_a_fresh_line_verifies_a_good_result_and_unmasks_a_bad_one() -> None:
    rng = np.random.default_rng(0)
    board = SeenBoard(samples(POSES, shots(POSES, HAND, rng)), target(rng), NOISE)
    result = calibrate_on_plane(board.samples, board.target, NOISE)
    rng, poses = np.random.default_rng(99), varied(np.random.default_rng(7), 60)
    profiles = [shots(T[None], HAND, rng)[0] for T in poses]
    checks = [
        verify_with_fresh_line(board, result, samples(T[None], [profile])[0])
        for T, profile in zip(poses, profiles, strict=True)
    ]
    assert all(check.line_agrees for check in checks)
    assert np.mean([check.misfit**2 for check in checks]) == pytest.approx(1.0, abs=0.45)
    moved = [
        samples(T[None], [raised(p, 1.5 * MM)])[0] for T, p in zip(poses, profiles, strict=True)
    ]
    assert not any(verify_with_fresh_line(board, result, one).line_agrees for one in moved)


def test_infinite_trust_is_no_noise_model() -> None:
    with pytest.raises(ValueError, match="infinite weight"):
        NoiseModel(position=0.0)
    with pytest.raises(ValueError, match="columns"):
        NoiseModel(correlation=-1.0)


def test_poses_are_made_as_they_say() -> None:
    T_b_s = looking(tilt_x=20, shift=(0.01, 0.02)) @ T_F_S
    np.testing.assert_allclose(
        T_b_s @ (0, 0, 0.24, 1), (*(CENTRE + (0.01, 0.02) @ AXES), 1), atol=1e-12
    )
    assert np.degrees(np.arccos(-T_b_s[:3, 2] @ PLANE.u)) == pytest.approx(20)
