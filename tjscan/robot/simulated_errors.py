"""What a simulated arm is off by: geometry, gears, backlash and warmth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from tjscan.core.frames import Array, frozen_arrays
from tjscan.robot.deviations import length_growth, with_deviations
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import ArmErrorSettings

RANDOM_STREAM: Final = 3
"""Keeps the random numbers of an arm's make apart from those of its moves."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class SimulatedArmErrors:
    """The true arm, which differs from the one that its controller plans and reports with.

    Parameters
    ----------
    kinematics : Kinematics
        The true arm while it is cold.
    growth : ndarray, shape (n, 6)
        Deviations of its joints, once it is warm.
    amplitude, phase : ndarray, shape (n,)
        Of each joint's error once a turn, radians.
    backlash : float
        Angle that a joint turns back before it moves the other way, radians.
    warm_up : float
        Seconds after which the growth is there but for 1/e.
    """

    kinematics: Kinematics
    growth: Array
    amplitude: Array
    phase: Array
    backlash: float
    warm_up: float

    @classmethod
    def draw(cls, nominal: Kinematics, settings: ArmErrorSettings, seed: int) -> Self:
        """Draw an arm of a kind.

        Parameters
        ----------
        nominal : Kinematics
            What its controller knows.
        settings : ArmErrorSettings
            How much arms of the kind differ from that.
        seed : int
            Decides which one, unless the settings do.
        """
        own = seed if settings.seed is None else settings.seed
        rng = np.random.default_rng([own, RANDOM_STREAM])
        n = len(nominal.lower)
        deviations = settings.sigmas * rng.standard_normal((n, 6))
        return cls(
            with_deviations(nominal, deviations),
            settings.growth * length_growth(nominal),
            settings.eccentricity * rng.standard_normal(n),
            rng.uniform(-np.pi, np.pi, n),
            settings.backlash,
            settings.warm_up,
        )

    def flange_pose(self, q: Array, turning: Array, time: float) -> Array:
        """True flange pose ``T_b_f``, shape (4, 4).

        Parameters
        ----------
        q : ndarray, shape (n,)
            Joint angles as the encoders read them, radians.
        turning : ndarray, shape (n,)
            Sign of each joint's last motion, 0 before it moved.
        time : float
            Seconds since it was switched on.
        """
        true_q = q + self.amplitude * np.sin(q + self.phase) - 0.5 * self.backlash * turning
        if not self.growth.any():
            return self.kinematics.forward(true_q)
        warm = 1.0 - np.exp(-max(time, 0.0) / self.warm_up)
        return with_deviations(self.kinematics, warm * self.growth).forward(true_q)
