"""Following a path that grows: joint angles over time that an arm is given piece by piece.

An arm that follows never runs out of path in motion: what it was given always ends at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import field
from typing import Final, Protocol, runtime_checkable

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from tjscan.core.errors import ConfigurationError, PathNotExtended
from tjscan.core.frames import Array, array_dataclass
from tjscan.robot.arm import Arm, ArmState

GUARD_TIME: Final = 0.1
"""Seconds from now within which a path that an arm follows is not replaced any more: it may be on
its way through the controller."""

LARGEST_JOINING_ACCELERATION: Final = 0.03
"""Rad/s² by which a new path may be pulled onto the old one up to its second knot: two per cent of
what is usual. Encoders at rest differ from one reading to the next."""


@array_dataclass
class JointMotion:
    """Joint angles over time, at knots between which they run as cubics; at rest from the last on.

    Parameters
    ----------
    times : ndarray, shape (m,)
        Seconds on the arm's clock, rising.
    q, speed : ndarray, shape (m, n)
        Joint angles in radians and their derivatives by time.

    Raises
    ------
    ValueError
        If times do not rise, or the motion does not end at rest.
    """

    times: Array
    q: Array
    speed: Array
    _spline: CubicHermiteSpline | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if len(self.times) < 1 or (np.diff(self.times) <= 0).any():
            raise ValueError("the times of a motion's knots must rise")
        if self.speed[-1].any():
            raise ValueError("a motion must end at rest")
        if len(self.times) > 1:
            spline = CubicHermiteSpline(self.times, self.q, self.speed)
            object.__setattr__(self, "_spline", spline)

    @classmethod
    def at_rest(cls, q: Array, time: float) -> JointMotion:
        """No motion: joint angles, shape (n,), from a time on."""
        return cls(np.array([time]), q[None], np.zeros((1, len(q))))

    @property
    def end(self) -> float:
        """When it is at rest, seconds on the arm's clock."""
        return float(self.times[-1])

    def at(self, time: float | Array) -> tuple[Array, Array]:
        """Joint angles and their speeds, shape (..., n), at times in seconds."""
        if self._spline is None:
            shape = (*np.shape(time), self.q.shape[1])
            return np.broadcast_to(self.q[0], shape).copy(), np.zeros(shape)
        within = np.clip(time, self.times[0], self.times[-1])
        moves = np.asarray(within == time)[..., None]
        return self._spline(within), np.where(moves, self._spline(within, 1), 0.0)

    def replaced_by(self, later: JointMotion, now: float) -> JointMotion:
        """Join a later motion to this one: this up to where that begins, and that from there on.

        What it begins beside this one, it makes up for up to its second knot.

        Parameters
        ----------
        later : JointMotion
            Begins on this motion, not before `now` and the guard time.
        now : float
            Seconds on the arm's clock.

        Raises
        ------
        PathNotExtended
            If it begins too early, elsewhere, or with another speed: nothing is replaced.
        """
        start = float(later.times[0])
        if start < now + GUARD_TIME:
            raise PathNotExtended(
                f"a path to follow came {1e3 * (now + GUARD_TIME - start):.0f} ms too late to "
                "replace the one before, which is followed to its end"
            )
        q, speed = self.at(start)
        gap, jump = np.abs(later.q[0] - q).max(), np.abs(later.speed[0] - speed).max()
        piece = later.times[1] - start if len(later.times) > 1 else GUARD_TIME
        if 6 * gap / piece**2 + 4 * jump / piece > LARGEST_JOINING_ACCELERATION:
            raise PathNotExtended(
                f"a path to follow begins {np.degrees(gap):.3f} deg and {np.degrees(jump):.2f} "
                "deg/s beside the one before, which is followed to its end"
            )
        kept = self.times < start
        joined = (
            np.concatenate((mine[kept], new))
            for mine, new in zip(
                (self.times, self.q, self.speed),
                (later.times, np.vstack((q, later.q[1:])), later.speed),
                strict=True,
            )
        )
        return JointMotion(*joined)


class Following(Protocol):
    """An arm while it follows a path that grows."""

    @property
    def now(self) -> float:
        """Where it is on its paths, in their seconds: behind its clock, if it is slowed down."""

    @property
    def end(self) -> float:
        """When the motion that is followed ends; a controller may have refused the last one."""

    def replace(self, motion: JointMotion) -> None:
        """Follow another motion from where it begins, which is on the one before.

        Raises
        ------
        PoseUnreachable
            If it does not keep clear: the motion before is followed to its end.
        PathNotExtended
            If it comes too late or does not join the motion before, likewise.
        ArmFault
            If the arm stopped.
        """

    def states(self) -> Sequence[ArmState]:
        """States since the last call, in order: joint angles as they are, not as commanded.

        Raises
        ------
        ArmFault
            If the arm stopped.
        """


class FollowingThrough:
    """An arm that is followed through another one, see `Following`.

    Parameters
    ----------
    following : Following
        The arm that moves.
    check : callable, optional
        Refuses a motion before it is followed.
    correct : callable, optional
        Corrects a state.
    """

    def __init__(
        self,
        following: Following,
        check: Callable[[JointMotion], None] = lambda motion: None,
        correct: Callable[[ArmState], ArmState] = lambda state: state,
    ) -> None:
        self._following, self._check, self._correct = following, check, correct

    @property
    def now(self) -> float:
        """Where it is on its paths. See `Following.now`."""
        return self._following.now

    @property
    def end(self) -> float:
        """When the motion that is followed ends. See `Following.end`."""
        return self._following.end

    def replace(self, motion: JointMotion) -> None:
        """Follow another motion. See `Following.replace`."""
        self._check(motion)
        self._following.replace(motion)

    def states(self) -> Sequence[ArmState]:
        """States since the last call. See `Following.states`."""
        return [self._correct(state) for state in self._following.states()]


@runtime_checkable
class FollowingArm(Protocol):
    """An arm that can follow a path that grows."""

    def follow(self) -> AbstractContextManager[Following]:
        """Follow paths from where the arm is, at rest, while the block runs; stop at its end.

        Raises
        ------
        ArmFault
            If the arm moves already, or was stopped.
        """


@runtime_checkable
class ArmBeforeArm(Protocol):
    """An arm that passes its moves on to another one."""

    @property
    def moving_arm(self) -> Arm:
        """The other one."""


def check_can_follow(arm: object) -> FollowingArm:
    """Refuse an arm that can't follow paths, or that stands before one; nothing moves.

    Raises
    ------
    ConfigurationError
        If it can't.
    """
    if not isinstance(arm, FollowingArm):
        raise ConfigurationError(
            "this arm's driver can't follow a path that grows while it moves: set "
            'mode = "stepwise"',
            key="scan.mode",
        )
    if isinstance(arm, ArmBeforeArm):
        check_can_follow(arm.moving_arm)
    return arm
