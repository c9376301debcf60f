"""The simulated arm while it follows a path: it lags behind, and its error wanders as it moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import exp
from typing import Final

import numpy as np
from numpy.random import Generator

from tjscan.core.frames import Array, readonly_copy
from tjscan.robot.arm import ArmState
from tjscan.robot.following import JointMotion
from tjscan.robot.kinematics import Kinematics

CONTROLLER_TICK: Final = 0.002
"""Seconds between two set-points of a joint controller."""

STATE_PERIOD: Final = 0.002
"""Seconds between two states that it reports: those of an e-Series arm come 500 times a second."""

LAG_STAGES: Final = 2
"""Equal first-order lags in a row, which together make the lag."""


class WanderingError:
    """A smooth random error: Gaussian, with the covariance of a Matérn process of order 3/2.

    Parameters
    ----------
    error : ndarray, shape (n,)
        What it is at first.
    spread : ndarray, shape (n,)
        Its standard deviations.
    correlation : float
        Seconds of its time constant.
    random : numpy.random.Generator
        Source of its steps.
    """

    def __init__(self, error: Array, spread: Array, correlation: float, random: Generator) -> None:
        self._rate, self._random = 1.0 / correlation, random
        self._stationary = np.diag((1.0, self._rate**2))
        self._spread = spread
        self._state = np.vstack((error, self._rate * spread * random.standard_normal(len(error))))

    @property
    def now(self) -> Array:
        """The error, shape (n,)."""
        return np.asarray(self._state[0])

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        k, t = self._rate, seconds
        step = exp(-k * t) * np.array(((1 + k * t, t), (-k * k * t, 1 - k * t)))
        left = self._stationary - step @ self._stationary @ step.T
        noise = np.linalg.cholesky(left + 1e-15 * self._stationary)
        drawn = self._random.standard_normal(self._state.shape)
        self._state = step @ self._state + self._spread * (noise @ drawn)


class SimulatedFollowing:
    """A simulated arm that follows paths, as `Following` has it, on a clock that is let run.

    Parameters
    ----------
    kinematics : Kinematics
        The arm, as its controller knows it.
    start : ArmState
        Where it is at rest.
    lag : float
        Seconds by which it follows late.
    error : WanderingError
        By which its flange is beside what it reports.
    check : callable
        Raises ArmFault if the arm was stopped.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        start: ArmState,
        lag: float,
        error: WanderingError,
        check: Callable[[], None],
    ) -> None:
        self._kinematics, self._check, self.error = kinematics, check, error
        self._motion = JointMotion.at_rest(start.q, start.time)
        self._stage_lag = lag / LAG_STAGES
        self._stages = np.tile(start.q, (LAG_STAGES, 1))
        self._start, self._reported = start.time, 0
        self._states: list[ArmState] = [start]
        self.time = start.time
        self.turning = np.zeros(len(start.q))

    @property
    def q(self) -> Array:
        """Joint angles as the encoders read them, shape (n,), radians."""
        return np.asarray(self._stages[-1])

    @property
    def now(self) -> float:
        """Where it is on its paths. See `Following.now`."""
        return self.time

    @property
    def end(self) -> float:
        """When the motion that is followed ends. See `Following.end`."""
        return self._motion.end

    def replace(self, motion: JointMotion) -> None:
        """Follow another motion. See `Following.replace`."""
        self._check()
        self._motion = self._motion.replaced_by(motion, self.time)

    def states(self) -> Sequence[ArmState]:
        """States since the last call. See `Following.states`."""
        self._check()
        found, self._states = self._states, []
        return found

    def advance(self, seconds: float) -> None:
        """Let the arm move for some time, on its clock."""
        until = self.time + seconds
        while self.time < until:
            due = self._start + (self._reported + 1) * STATE_PERIOD
            self._step(min(self.time + CONTROLLER_TICK, until, due))
            if self.time >= due:
                self._reported += 1
                q = readonly_copy(self.q)
                self._states.append(ArmState(q, self._kinematics.forward(q), self.time))

    def _step(self, to: float) -> None:
        before, seconds = self.q.copy(), to - self.time
        target, _ = self._motion.at(to)
        share = -np.expm1(-seconds / self._stage_lag) if self._stage_lag > 0 else 1.0
        for stage in self._stages:
            stage += share * (target - stage)
            target = stage
        self.error.advance(seconds)
        turned = self.q - before
        self.turning = np.where(turned == 0.0, self.turning, np.sign(turned))
        self.time = to
