"""What looks teach about a weld: deposition, torch offset, shrinkage; a scalar filter each."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot, sqrt
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

BEAD_CENTRE_SIGMA: Final = 0.1e-3
"""By how much the bead model misplaces the centres of all of a bead that runs nowhere, metres
(assumption)."""

WALL_SHARE_SIGMA, GRAVITY_SHARE_SIGMA, RUN_SHARE_SIGMA = 0.5, 1.0, 0.5
"""By what share the bead model may be wrong of how far pools run aside: all alike, for the slope of
what they lie on and for gravity, and each by itself (assumptions)."""

MISFIT_DEGREES: Final = 4.0
"""How many beads the model's stated errors count as, where beads show how wrong it is."""

LEAST_SENSITIVITY, LARGEST_SENSITIVITY = 0.1, 1.5
"""Of a bead's centre to the wire's place: centres outside show nothing of it."""

FEWEST_CENTRES, CENTRES_TOGETHER = 4, 3.0
"""Centres that a bead must have to show the wire's place, and how many of them err alike."""


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
    _centres: list[tuple[Array, float, float]] = field(default_factory=list)

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

    def lead(self, sensitivity: Array, runs: Array) -> Array:
        """How far beside its aim a wire makes the bead lie that points there, (n,), metres.

        By the torch's offset, and by what the bead model is wrong of how pools run aside.

        Parameters
        ----------
        sensitivity, runs : ndarray, shape (n,), (2, n)
            As of `learn_offset`.
        """
        (_, *errors), _, _ = self._offset_and_run_errors()
        shows = (sensitivity > LEAST_SENSITIVITY) & (sensitivity < LARGEST_SENSITIVITY)
        aside = np.where(shows, errors @ runs, 0.0) / np.where(shows, sensitivity, 1.0)
        return np.asarray(self.offset.value + np.nan_to_num(aside))

    def learn_offset(
        self, beside: Array, led: Array, sensitivity: Array, runs: Array
    ) -> ScalarFilter | None:
        """Learn from where a bead's centre lies beside the predicted one, shape (n,), metres.

        A wire that points aside puts all beads to one side. A model by which pools run aside too
        much, or too little, puts those on a slope the one way and those on the opposite slope the
        other way, so all beads together show which it is; and how wrong the model is, by what fits
        neither.

        Parameters
        ----------
        beside, led : ndarray, shape (n,)
            And how far beside its aim the wire was led the other way, as of `lead`.
        sensitivity : ndarray, shape (n,)
            Of the centre to the wire's place, by the bead model: small beside a wall, and large
            where a pool is about to run aside, which shows nothing of the torch.
        runs : ndarray, shape (2, n)
            How far the model has the pool run aside for what it lies on, and for gravity, metres.

        Returns
        -------
        ScalarFilter or None
            Deviation of the wire from where it was to be as this bead shows it, metres; None if it
            does not.
        """
        # What was predicted has the aim in it, and where it lies the lead.
        rows = np.stack((beside + sensitivity * led, beside, sensitivity, *runs))
        rows = rows[:, np.isfinite(rows).all(axis=0)]
        rows = rows[:, (rows[2] > LEAST_SENSITIVITY) & (rows[2] < LARGEST_SENSITIVITY)]
        count = rows.shape[1]
        if count < FEWEST_CENTRES:
            return None
        measured, off, *shares = np.median(rows, axis=1).tolist()
        spread = mad_sigma(rows[1] - off) / sqrt(count / CENTRES_TOGETHER)
        sigma = hypot(spread, BEAD_CENTRE_SIGMA, RUN_SHARE_SIGMA * hypot(*shares[1:]))
        before, known, _ = self._offset_and_run_errors()
        self._centres.append((np.array(shares), measured, sigma))
        after, covariance, misfit = self._offset_and_run_errors()
        own, offset = np.array((0.0, *shares[1:])), self.offset.value
        self.offset = ScalarFilter(float(after[0]), sqrt(covariance[0, 0]))
        found = (measured - float(own @ before)) / shares[0] - offset
        return ScalarFilter(
            found, sqrt(float(own @ known @ own) + (misfit * sigma) ** 2) / shares[0]
        )

    def _offset_and_run_errors(self) -> tuple[Array, Array, float]:
        """Offset, and shares by which the model is wrong of how pools run: estimate, covariance.

        And by how much what beads show is farther off than stated, as a standard deviation.
        """
        prior = np.diag((OFFSET_PRIOR.sigma, WALL_SHARE_SIGMA, GRAVITY_SHARE_SIGMA)) ** 2
        if not self._centres:
            return np.zeros(3), prior, 1.0
        shares, measured, sigma = map(np.array, zip(*self._centres, strict=True))
        scaled, values = shares / sigma[:, None], measured / sigma

        def fit(misfit: float) -> tuple[Array, Array]:
            covariance = np.linalg.inv(np.linalg.inv(prior) + scaled.T @ scaled / misfit**2)
            return covariance @ (scaled.T @ values) / misfit**2, covariance

        left = float(np.sum((values - scaled @ fit(1.0)[0]) ** 2))
        misfit = sqrt((MISFIT_DEGREES + left) / (MISFIT_DEGREES + len(sigma)))
        return *fit(misfit), misfit
