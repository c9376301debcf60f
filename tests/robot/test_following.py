"""Laws of a path that grows: it joins, it ends at rest, it keeps the limits, it comes late."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tjscan.core.errors import ArmFault, ConfigurationError, PathNotExtended
from tjscan.core.frames import Array
from tjscan.robot.following import GUARD_TIME, JointMotion, check_can_follow
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan.robot.replay import ReplayedArm
from tjscan.robot.simulated import SimulatedArm
from tjscan.robot.simulated_following import CONTROLLER_TICK, WanderingError
from tjscan.robot.time_optimal import PathTiming, joint_motion

HOME = np.radians([-110.0, -95.0, 160.0, 105.0, -110.0, 0.0])
SPEED = 0.07
TOLERANCE = 1.02
"""By which a set-point may exceed a limit."""


@cache
def arm() -> Kinematics:
    return Kinematics.load("ur10e")


def winding_path(scale: float = 1.0) -> tuple[Array, Array]:
    """Lengths and joint angles of a path as a seam asks for it."""
    lengths = np.arange(0.0, 0.141, 0.004)
    turn = np.radians([1.0, 0.5, -0.8, 1.0, 0.6, 1.5]) * 300 * scale
    wave = 0.02 * np.sin(lengths[:, None] * 30 + np.arange(6))
    return lengths, HOME + lengths[:, None] * turn + scale * (wave - wave[0])


def timed(
    start_speed: float = 0.0, scale: float = 1.0, limits: MotionLimits | None = None
) -> JointMotion:
    lengths, q = winding_path(scale)
    path = CubicSpline(lengths, q)
    gone = PathTiming(arm(), limits or MotionLimits(), SPEED).fastest(path, start_speed, 1.0)
    assert gone is not None
    return joint_motion(path, gone)


@pytest.mark.parametrize("start_speed", [0.0, 0.03, 0.05])
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("tcp_acceleration", [1.2, 0.1])
def test_a_motion_keeps_every_limit_at_every_tick(
    start_speed: float, scale: float, tcp_acceleration: float
) -> None:
    limits = MotionLimits(tcp_acceleration=tcp_acceleration)
    motion = timed(start_speed if scale < 2 else 0.0, scale, limits)
    ticks = np.arange(1.0, motion.end, CONTROLLER_TICK)
    q, _ = motion.at(ticks)
    points = np.array([arm().forward(one)[:3, 3] for one in q])
    speed, point_speed = (np.diff(v, axis=0) / CONTROLLER_TICK for v in (q, points))
    quick, point_quick = (np.diff(v, axis=0) / CONTROLLER_TICK for v in (speed, point_speed))
    assert (np.abs(speed) <= TOLERANCE * limits.joint_speed * arm().velocity).all()
    assert np.abs(quick).max() <= TOLERANCE * limits.joint_acceleration
    assert np.linalg.norm(point_speed, axis=1).max() <= TOLERANCE * limits.tcp_speed
    assert np.linalg.norm(point_quick, axis=1).max() <= TOLERANCE * limits.tcp_acceleration


def test_some_limit_is_reached() -> None:
    lengths, q = winding_path()
    path = CubicSpline(lengths, q)
    gone = PathTiming(arm(), MotionLimits(), SPEED).fastest(path, 0.0, 0.0)
    assert gone is not None
    points = np.array([arm().forward(one)[:3, 3] for one in path(gone.lengths)])
    tool = np.linalg.norm(np.diff(points, axis=0), axis=1) / np.diff(gone.times)
    assert gone.speeds.max() == pytest.approx(SPEED, rel=1e-3) or tool.max() > 0.85 * 0.25


def test_where_no_stop_is_possible_there_is_no_motion() -> None:
    lengths, q = winding_path()
    path = CubicSpline(lengths[:5], q[:5])
    assert PathTiming(arm(), MotionLimits(), 0.5).fastest(path, 0.4, 0.0) is None


def test_a_later_motion_takes_over_without_a_jump() -> None:
    motion = timed()
    start = 1.0 + 0.5 * (motion.end - 1.0)
    times = np.append(start, motion.times[motion.times > start])
    q, speed = motion.at(times)
    speed[-1] = 0.0
    joined = motion.replaced_by(JointMotion(times, q, speed), start - 2 * GUARD_TIME)
    ticks = np.arange(1.0, motion.end, CONTROLLER_TICK)
    np.testing.assert_allclose(joined.at(ticks)[0], motion.at(ticks)[0], atol=2e-5)


def test_a_motion_that_comes_late_or_begins_elsewhere_replaces_nothing() -> None:
    motion = timed()
    start = 1.0 + 0.5 * (motion.end - 1.0)
    q, _ = motion.at(start)
    rest = JointMotion.at_rest(q, start)
    with pytest.raises(PathNotExtended, match="too late"):
        motion.replaced_by(rest, start)
    with pytest.raises(PathNotExtended, match="beside the one before"):
        motion.replaced_by(rest, start - 1.0)  # from full speed to rest at once


def test_a_motion_ends_at_rest_and_its_times_rise() -> None:
    q, speed = np.zeros((2, 6)), np.ones((2, 6))
    with pytest.raises(ValueError, match="at rest"):
        JointMotion(np.array((0.0, 1.0)), q, speed)
    with pytest.raises(ValueError, match="rise"):
        JointMotion(np.zeros(2), q, 0 * speed)


def test_the_simulated_arm_follows_late_by_its_lag_and_arrives() -> None:
    motion = timed()
    with SimulatedArm(arm(), HOME, time=1.0 - 2 * GUARD_TIME) as simulated:
        simulated.lag = 0.05
        with simulated.follow() as following:
            following.replace(motion)
            simulated.pass_time(motion.end - simulated.state().time)
            states = following.states()
            simulated.pass_time(0.5)
        times = np.array([state.time for state in states])
        cruising = (times > 1.5) & (times < motion.end - 0.7)
        late = np.array([state.q for state in states])[cruising]
        on_time, _ = motion.at(times[cruising] - 0.05)
        assert np.abs(late - on_time).max() < np.radians(0.1)
        np.testing.assert_allclose(simulated.state().q, motion.q[-1], atol=1e-6)


def test_an_arm_that_is_stopped_follows_no_further() -> None:
    motion = timed()
    simulated = SimulatedArm(arm(), HOME, time=1.0 - 2 * GUARD_TIME)
    with simulated, simulated.follow() as following:
        following.replace(motion)
        simulated.pass_time(1.0)
        simulated.stop()
        before = simulated.state().q
        simulated.pass_time(0.5)
        np.testing.assert_array_equal(simulated.state().q, before)
        with pytest.raises(ArmFault, match="stopped"):
            following.states()


def test_the_error_of_a_moving_arm_is_as_large_as_at_rest_and_correlates_as_stated() -> None:
    spread, step, correlation = np.full(400, 2.0), 0.05, 0.5
    random = np.random.default_rng(1)
    error = WanderingError(spread * random.standard_normal(400), spread, correlation, random)
    values = []
    for _ in range(60):
        error.advance(step)
        values.append(error.now.copy())
    rows = np.array(values)
    assert rows.std() == pytest.approx(2.0, rel=0.05)
    for lag in (1, 5, 20):
        t = lag * step / correlation
        found = float(np.mean(rows[lag:] * rows[:-lag]) / np.mean(rows**2))
        assert found == pytest.approx((1 + t) * np.exp(-t), abs=0.06)


def test_an_arm_that_cannot_follow_is_refused_by_name() -> None:
    with pytest.raises(ConfigurationError, match="can't follow"):
        check_can_follow(ReplayedArm.__new__(ReplayedArm))
