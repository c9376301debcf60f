"""What the sections of a groove show of the next one: what persists along it, and nothing else.

Root opening, depth and angle of a groove vary from section to section by more than a profile
shows them, so that of these nothing is carried on. What persists is how far the leg bends, how
thick mill scale is, and how far light between the faces pulls the notch in. Each section keeps what
its own profile shows of these, without what was known before: no profile counts twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import exp, inf
from typing import Final

import numpy as np

from tjscan.core.frames import Array, frozen_arrays, readonly_copy
from tjscan.groove.settings import GrooveModel

TRIED_NOTCH_PULLS: Final = readonly_copy(
    1e-3 * np.array((0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.75, 1.0, 1.3, 1.6, 2.0))
)
NOTCH_PULLS: Final = readonly_copy(np.append(0.0, TRIED_NOTCH_PULLS))
"""How far light between the faces may pull a notch in, in metres, if it does, and if it may not:
real profiles show 0.4 to 1.5 mm."""

SCALE_THICKNESSES: Final = readonly_copy(np.concatenate(([0.0], np.arange(4, 21, 2) * 25e-6)))
"""How thick mill scale may be, in metres: real profiles show 0.2 to 0.4 mm."""

NO_SCALE_PROBABILITY: Final = 0.5
"""Probability that there is no scale, or no pull: as likely as not."""

TYPICAL_NOTCH_PULL: Final = 0.5e-3
"""About how far a notch is pulled in, in metres, if it is."""

SCALE_CORRELATION_LENGTH: Final = 0.5
"""Length of groove over which scale and the faces' gloss stay alike, in metres."""

SCALE_PATCH_LENGTH: Final = 20e-3
"""Sections nearer to each other, in metres, show the same patches of scale."""

BEND_CHANGE_PER_METRE: Final = 5.0
"""By how much a side's bend changes along the groove, in 1/m per metre: as of a leg of 600 mm
from none at the crown to all of it at the saddle. Across the groove it changes no faster."""

LEAST_BEND_SIGMA: Final = 0.15
"""Least standard deviation of a bend in 1/m: of 0.02 mm in 12 mm, which undulation makes too."""

LARGEST_STRAIGHT_BEND: Final = 1.0
"""A side that bends by less, in 1/m, is most likely straight: how far others seemed to bend shows
less of it than that."""

SCALE_CHANGE_PROBABILITY: Final = 0.1
"""Probability that scale or pull are no more as they were: then nothing is known of them."""


def _log_prior(weights: Array) -> Array:
    """Logarithm of the probability of nothing, and of what weighs so much, shape (n,)."""
    share = (1 - NO_SCALE_PROBABILITY) * weights / weights.sum()
    return readonly_copy(np.log(np.concatenate(([NO_SCALE_PROBABILITY], share))))


_PULL_LOG_PRIOR: Final = _log_prior(
    (np.gradient(NOTCH_PULLS) * np.exp(-0.5 * (NOTCH_PULLS / TYPICAL_NOTCH_PULL) ** 2))[1:]
)
_THICKNESS_LOG_PRIOR: Final = np.tile(_log_prior(np.ones(len(SCALE_THICKNESSES) - 1)), (2, 1))


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class SectionEvidence:
    """What one profile shows, by itself, of what persists along the groove.

    Parameters
    ----------
    bends, bend_sigmas : ndarray, shape (2,)
        Bend of wall and leg and its standard deviation, in 1/m.
    log_pulls : ndarray, shape (m,)
        Log-likelihood of each of `NOTCH_PULLS`.
    log_thicknesses : ndarray, shape (2, n)
        Log-likelihood of each of `SCALE_THICKNESSES` on wall and leg.
    """

    bends: Array
    bend_sigmas: Array
    log_pulls: Array
    log_thicknesses: Array


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class GroovePrior:
    """What is known of a groove's section before its profile is read.

    Without arguments it knows nothing.

    Parameters
    ----------
    bends, bend_sigmas : ndarray, shape (2,)
        Expected bend of wall and leg and its standard deviation, in 1/m; infinite where nothing
        is known of it.
    log_pulls : ndarray, shape (m,)
        Logarithm of the probability of each of `NOTCH_PULLS`.
    log_thicknesses : ndarray, shape (2, n)
        Logarithm of the probability of each of `SCALE_THICKNESSES` on wall and leg.
    """

    bends: Array = field(default_factory=lambda: np.zeros(2))
    bend_sigmas: Array = field(default_factory=lambda: np.full(2, inf))
    log_pulls: Array = field(default_factory=lambda: _PULL_LOG_PRIOR)
    log_thicknesses: Array = field(default_factory=lambda: _THICKNESS_LOG_PRIOR)

    @classmethod
    def from_sections(cls, sections: Sequence[tuple[SectionEvidence, float]]) -> GroovePrior:
        """What sections before show of the next one.

        Parameters
        ----------
        sections : sequence of (SectionEvidence, float)
            What each shows, and how far before the next one it is along the groove, in metres;
            the nearest one last.

        Notes
        -----
        Log-likelihoods add, fading over `SCALE_CORRELATION_LENGTH`. Of each bend the nearest good
        one is taken, for what it has changed since is common to all before.
        """
        prior = cls()
        if not sections:
            return prior
        pulls, thicknesses = prior.log_pulls.copy(), prior.log_thicknesses.copy()
        further = [away for _, away in sections]
        for k, (one, away) in enumerate(sections):
            apart = (
                SCALE_PATCH_LENGTH if k + 1 == len(sections) else max(away - further[k + 1], 0.0)
            )
            weight = exp(-away / SCALE_CORRELATION_LENGTH) * min(apart / SCALE_PATCH_LENGTH, 1.0)
            pulls += weight * one.log_pulls
            thicknesses += weight * one.log_thicknesses
        aways = np.array(further)[:, None]
        sigmas = np.array([one.bend_sigmas for one, _ in sections])
        sigmas = np.sqrt(sigmas**2 + (BEND_CHANGE_PER_METRE * aways) ** 2 + LEAST_BEND_SIGMA**2)
        best = sigmas.argmin(axis=0)
        bends = np.array([one.bends for one, _ in sections])
        return cls(
            bends[best, (0, 1)],
            sigmas[best, (0, 1)],
            _mix_with_base_probabilities(pulls, prior.log_pulls),
            _mix_with_base_probabilities(thicknesses, prior.log_thicknesses),
        )

    def expected_model(self, model: GrooveModel) -> GrooveModel:
        """A groove's model, and its alternatives, with what is known of their bends."""
        forms = []
        for form in (*model.alternatives, model):
            sides = list(form.sides)
            for k, bend, sigma in zip((0, -1), self.bends, self.bend_sigmas, strict=True):
                if sigma < sides[k].bend and sides[k].bend > LARGEST_STRAIGHT_BEND:
                    sides[k] = replace(sides[k], bend=float(sigma), expected_bend=float(bend))
                    twist = min(sides[k].twist, BEND_CHANGE_PER_METRE / 3)
                    sides[k] = replace(sides[k], twist=twist)
            forms.append(replace(form, sides=tuple(sides)))
        return replace(forms[-1], alternatives=tuple(forms[:-1]))


def posterior(log_prior: Array, log_likelihood: Array) -> Array:
    """Probabilities of values, shape (..., n), by Bayes' rule from logarithms of any offset."""
    log_share = log_prior + log_likelihood
    share = np.exp(log_share - log_share.max(axis=-1, keepdims=True))
    return np.asarray(share / share.sum(axis=-1, keepdims=True))


def _mix_with_base_probabilities(log_share: Array, log_base: Array) -> Array:
    """Logarithm of probabilities that also count what is likely without anything known."""
    share = (1 - SCALE_CHANGE_PROBABILITY) * posterior(log_share, np.zeros_like(log_share))
    return np.asarray(np.log(share + SCALE_CHANGE_PROBABILITY * np.exp(log_base)))
