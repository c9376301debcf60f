"""Words of URScript that move the arm: to a target, along a blended path, by speeds, by servo."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import sqrt
from typing import Any, Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.errors import PoseUnreachable
from tjscan.core.frames import Array, inverse_pose
from tjscan_loopback.ur.motion import (
    Motion,
    StretchedMotion,
    joint_motion,
    path_motion,
    tool_jacobian,
)
from tjscan_loopback.ur.tool_path import (
    ToolPath,
    arc_path,
    blended_path,
    line_path,
    shortened_line,
)
from tjscan_loopback.ur.urscript.host import ScriptHost, SpeedDrive
from tjscan_loopback.ur.urscript.tokens import ScriptError
from tjscan_loopback.ur.urscript.values import Pose, finite, pose_matrix, six

SLOWEST_STOP: Final = 10.0
"""Seconds that coming to rest may take, however softly it is asked for."""

SPEED_TOLERANCE: Final = 1e-6
"""m/s or rad/s between a speed that is asked for and one that is."""


SERVO_GAIN: Final = 300
"""The gain of servoing that is usual."""

SERVO_DEAD_TIME: Final = 0.005
"""Seconds until the joints learn of a target, an assumption."""

SUDDEN_STOP: Final = 60.0
"""rad/s² of a joint that the safety system takes for a collision, an assumption."""

SAME_ANGLE: Final = 1e-9
"""Radians: joints that turned further were moved otherwise meanwhile."""


class Servo:
    """Servoing: a dead time, then two equal lags in a row.

    Parameters
    ----------
    q : ndarray, shape (6,)
        Where it begins, at rest, in radians.
    dead_ticks : int
        Ticks until a target has an effect.
    """

    def __init__(self, q: Array, dead_ticks: int) -> None:
        self.q, self._smoothed, self.speed = q, q, np.zeros_like(q)
        self._goals = deque([q] * dead_ticks, maxlen=dead_ticks + 1)

    def advance(self, goal: Array, lag: float, dt: float) -> float:
        """Go on for some seconds; returns the largest acceleration of a joint, rad/s²."""
        self._goals.append(goal)
        share = -np.expm1(-2 * dt / lag)
        self._smoothed = self._smoothed + share * (self._goals[0] - self._smoothed)
        step = share * (self._smoothed - self.q)
        self.q, before, self.speed = self.q + step, self.speed, step / dt
        return float(np.abs(self.speed - before).max() / dt)


class MotionWords:
    """The words that move the arm of a controller.

    Parameters
    ----------
    host : ScriptHost
        The controller.
    current_thread : callable
        Gives the number of the thread that runs.
    """

    def __init__(self, host: ScriptHost, current_thread: Callable[[], int]) -> None:
        self._host, self._thread = host, current_thread
        self._owner = 0
        self._target = self._tool
        self._corner: Array | None = None  # of the blend that the arm is about to pass
        self._radius = 0.0
        self._servo: Servo | None = None

    def words(self) -> dict[str, Callable[..., Any]]:
        """Words by name."""
        return {
            word.__name__: word
            for word in (
                *(self.movej, self.movel, self.movep, self.movec, self.stopj, self.stopl),
                *(self.speedj, self.speedl, self.servoj, self.servoc, self.get_target_waypoint),
            )
        }

    def thread_ended(self, number: int) -> None:
        """Let go of the arm if the thread that ended moved it."""
        if number == self._owner:
            self._host.let_go()

    # To a target

    def movej(
        self, target: Any, a: Any = 1.4, v: Any = 1.05, t: Any = 0, r: Any = 0
    ) -> Iterator[None]:
        """Move all joints in proportion; a blend is not made, it comes to rest."""
        goal, host = self._joints(target), self._host
        finite(r, "r")
        motion = joint_motion(host.kinematics, host.q, goal, _rate(v, "v"), _rate(a, "a"))
        yield from self._follow(_in_time(motion, t), host.kinematics.forward(goal) @ self._T_f_tcp)

    def movel(
        self, target: Any, a: Any = 1.2, v: Any = 0.25, t: Any = 0, r: Any = 0
    ) -> Iterator[None]:
        """Move the tool on a straight line; with a blend radius on into the next move."""
        yield from self._along(self._tool_pose(target), a, v, t, r)

    def movep(self, target: Any, a: Any = 1.2, v: Any = 0.25, r: Any = 0) -> Iterator[None]:
        """Move the tool on a straight line at an even speed, as processes want it."""
        yield from self._along(self._tool_pose(target), a, v, 0, r)

    def movec(
        self, via: Any, to: Any, a: Any = 1.2, v: Any = 0.25, r: Any = 0, mode: Any = 0
    ) -> Iterator[None]:
        """Move the tool on an arc through a point; it always comes to rest at its end."""
        finite(r, "r"), finite(mode, "mode")
        end = self._tool_pose(to)
        path = arc_path(self._tool, self._tool_pose(via)[:3, 3], end)
        yield from self._follow(self._motion(path, a, v, 0.0), end)

    def stopj(self, a: Any = 2.0) -> Iterator[None]:
        """Bring all joints to rest."""
        yield from self._rest(float(np.abs(self._host.speed).max()) / _rate(a, "a"))

    def stopl(self, a: Any = 1.2, aRot: Any = None) -> Iterator[None]:
        """Bring the tool to rest, the joints in proportion: nearly on its line."""
        speed, turn = np.split(self._jacobian(self._host.q) @ self._host.speed, 2)
        a_turn = _rate(a if aRot is None else aRot, "aRot")
        times = np.linalg.norm(speed) / _rate(a, "a"), np.linalg.norm(turn) / a_turn
        yield from self._rest(float(max(times)))

    def get_target_waypoint(self) -> Pose:
        """Pose that the last move went to."""
        return Pose(pose_vector.pose_to_vector(self._target).tolist())

    # By speeds and by servo: until another command

    def speedj(self, qd: Any, a: Any, t: Any = 0) -> Iterator[None]:
        """Turn the joints with these speeds; for a time, or until they are reached."""
        wanted, a = six(qd, "qd"), _rate(a, "a")

        def speeds(dt: float, q: Array, now: Array) -> Array:
            return _ramped(now, wanted, a * dt)

        yield from self._drive(speeds, _time(t), lambda: self._host.speed - wanted)

    def speedl(self, xd: Any, a: Any, t: Any = 0, aRot: Any = 0) -> Iterator[None]:
        """Move the tool with this velocity; for a time, or until it is reached."""
        wanted, a = six(xd, "xd"), _rate(a, "a")
        finite(aRot, "aRot")

        def speeds(dt: float, q: Array, now: Array) -> Array:
            J = self._jacobian(q)
            return self._solved(J, _ramped(J @ now, wanted, a * dt))

        yield from self._drive(
            speeds, _time(t), lambda: self._jacobian(self._host.q) @ self._host.speed - wanted
        )

    def servoj(
        self,
        q: Any,
        a: Any = 0,
        v: Any = 0,
        t: Any = 0.002,
        lookahead_time: Any = 0.1,
        gain: Any = 300,
    ) -> Iterator[None]:
        """Follow joint angles that are commanded again and again, with dead time and lag.

        The lag is the look-ahead time at a gain of 300, less at a higher one: an assumption.
        """
        goal, lookahead = six(q, "q"), _rate(lookahead_time, "lookahead_time")
        lag = lookahead * SERVO_GAIN / _rate(gain, "gain")
        finite(a, "a"), finite(v, "v")
        host, fastest = self._host, self._host.kinematics.velocity
        servo = self._servo
        if servo is None or np.abs(servo.q - host.q).max() > SAME_ANGLE:
            servo = Servo(host.q, round(SERVO_DEAD_TIME / host.tick))

        def speeds(dt: float, q: Array, now: Array) -> Array:
            if servo.advance(goal, lag, dt) > SUDDEN_STOP:
                host.protective_stop("C204A3: sudden stop")
            return np.clip(servo.speed, -fastest, fastest)

        self._owner, self._corner = self._thread(), None
        host.servo(speeds, goal)
        yield from self._wait(max(_time(t), host.tick), None)
        self._servo = servo

    def servoc(self, target: Any, a: Any = 1.2, v: Any = 0.25, r: Any = 0) -> Iterator[None]:
        """Follow poses that are commanded again and again, on straight lines."""
        T, a, v = self._tool_pose(target), _rate(a, "a"), _rate(v, "v")
        finite(r, "r")

        def speeds(dt: float, q: Array, now: Array) -> Array:
            J = self._jacobian(q)
            away = pose_vector.boxminus(T, self._host.kinematics.forward(q) @ self._T_f_tcp)
            distance = float(np.linalg.norm(away[:3]))
            pace = min(v, float(np.linalg.norm((J @ now)[:3])) + a * dt, sqrt(2 * a * distance))
            time = max(distance / pace if pace > 0 else dt, dt)
            return self._solved(J, away / time)

        yield from self._drive(speeds, self._host.tick, None)

    # How

    @property
    def _T_f_tcp(self) -> Array:
        return pose_vector.pose_from_vector(self._host.tcp)

    @property
    def _tool(self) -> Array:
        return np.asarray(self._host.kinematics.forward(self._host.q) @ self._T_f_tcp)

    def _joints(self, target: Any) -> Array:
        kinematics = self._host.kinematics
        if isinstance(target, Pose):
            T_b_f = pose_matrix(target, "the target") @ inverse_pose(self._T_f_tcp)
            with _explained():
                return kinematics.inverse(T_b_f, self._host.q)
        q = six(target, "the target")
        if np.any((q < kinematics.lower) | (q > kinematics.upper)):
            raise ScriptError("the target is beyond a joint's limit")
        return q

    def _tool_pose(self, target: Any) -> Array:
        if isinstance(target, Pose):
            return pose_matrix(target, "the target")
        return np.asarray(self._host.kinematics.forward(six(target, "the target")) @ self._T_f_tcp)

    def _along(self, goal: Array, a: Any, v: Any, t: Any, r: Any) -> Iterator[None]:
        """Move on a line to a pose, out of the blend that the last move left the arm in."""
        radius, start, corner = finite(r, "r", least=-1e-12), self._tool, self._corner
        begin = start if corner is None else corner
        end = goal if radius == 0 else shortened_line(begin, goal, radius)
        if corner is None:
            path = line_path(start, end)
        else:
            path = blended_path(start, corner[:3, 3], end, self._radius)
        motion = self._motion(path, a, v, 0.0 if radius == 0 else _rate(v, "v"))
        yield from self._follow(_in_time(motion, t), goal)
        self._corner, self._radius = (None if radius == 0 else goal), radius

    def _motion(self, path: ToolPath, a: Any, v: Any, end_speed: float) -> Motion:
        speed = _rate(v, "v")
        first = 0.0
        if self._corner is not None:
            first = float(np.linalg.norm((self._jacobian(self._host.q) @ self._host.speed)[:3]))
        with _explained():
            return path_motion(
                self._host.kinematics,
                self._host.q,
                path,
                self._T_f_tcp,
                (first, speed, end_speed),
                _rate(a, "a"),
            )

    def _follow(self, motion: Motion, goal: Array) -> Iterator[None]:
        self._target = goal
        self._owner, self._corner = self._thread(), None
        self._host.begin_motion(motion)
        while self._host.moving:
            yield

    def _rest(self, duration: float) -> Iterator[None]:
        self._owner, self._corner = self._thread(), None
        self._host.come_to_rest(min(duration, SLOWEST_STOP))
        while self._host.moving:
            yield

    def _drive(
        self, speeds: SpeedDrive, time: float, away: Callable[[], Array] | None
    ) -> Iterator[None]:
        """Drive the joints for a time, or where that is zero until a speed is reached."""
        self._owner, self._corner = self._thread(), None
        self._host.drive(speeds)
        yield from self._wait(time, away)

    def _wait(self, time: float, away: Callable[[], Array] | None) -> Iterator[None]:
        """Wait for a time, which the speed slider stretches, or until a speed is reached."""
        passed = 0.0
        while True:
            yield
            passed += self._host.tick * self._host.speed_fraction
            is_over = time > 0 and passed >= time - 1e-9
            if is_over or (
                time == 0 and away is not None and np.abs(away()).max() < SPEED_TOLERANCE
            ):
                self._host.let_go()  # unless the next word takes over in this tick
                return

    def _jacobian(self, q: Array) -> Array:
        return tool_jacobian(self._host.kinematics, q, self._T_f_tcp)

    def _solved(self, J: Array, velocity: Array) -> Array:
        """Joint speeds for a velocity of the tool; a protective stop where they are too high."""
        try:
            speeds = np.linalg.solve(J, velocity)
        except np.linalg.LinAlgError:
            speeds = np.full(6, np.inf)
        if np.any(np.abs(speeds) > self._host.kinematics.velocity):
            self._host.protective_stop("a joint would turn too fast")
            return np.zeros(6)
        return np.asarray(speeds)


@contextmanager
def _explained() -> Iterator[None]:
    """Let an error of the kinematics end the program."""
    try:
        yield
    except PoseUnreachable as error:
        raise ScriptError(f"the target can't be reached: {error.reason}") from None


def _rate(value: Any, name: str) -> float:
    return finite(value, name, least=0.0)


def _time(value: Any) -> float:
    return finite(value, "t", least=-1e-12)


def _in_time(motion: Motion, t: Any) -> Motion:
    time = _time(t)
    return StretchedMotion(motion, time) if time > 0 and motion.duration > 0 else motion


def _ramped(now: Array, wanted: Array, step: float) -> Array:
    """A speed that comes nearer to another by a step at most, all of its axes in proportion."""
    away = wanted - now
    farthest = float(np.abs(away).max())
    return np.asarray(wanted if farthest <= step else now + step / farthest * away)
