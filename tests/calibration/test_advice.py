"""The poses that are advised see the board, within reach, and tell more than others."""

import numpy as np
import pytest
from _board import transform_plane
from _targets import calibrate_on_plane
from calibration_stage import (
    CENTRE,
    EXACT_HAND,
    HAND,
    NOISE,
    PLACES,
    PLANE,
    T_F_S,
    WINDOW,
    circle,
    looking,
    samples,
    shots,
    target,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.calibration.checks import rotation_condition
from tjscan.calibration.closed_form import rotation_equations, solve_closed_form
from tjscan.calibration.targets.line import stack_lines
from tjscan.calibration.targets.plane import PlaneTarget
from tjscan.calibration.wizard.session import (
    BoardRectangle,
    CandidatePoseGrid,
    LinePredictor,
    ReachabilityCheck,
    visible_lines_on_plane,
)
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose, transform_points

TARGET = target()
BOARD = BoardRectangle.through_touched_points(PLACES, TARGET)
PREDICTION = LinePredictor(T_F_S, TARGET, WINDOW, NOISE)


def planned(
    count: int = 12,
    T_f_s: Array = T_F_S,
    target: PlaneTarget = TARGET,
    reachable: ReachabilityCheck = lambda _: True,
) -> Array:
    """One suggestion after the other, none twice."""
    prediction = LinePredictor(T_f_s, target, WINDOW, NOISE)
    left = list(prediction.candidate_poses(BOARD, CandidatePoseGrid()))
    taken: list[Array] = []
    for _ in range(count):
        said = prediction.most_informative_pose(left, taken, reachable)
        taken.append(said.T_b_f)
        left = [T for T in left if not np.array_equal(T, said.T_b_f)]
    return np.stack(taken)


@given(tilts=st.tuples(st.floats(-50, 50), st.floats(-50, 50)), depth=st.floats(0.15, 0.33))
@settings(max_examples=40, deadline=None)
def test_the_foreseen_line_is_the_line_that_is_seen(
    tilts: tuple[float, float], depth: float
) -> None:
    T_b_f = looking(*tilts, depth=depth)
    profile = EXACT_HAND.profile(T_b_f, np.random.default_rng(0))
    plane_s = transform_plane(inverse_pose(T_b_f @ T_F_S), PLANE)
    seen = visible_lines_on_plane(WINDOW, plane_s.u[None], np.array((plane_s.u0,)))
    count = int(profile.valid.sum())
    assert seen.columns[0] == pytest.approx(count, abs=2)
    if count > 2:
        ends = profile.points_s[[0, -1]]
        # The last column may lie a column's width inside the window.
        np.testing.assert_allclose(seen.ends_s[0], ends, atol=1e-3)
    else:
        assert seen.span[0] < 1e-3


def test_suggested_poses_keep_the_whole_line_on_the_board_and_in_range() -> None:
    for T_b_f in planned():
        profile = EXACT_HAND.profile(T_b_f, np.random.default_rng(0))
        points = transform_points(T_b_f @ T_F_S, profile.points_s)
        assert BOARD.contains_points(points).all()
        assert np.ptp(profile.points_s[:, 0]) > 0.03


def test_suggested_poses_beat_a_circle() -> None:
    mine = PREDICTION.uncertainty(planned())
    ring = PREDICTION.uncertainty(circle(30))
    assert mine.position < ring.position
    assert mine.rotation < ring.rotation


def test_suggested_poses_are_well_conditioned_also_when_the_mount_is_known_roughly() -> None:
    T_guess = T_F_S.copy()
    T_guess[:3, 3] += (0.005, -0.004, 0.006)
    poses = planned(T_f_s=T_guess)
    taken = samples(poses, shots(poses, EXACT_HAND, np.random.default_rng(0)))
    lines = stack_lines(poses, [s.fit for s in taken])
    T_f_s = solve_closed_form(lines, PLANE).T_f_s
    np.testing.assert_allclose(T_f_s, T_F_S, atol=1e-9)
    assert rotation_condition(rotation_equations(lines, PLANE.u)) < 20


def test_with_an_unknown_plane_suggested_poses_vary_their_tilts() -> None:
    unknown = PlaneTarget.from_unknown_plane(PLANE, CENTRE)
    poses = planned(target=unknown)
    taken = samples(poses, shots(poses, HAND, np.random.default_rng(0)))
    assert calibrate_on_plane(taken, None, NOISE).uncertainty.position < 0.5e-3


def test_what_is_expected_is_what_calibration_then_claims() -> None:
    rng = np.random.default_rng(0)
    poses = planned()
    foreseen = PREDICTION.uncertainty(poses)
    result = calibrate_on_plane(samples(poses, shots(poses, HAND, rng)), target(rng), NOISE)
    assert result.uncertainty.position == pytest.approx(foreseen.position, rel=0.05)
    assert result.uncertainty.rotation == pytest.approx(foreseen.rotation, rel=0.05)


def test_uncertainty_shrinks_with_every_line_from_the_first() -> None:
    poses = planned()
    course = [PREDICTION.uncertainty(poses[:k]) for k in range(13)]
    assert (np.diff([u.position for u in course]) < 0).all()
    assert (np.diff([u.rotation for u in course]) < 0).all()
    assert course[0].position == pytest.approx(0.05 * np.sqrt(3))


def test_only_reachable_poses_are_chosen_and_few_are_asked_about() -> None:
    asked: list[Array] = []

    def reachable(T_b_f: Array) -> bool:
        asked.append(T_b_f)
        return bool(T_b_f[1, 3] > 0.1)

    poses = planned(reachable=reachable)
    assert (poses[:, 1, 3] > 0.1).all()
    assert len(asked) < len(PREDICTION.candidate_poses(BOARD, CandidatePoseGrid()))


def test_too_small_a_reach_is_refused() -> None:
    with pytest.raises(CalibrationRefused, match=r"none of [1-9][0-9]+ candidates"):
        planned(reachable=lambda _: False)
    tiny = BoardRectangle(BOARD.centre_b, BOARD.axes_b, np.array((0.02, 0.02)))
    assert len(PREDICTION.candidate_poses(tiny, CandidatePoseGrid())) == 0


def test_the_suggested_pose_is_the_one_that_helps_most() -> None:
    taken = list(circle(15, 6))
    candidates = list(PREDICTION.candidate_poses(BOARD, CandidatePoseGrid()))[::7]
    said = PREDICTION.most_informative_pose(candidates, taken)
    assert said.after.position < said.before.position

    def volume(T_b_f: Array) -> float:
        poses = np.stack([*taken, T_b_f])
        covariance = PREDICTION.uncertainty(poses).covariance
        return float(np.linalg.slogdet(covariance)[1])

    assert volume(said.T_b_f) == pytest.approx(min(volume(T) for T in candidates), abs=1e-6)


def test_the_suggested_pose_makes_up_for_the_missing_tilt() -> None:
    taken = [looking(a, 0) for a in np.linspace(-30, 30, 8)]  # about x_s only
    candidates = [looking(25, 0), looking(-25, 0), looking(0, 25), looking()]
    said = PREDICTION.most_informative_pose(candidates, taken)
    np.testing.assert_array_equal(said.T_b_f, candidates[2])


def test_a_suggestion_needs_candidates_that_see_the_board() -> None:
    away = looking(depth=1.0)
    for candidates in ([], [away]):
        with pytest.raises(CalibrationRefused, match="no pose to suggest"):
            PREDICTION.most_informative_pose(candidates, [])
    assert PREDICTION.predict_lines(away[None]).information.max() == 0
