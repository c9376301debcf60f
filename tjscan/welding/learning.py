"""What looks teach about a weld: deposition, torch offset, shrinkage; a scalar filter each."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from tjscan.core.frames import Array, Mask
from tjscan.core.robust import mad_sigma


@dataclass(frozen=True, slots=True)
class ScalarFilter:
    """Kalman filter of one constant.

    Parameters
    ----------
    value, sigma : float
        Estimate and its standard deviation.
    """

    value: float
    sigma: float

    def update(self, measured: float, sigma: float) -> ScalarFilter:
        """The filter after a measurement with a standard deviation."""
        gain = self.sigma**2 / (self.sigma**2 + sigma**2)
        value = self.value + gain * (measured - self.value)
        return ScalarFilter(value, float(np.sqrt(1 - gain)) * self.sigma)


DEPOSITION_PRIOR: Final = ScalarFilter(1.0, 0.05)
"""Before the first look (assumption)."""

OFFSET_PRIOR: Final = ScalarFilter(0.0, 0.6e-3)
"""Before the first look (assumption), metres."""

SHRINKAGE_PRIOR: Final = ScalarFilter(1.0, 0.3)
"""Before the first look (assumption)."""

LEAST_AREA_SIGMA: Final = 0.5e-6
"""Standard deviation, m², that the mean weld metal of all stations has whatever their number."""

LEAST_CLOSING_SIGMA: Final = 0.03e-3
"""The same of the transverse shrinkage, metres."""

BEAD_CENTRE_SIGMA: Final = 0.25e-3
"""By how much the bead model misplaces the centres of all of a bead, metres (assumption)."""

LEAST_SENSITIVITY, LARGEST_SENSITIVITY = 0.1, 1.5
"""Of a bead's centre to the wire's place: centres outside show nothing of it."""

FEWEST_CENTRES, CENTRES_TOGETHER = 4, 3.0
"""Centres that a bead must have to show the wire's place, and how many of them err alike."""

LEAST_OFFSET_SIGMA: Final = 0.1e-3
"""Beads of one weld are misplaced alike: however many, they don't show the offset better, metres
(assumption)."""


@dataclass(slots=True)
class WeldLearner:
    """Deposition gain, torch offset and shrinkage factor of a weld.

    Gain and shrinkage are learnt from all metal since the first scan, not bead by bead: an error
    of height weighs little against all beads. Each look so replaces what the one before taught.

    Attributes
    ----------
    gain, offset, shrinkage : ScalarFilter
        Deposited area over that of wire and speed; where the wire points beside the torch's pose,
        along u, metres; shrinkage over the model's.
    """

    gain: ScalarFilter = DEPOSITION_PRIOR
    offset: ScalarFilter = OFFSET_PRIOR
    shrinkage: ScalarFilter = SHRINKAGE_PRIOR
    _set_area: Array | float = field(default=0.0)

    def add_set_area(self, area: Array) -> None:
        """Count the area that wire and speed give, shape (n,), of a bead that was laid."""
        self._set_area = self._set_area + area

    def learn_gain(self, metal: Array, read: Mask, sigma: float) -> None:
        """Learn from the weld metal seen, shape (n,), m², at the stations that were read.

        Parameters
        ----------
        metal : ndarray, shape (n,)
        read : ndarray of bool, shape (n,)
        sigma : float
            Of the mean, m², without `LEAST_AREA_SIGMA`.
        """
        laid = read & (np.broadcast_to(self._set_area, metal.shape) > 0)
        if not laid.any():
            return
        given = float(np.broadcast_to(self._set_area, metal.shape)[laid].mean())
        self.gain = DEPOSITION_PRIOR.update(
            float(metal[laid].mean()) / given, float(np.hypot(sigma, LEAST_AREA_SIGMA)) / given
        )

    def learn_shrinkage(self, closed: Array, expected: Array, variance: Array) -> None:
        """Learn from transverse shrinkage seen and that of the model alone, shape (n,), metres.

        Parameters
        ----------
        closed, expected : ndarray, shape (n,)
        variance : ndarray, shape (n,)
            Of the one seen, m²; infinite where it was not.
        """
        weights = np.where(expected > 0, 1 / variance, 0.0)
        if weights.sum() <= 0:
            return
        mean = float(np.average(expected, weights=weights))
        # What errs alike at all stations does not average out.
        sigma = float(np.hypot(LEAST_CLOSING_SIGMA, 0.3 * np.sqrt(variance.min())))
        found = SHRINKAGE_PRIOR.update(
            float(np.average(closed, weights=weights)) / mean, sigma / mean
        )
        if found.sigma <= self.shrinkage.sigma:
            self.shrinkage = found

    def learn_offset(self, beside: Array, sensitivity: Array) -> ScalarFilter | None:
        """Learn from where a bead's centre lies beside the predicted one, shape (n,), metres.

        Parameters
        ----------
        beside : ndarray, shape (n,)
        sensitivity : ndarray, shape (n,)
            Of the centre to the wire's place, by the bead model: small beside a wall, and large
            where a pool is about to run aside, which shows nothing of the torch.

        Returns
        -------
        ScalarFilter or None
            Deviation of the wire from where it was to be as this bead shows it, metres; None if it
            does not.
        """
        usable = np.isfinite(beside + sensitivity)
        usable &= (sensitivity > LEAST_SENSITIVITY) & (sensitivity < LARGEST_SENSITIVITY)
        beside, weights = beside[usable], sensitivity[usable]
        if len(beside) < FEWEST_CENTRES:
            return None
        ratio = beside / weights
        order = ratio.argsort()
        share = np.cumsum(weights[order]) / weights.sum()
        found = float(ratio[order][share.searchsorted(0.5)])  # least sum of distances
        strength = float(np.sqrt(np.mean(weights**2)))
        spread = mad_sigma(beside - found * weights) / np.sqrt(len(beside) / CENTRES_TOGETHER)
        sigma = float(np.hypot(spread, BEAD_CENTRE_SIGMA)) / strength
        # What was predicted had the offset of before in it.
        now = self.offset.update(self.offset.value + found, sigma)
        self.offset = ScalarFilter(now.value, max(now.sigma, LEAST_OFFSET_SIGMA))
        return ScalarFilter(found, sigma)
