"""An arm that stands where it once stood, and moves nothing."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Final, Self

import numpy as np

from tjscan.core.errors import ArmFault, LaserFault, ViewNotRecorded
from tjscan.core.frames import Array
from tjscan.robot.arm import ArmState

SAME: Final = 1e-6
"""Metres and radians: poses nearer to each other are one pose."""


class ReplayedArm:
    """The arm of a recording, behind the `Arm` protocol.

    It answers a move with the state that was recorded, so whoever asked goes on from where the
    arm truly stood. A recording is gone through forwards: a pose that was recorded exactly is
    sought first, then the first one ahead within the tolerance. What lies between is passed
    over, such as the second look at the section that a resumed scan went back to.

    Parameters
    ----------
    states : sequence of ArmState
        Where it stood at each view, in the order of the recording.
    distance : float
        How far from the pose asked for it may have stood, metres.
    angle : float
        How far it may have been turned from it, radians.
    """

    def __init__(self, states: Sequence[ArmState], *, distance: float, angle: float) -> None:
        self._states, self._distance, self._angle = tuple(states), distance, angle
        self._poses = np.array([state.T_b_f for state in states]).reshape(-1, 4, 4)
        self._at, self._taken, self._connected = -1, False, False

    def __enter__(self) -> Self:
        """Make ready; a recording without a view is no cell.

        Raises
        ------
        ArmFault
            If the recording is empty.
        """
        if not self._states:
            raise ArmFault("the recording holds no view, so there is nothing to replay")
        self._connected = True
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._connected = False

    def state(self) -> ArmState:
        """Where it stood at the view that was last asked for; at first, at the first one."""
        if not self._connected:
            raise ArmFault("the recording is not open: use it inside a 'with' block")
        return self._states[max(self._at, 0)]

    def check(self, *T_b_f: Array) -> None:
        """See that the recording holds these views, one after another.

        Raises
        ------
        ViewNotRecorded
            For the first that it does not hold.
        """
        at = self._at
        for T in T_b_f:
            at = self._find(T, at + 1)

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Stand where a view was recorded from.

        Raises
        ------
        ViewNotRecorded
            If none of those ahead was recorded from there.
        """
        self.state()  # open?
        self._at, self._taken = self._find(T_b_f, self._at + 1), False
        return self.state()

    def move_joint(self, T_b_f: Array, near: Array | None = None) -> ArmState:
        """Stand where a view was recorded from; see `move_linear`."""
        return self.move_linear(T_b_f)

    def stop(self) -> None:
        """Do nothing: it does not move."""

    def clear_stop(self) -> None:
        """Do nothing: it did not stop."""

    def take(self) -> int:
        """Number of the view taken now from where it stands.

        Raises
        ------
        LaserFault
            If no further view was taken from there.
        """
        self.state()
        if self._taken or self._at < 0:
            try:
                self._at = self._find(self.state().T_b_f, self._at + 1)
            except ViewNotRecorded as error:
                raise LaserFault(
                    f"the recording holds no further profile from there: {error.reason}"
                ) from None
        self._taken = True
        return self._at

    def _find(self, T_b_f: Array, start: int) -> int:
        """First view from `start` on that was recorded from a pose."""
        gaps = _gaps(self._poses[start:], T_b_f)
        for limits in ((SAME, SAME), (self._distance, self._angle)):
            near = np.flatnonzero((gaps <= limits).all(axis=1))
            if len(near):
                return start + int(near[0])
        raise ViewNotRecorded(_what_is_near(gaps), T_b_f)


def _gaps(poses: Array, T: Array) -> Array:
    """Metres and radians from each of many poses, shape (n, 4, 4), to one, shape (n, 2)."""
    apart = poses - T
    chord = np.linalg.norm(apart[:, :3, :3], axis=(1, 2)) / np.sqrt(8)  # sin(angle / 2)
    angle = 2 * np.arcsin(np.minimum(chord, 1.0))
    return np.column_stack((np.linalg.norm(apart[:, :3, 3], axis=1), angle))


def _what_is_near(gaps: Array) -> str:
    if not len(gaps):
        return "the recording ends before it"
    distance, angle = gaps[int(gaps[:, 0].argmin())]
    return (
        f"the nearest one ahead is {1e3 * distance:.1f} mm and {np.degrees(angle):.1f} deg off. "
        "Replay it with the [scan] it was recorded with, or allow for more with "
        "laser.replay_tolerance_mm"
    )
