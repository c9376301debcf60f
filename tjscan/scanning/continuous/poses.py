"""Where the arm was at any time, from the states that it reports."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.robot.arm import ArmState
from tjscan.robot.kinematics import Kinematics

REMEMBERED_STATES: Final = 4000
"""States that are kept: eight seconds at 500 a second."""

NEIGHBOURING_STATES: Final = 4
"""States through which joint angles are interpolated, by a cubic."""


class ActualPoses:
    """Joint angles and flange poses between the states that an arm reports.

    Parameters
    ----------
    kinematics : Kinematics
        Of the arm, as calibrated.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics
        self._states: deque[ArmState] = deque(maxlen=REMEMBERED_STATES)

    def begin(self) -> None:
        """Forget all states: between two paths followed the arm may move unseen."""
        self._states.clear()

    def add(self, states: Iterable[ArmState]) -> None:
        """Take further states, in order; what comes twice, or was overtaken, is left out."""
        for state in states:
            if not self._states or state.time > self.latest:
                self._states.append(state)

    @property
    def first(self) -> float:
        """Time of the first state that is kept, seconds on the arm's clock."""
        return self._states[0].time

    @property
    def period(self) -> float:
        """Seconds from state to state."""
        return (self.latest - self.first) / max(len(self._states) - 1, 1)

    @property
    def latest(self) -> float:
        """Time of the latest state."""
        return self._states[-1].time

    def cover(self, time: float) -> bool:
        """Whether states lie about a time, or next to it, in seconds on the arm's clock."""
        return self.first - self.period <= time <= self.latest

    def at(self, time: float) -> ArmState:
        """State at a time that is covered: joint angles by a cubic through the states about it."""
        states = self._states
        i = len(states) - 1
        while i > 0 and states[i - 1].time >= time:
            i -= 1
        first = min(max(i - NEIGHBOURING_STATES // 2, 0), max(len(states) - NEIGHBOURING_STATES, 0))
        near = [states[k] for k in range(first, min(first + NEIGHBOURING_STATES, len(states)))]
        times = np.array([state.time for state in near]) - time
        q = _lagrange_weights(times) @ np.array([state.q for state in near])
        return ArmState(q, self._kinematics.forward(q), time)


def _lagrange_weights(times: Array) -> Array:
    """Weights of values at these times for the value at zero, shape (n,)."""
    apart = times[:, None] - times
    np.fill_diagonal(apart, 1.0)
    others = np.where(np.eye(len(times), dtype=bool), 1.0, -times)
    return np.asarray(np.prod(others / apart, axis=1))
