"""Paths and their timing: limits kept, straight lines straight, refusals before motion."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.errors import ConfigurationError, PoseUnreachable
from tjscan.core.frames import Array, pose, rot_x, rot_y, rot_z, rotation_angle_between
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import JointTrajectory, MotionLimits, PathPlanner

WELL = np.radians([10, -80, 100, -60, -80, 20])
LIMITS = MotionLimits()

SAMPLED = 1.01
"""Differences over a thousandth of the duration stay within a percent of the derivative."""

SHORTEST = 1e-3
"""Seconds: second differences of a move shorter than that drown in rounding."""

STRAY = 5e-6
"""Metres the spline between waypoints may leave the line: a tenth of an arm's repeatability."""

shifts = st.lists(st.floats(-0.12, 0.12), min_size=3, max_size=3).map(np.array)
turns = st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3)
limits = st.builds(
    MotionLimits,
    tcp_speed=st.floats(0.02, 1.0),
    tcp_acceleration=st.floats(0.1, 5.0),
    joint_speed=st.floats(0.02, 0.5),
    joint_acceleration=st.floats(0.1, 5.0),
)


@cache
def arm() -> Kinematics:
    return Kinematics.load("ur10e")


def moved(shift: Array, turn: list[float]) -> Array:
    T_b_f = arm().forward(WELL)
    R = T_b_f[:3, :3] @ rot_x(turn[0]) @ rot_y(turn[1]) @ rot_z(turn[2])
    return pose(R, T_b_f[:3, 3] + shift)


def assert_within(path: JointTrajectory, limits: MotionLimits) -> None:
    """Differentiate the sampled path and compare with the limits."""
    if path.duration < SHORTEST:
        return
    t = np.linspace(0, path.duration, 1001)
    q = path.joint_angles_at(t)
    points_b = np.array([arm().forward(angles)[:3, 3] for angles in q])
    h = t[1]
    speed, tcp_speed = np.diff(q, axis=0) / h, np.diff(points_b, axis=0) / h
    assert (np.abs(speed) <= SAMPLED * limits.joint_speed * arm().velocity).all()
    assert np.linalg.norm(tcp_speed, axis=1).max() <= SAMPLED * limits.tcp_speed
    assert np.abs(np.diff(speed, axis=0)).max() / h <= SAMPLED * limits.joint_acceleration
    acceleration = np.linalg.norm(np.diff(tcp_speed, axis=0), axis=1).max() / h
    assert acceleration <= SAMPLED * limits.tcp_acceleration


@given(shift=shifts, turn=turns, limits=limits)
@settings(max_examples=25, deadline=None)
def test_a_linear_path_keeps_every_limit(
    shift: Array, turn: list[float], limits: MotionLimits
) -> None:
    assert_within(PathPlanner(arm(), limits).linear_path(WELL, moved(shift, turn)), limits)


@given(step=st.lists(st.floats(-1.5, 1.5), min_size=6, max_size=6), limits=limits)
@settings(max_examples=25, deadline=None)
def test_a_joint_path_keeps_every_limit(step: list[float], limits: MotionLimits) -> None:
    assert_within(PathPlanner(arm(), limits).path_to_joint_angles(WELL, WELL + step), limits)


@given(shift=shifts, turn=turns, limits=limits)
@settings(max_examples=25, deadline=None)
def test_doubling_a_limit_never_lengthens_a_move(
    shift: Array, turn: list[float], limits: MotionLimits
) -> None:
    T_b_f = moved(shift, turn)
    duration = PathPlanner(arm(), limits).linear_path(WELL, T_b_f).duration
    for name in ("tcp_speed", "tcp_acceleration", "joint_speed", "joint_acceleration"):
        more = replace(limits, **{name: 2 * getattr(limits, name)})
        assert PathPlanner(arm(), more).linear_path(WELL, T_b_f).duration <= duration * (1 + 1e-12)


@given(shift=shifts, turn=turns, factor=st.floats(1, 10))
@settings(max_examples=25, deadline=None)
def test_time_scales(shift: Array, turn: list[float], factor: float) -> None:
    # The same path at speeds smaller by a factor, accelerations by its square.
    slow = MotionLimits(
        LIMITS.tcp_speed / factor,
        LIMITS.tcp_acceleration / factor**2,
        LIMITS.joint_speed / factor,
        LIMITS.joint_acceleration / factor**2,
    )
    quick = PathPlanner(arm(), LIMITS).linear_path(WELL, moved(shift, turn))
    scaled = PathPlanner(arm(), slow).linear_path(WELL, moved(shift, turn))
    assert scaled.duration == pytest.approx(factor * quick.duration, rel=1e-9)
    np.testing.assert_allclose(
        scaled.joint_angles_at(factor * quick.duration / 3),
        quick.joint_angles_at(quick.duration / 3),
        rtol=0,
        atol=1e-9,
    )


@given(shift=shifts, turn=turns)
@settings(max_examples=25, deadline=None)
def test_the_flange_stays_on_the_line_and_arrives(shift: Array, turn: list[float]) -> None:
    start, end = arm().forward(WELL), moved(shift, turn)
    path = PathPlanner(arm(), LIMITS).linear_path(WELL, end)
    poses = [arm().forward(q) for q in path.joint_angles_at(np.linspace(0, path.duration, 50))]
    np.testing.assert_allclose(poses[0], start, rtol=0, atol=1e-9)
    np.testing.assert_allclose(poses[-1], end, rtol=0, atol=5e-9)
    length = np.linalg.norm(shift)
    along = shift / length if length > 0 else np.zeros(3)
    total = rotation_angle_between(start, end)
    for T in poses:
        way = T[:3, 3] - start[:3, 3]
        assert np.linalg.norm(way - (way @ along) * along) < STRAY
        # It turns about one axis: what is behind and what is ahead add up.
        assert rotation_angle_between(start, T) + rotation_angle_between(T, end) == pytest.approx(
            total, abs=1e-4
        )


def test_a_trapezoid_of_known_duration() -> None:
    # One joint by 1 rad at 0.5 rad/s and 1 rad/s²: 2 s of way and 0.5 s of ramp.
    limits = MotionLimits(10.0, 10.0, 0.5 / float(arm().velocity[5]), 1.0)
    path = PathPlanner(arm(), limits).path_to_joint_angles(WELL, WELL + np.eye(6)[5])
    assert path.duration == pytest.approx(2.5, rel=1e-9)
    assert path.ramp == pytest.approx(0.5, rel=1e-9)
    assert path.joint_angles_at(0.5)[5] - WELL[5] == pytest.approx(0.125, abs=1e-9)
    assert path.joint_angles_at(1.25)[5] - WELL[5] == pytest.approx(0.5, abs=1e-9)


def test_a_short_move_never_cruises() -> None:
    # By 0.04 rad at 1 rad/s²: up in 0.2 s, down in 0.2 s.
    limits = MotionLimits(10.0, 10.0, 0.5, 1.0)
    path = PathPlanner(arm(), limits).path_to_joint_angles(WELL, WELL + 0.04 * np.eye(6)[5])
    assert path.duration == pytest.approx(0.4, rel=1e-9)
    assert path.ramp == pytest.approx(0.2, rel=1e-9)


def test_no_way_takes_no_time() -> None:
    for path in (
        PathPlanner(arm(), LIMITS).path_to_joint_angles(WELL, WELL),
        PathPlanner(arm(), LIMITS).linear_path(WELL, arm().forward(WELL)),
    ):
        assert path.duration == pytest.approx(0, abs=1e-3)
        np.testing.assert_allclose(
            path.joint_angles_at(np.array([0.0, 1.0])), [WELL, WELL], atol=1e-8
        )


def test_waypoints_are_close_and_can_not_be_written_to() -> None:
    path = PathPlanner(arm(), LIMITS).linear_path(WELL, moved(np.array([0.04, 0, 0]), [0, 0, 0]))
    points_b = [arm().forward(q)[:3, 3] for q in path.q]
    assert max(np.linalg.norm(b - a) for a, b in pairwise(points_b)) <= 5e-3 + 1e-8
    with pytest.raises(ValueError, match="read-only"):
        path.q[0] = 0


def test_a_line_out_of_reach_says_how_far_it_gets() -> None:
    T_b_f = moved(np.array([2.0, 0, 0]), [0, 0, 0])
    with pytest.raises(PoseUnreachable, match=r"\d+% of the way there, .*reach") as caught:
        PathPlanner(arm(), LIMITS).linear_path(WELL, T_b_f)
    np.testing.assert_array_equal(caught.value.T_b_f, T_b_f)


def test_a_line_through_a_singular_wrist_is_refused() -> None:
    # Turning the flange through the pose in which axes 4 and 6 align, a hair beside it.
    q = WELL.copy()
    q[4] = 0.3
    beyond = WELL.copy()
    beyond[4] = -0.3
    beyond[3] += 0.02
    start, end = arm().forward(q), arm().forward(beyond)
    assert rotation_angle_between(start, end) < 0.7
    with pytest.raises(PoseUnreachable, match="near a singularity"):
        PathPlanner(arm(), LIMITS).linear_path(q, end)


def test_a_joint_that_runs_into_its_limit_is_named() -> None:
    q = WELL.copy()
    q[5] = np.radians(358)
    T_b_f = arm().forward(q + np.radians([0, 0, 0, 0, 0, 10]))
    with pytest.raises(PoseUnreachable, match=r"wrist_3_joint runs into its limit"):
        PathPlanner(arm(), LIMITS).linear_path(q, T_b_f)


def test_a_line_beyond_a_narrow_limit_is_refused(tmp_path: Path) -> None:
    whole = 'lower="-6.283185307179586" upper="6.283185307179586"'
    file = tmp_path / "fenced.urdf"
    text = arm().urdf.read_text("utf-8")
    file.write_text(text.replace(whole, 'lower="-0.5" upper="0.5"'), encoding="utf-8")
    fenced = Kinematics.load(file)
    q = np.array([0.4, -0.4, 1, 0.4, 0.4, 0.4])
    T_b_f = fenced.forward(q + np.array([0.2, 0, 0, 0, 0, 0]))
    with pytest.raises(PoseUnreachable, match=r"shoulder_pan_joint .* beyond its limit"):
        PathPlanner(fenced, LIMITS).linear_path(q, T_b_f)


@pytest.mark.parametrize(
    "name", ["tcp_speed", "tcp_acceleration", "joint_speed", "joint_acceleration"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_limits_are_positive_numbers(name: str, value: float) -> None:
    changed: Any = {name: value}
    with pytest.raises(ConfigurationError, match=name):
        replace(MotionLimits(), **changed)


def test_joint_speed_is_a_fraction() -> None:
    with pytest.raises(ConfigurationError, match="at most 1"):
        MotionLimits(joint_speed=1.5)
