"""The cable's force on each vehicle over some seconds: what is left of its grip, and giving way."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.plan import TowingPlan

FORCE_WINDOW: Final = 40
"""Periods, 4 s of them, over which forces are averaged: where the cable is nearly taut, the noise
of a pose makes forces as large as a vehicle's grip."""

SURE_PERIODS: Final = 10
"""Periods, a second, for which a force must be sure. Errors of filtered poses last as long, so the
mean of a window scatters hardly less than they do."""

PUSHED_PERIODS: Final = 3
"""Periods, 0.3 s, for which wheels must push: no change of their speed takes so long."""

USABLE_GRIP_SHARE: Final = 0.8
"""Share of a vehicle's force from which on the welder waits: beyond, wheels slip on a bad spot."""

EASED_GRIP_SHARE: Final = 0.7
"""The same below which it goes on after it waited."""

GIVING_WAY_SHARE: Final = 0.5
"""Share of it from which on a vehicle gives way to the cable."""

GIVING_WAY_COMPLIANCE: Final = 2e-3
"""Metres for each newton beyond. Nearly taut, a metre of cable pulls with some newton more for each
millimetre, so this takes most of it away."""

LONGEST_GIVING_WAY: Final = 0.02
"""Metres by which a vehicle gives way at most: less than half of what it may be off its plan."""

SMALLEST_FORCE: Final = 1e-9
"""Newton: a force without a direction."""


class GripWatch:
    """The cable's mean force on each vehicle, compared with what the vehicle can pull with.

    Parameters
    ----------
    vehicles : int
    most : float
        Force of a vehicle, newton.
    """

    def __init__(self, vehicles: int, most: float) -> None:
        self._most = most
        self._forces: deque[Array] = deque(maxlen=FORCE_WINDOW)
        self._pushes: deque[Array] = deque(maxlen=PUSHED_PERIODS)
        self._tensions: deque[Array] = deque(maxlen=FORCE_WINDOW)
        self._still = np.zeros((vehicles, 2))
        self._waits, self._hard_for = False, 0

    def update(self, plan: TowingPlan, pushes: Array) -> None:
        """Take in the forces of a plan's estimate, and what the wheels push with.

        A vehicle that is not about to slip goes evenly: its wheels' push is what the cable pulls.

        Parameters
        ----------
        plan : TowingPlan
        pushes : ndarray, shape (vehicles, 2)
            Newton; NaN where drives do not report it.
        """
        estimated = self._still * np.nan if plan.forces is None else plan.forces
        forces = np.where(np.isnan(pushes), estimated, -pushes)
        self._pushes.append(np.linalg.norm(np.nan_to_num(pushes), axis=1))
        if np.isfinite(forces).all():
            self._forces.append(forces)
        if plan.tension is not None and np.isfinite(plan.tension).all():
            self._tensions.append(plan.tension)

    @property
    def forces(self) -> Array:
        """Mean of the last seconds, newton, shape (vehicles, 2)."""
        return np.mean(self._forces, axis=0) if self._forces else self._still

    @property
    def tension(self) -> float:
        """Largest mean along the cable, newton."""
        return float(np.mean(self._tensions, axis=0).max()) if self._tensions else 0.0

    @property
    def sure_forces(self) -> Array:
        """Amounts above which the forces surely are, two standard deviations less than their means.

        Newton, shape (vehicles,).
        """
        if len(self._forces) < FORCE_WINDOW:
            return np.zeros(len(self._still))
        amounts = np.linalg.norm(self.forces, axis=1)
        scatter = np.linalg.norm(np.std(self._forces, axis=0), axis=1)
        return np.asarray(np.maximum(amounts - 2 * scatter, 0.0))

    def count_hard_pull(self) -> tuple[float, int] | None:
        """Largest sure force and its vehicle, if too little of that vehicle's grip is left.

        Called once a period: the force must last for `SURE_PERIODS`, and what wheels themselves
        push with, for `PUSHED_PERIODS`. What drives that report too small a push hide, the chord of
        a cable that is drawn straight shows.
        """
        mean, is_long = self.sure_forces, len(self._pushes) == PUSHED_PERIODS
        pushed = np.min(self._pushes, axis=0) if is_long else np.zeros(len(self._still))
        limit = self._most * (EASED_GRIP_SHARE if self._waits else USABLE_GRIP_SHARE)
        self._hard_for = self._hard_for + 1 if mean.max() > limit else 0
        is_sure = self._hard_for >= (1 if self._waits else SURE_PERIODS)
        self._waits = is_sure or bool(pushed.max() > limit)
        most = np.maximum(mean, pushed)
        return (float(most.max()), int(most.argmax())) if self._waits else None

    def give_way(self) -> Array:
        """How far each vehicle gives way to the cable, metres, shape (vehicles, 2)."""
        beyond = np.maximum(self.sure_forces - GIVING_WAY_SHARE * self._most, 0.0)
        way = np.minimum(GIVING_WAY_COMPLIANCE * beyond, LONGEST_GIVING_WAY)
        size = np.maximum(np.linalg.norm(self.forces, axis=1), SMALLEST_FORCE)
        return np.asarray((way / size)[:, None] * self.forces)
