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
from tjscan.groove.settings import PRIOR_SETTINGS, GrooveModel, SideModel

NOTCH_PULLS: Final = readonly_copy(
    np.concatenate((np.arange(21) * 25e-6, np.arange(6, 16) * 100e-6))
)
"""How far light between the faces may pull a notch in, in metres: real profiles
show 0.4 to 1.5 mm."""

SCALE_THICKNESSES: Final = readonly_copy(np.concatenate(([0.0], np.arange(4, 21, 2) * 25e-6)))
"""How thick mill scale may be, in metres: real profiles show 0.2 to 0.4 mm."""


def _base_log_pulls() -> Array:
    width = np.gradient(NOTCH_PULLS) * np.exp(-0.5 * (NOTCH_PULLS / PRIOR_SETTINGS.usual_pull) ** 2)
    share = (1 - PRIOR_SETTINGS.absence_probability) * width / width[1:].sum()
    share[0] = PRIOR_SETTINGS.absence_probability
    return readonly_copy(np.log(share))


def _base_log_thicknesses() -> Array:
    share = np.full(
        len(SCALE_THICKNESSES),
        (1 - PRIOR_SETTINGS.absence_probability) / (len(SCALE_THICKNESSES) - 1),
    )
    share[0] = PRIOR_SETTINGS.absence_probability
    return readonly_copy(np.log(share))


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
    log_thicknesses : ndarray, shape (n,)
        Log-likelihood of each of `SCALE_THICKNESSES`.
    form : str
        Name of the form of groove that was read; empty where this is not known.
    """

    bends: Array
    bend_sigmas: Array
    log_pulls: Array
    log_thicknesses: Array
    form: str = ""


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
    log_thicknesses : ndarray, shape (n,)
        Logarithm of the probability of each of `SCALE_THICKNESSES`.
    forms : frozenset of str
        Names of the forms of groove that the last sections had.
    """

    bends: Array = field(default_factory=lambda: np.zeros(2))
    bend_sigmas: Array = field(default_factory=lambda: np.full(2, inf))
    log_pulls: Array = field(default_factory=_base_log_pulls)
    log_thicknesses: Array = field(default_factory=_base_log_thicknesses)

    forms: frozenset[str] = frozenset()

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
        Log-likelihoods add, fading over `alike_length`. Of each bend the nearest good one is taken,
        for what it has changed since is common to all before.
        """
        prior = cls()
        if not sections:
            return prior
        pulls, thicknesses = prior.log_pulls.copy(), prior.log_thicknesses.copy()
        further = [away for _, away in sections]
        for k, (one, away) in enumerate(sections):
            apart = (
                PRIOR_SETTINGS.patch_length
                if k + 1 == len(sections)
                else max(away - further[k + 1], 0.0)
            )
            weight = exp(-away / PRIOR_SETTINGS.alike_length) * min(
                apart / PRIOR_SETTINGS.patch_length, 1.0
            )
            pulls += weight * one.log_pulls
            thicknesses += weight * one.log_thicknesses
        aways = np.array(further)[:, None]
        sigmas = np.array([one.bend_sigmas for one, _ in sections])
        sigmas = np.sqrt(
            sigmas**2 + (PRIOR_SETTINGS.bend_change * aways) ** 2 + PRIOR_SETTINGS.bend_sigma**2
        )
        best = sigmas.argmin(axis=0)
        bends = np.array([one.bends for one, _ in sections])
        return cls(
            bends[best, (0, 1)],
            sigmas[best, (0, 1)],
            _or_anything(pulls, prior.log_pulls),
            _or_anything(thicknesses, prior.log_thicknesses),
            frozenset(
                one.form for one, _ in sections[-PRIOR_SETTINGS.sections_with_forms :] if one.form
            ),
        )

    @property
    def knows_bends(self) -> bool:
        """Whether anything is known of how wall or leg bends."""
        return bool(np.isfinite(self.bend_sigmas).any())

    @property
    def without_bends(self) -> GroovePrior:
        """The same, with nothing known of how wall and leg bend."""
        return replace(self, bends=np.zeros(2), bend_sigmas=np.full(2, inf))

    def expected_model(self, model: GrooveModel) -> GrooveModel:
        """A groove's model, and its alternatives, with what is known of their form and bends."""
        others = model.alternatives
        expected = [self._expected_sides(one) for one in (model, *others)]
        likely = not self.forms.isdisjoint([other.name for other in others])
        return replace(
            model,
            sides=expected[0],
            alternatives=tuple(
                [replace(o, sides=s) for o, s in zip(others, expected[1:], strict=True)]
            ),
            likely_another=likely,
        )

    def _expected_sides(self, model: GrooveModel) -> tuple[SideModel, ...]:
        """The sides of a model, wall and leg bent as far as that is known."""
        sides = list(model.sides)
        for k, bend, sigma in zip((0, -1), self.bends, self.bend_sigmas, strict=True):
            if sigma < sides[k].bend and sides[k].bend > PRIOR_SETTINGS.straight_bend:
                sides[k] = replace(
                    sides[k],
                    bend=float(sigma),
                    twist=min(sides[k].twist, PRIOR_SETTINGS.bend_change / 3),
                    expected_bend=float(bend),
                )
        return tuple(sides)


def posterior(log_prior: Array, log_likelihood: Array) -> Array:
    """Probabilities of values, shape (n,), by Bayes' rule from logarithms of any offset."""
    return np.exp(_normalised(log_prior + log_likelihood))


def _normalised(log_share: Array) -> Array:
    log_share = log_share - log_share.max()
    return np.asarray(log_share - np.log(np.exp(log_share).sum()))


def _or_anything(log_share: Array, log_base: Array) -> Array:
    """Logarithm of probabilities that also count what is likely without anything known."""
    share = (1 - PRIOR_SETTINGS.change_probability) * np.exp(
        _normalised(log_share)
    ) + PRIOR_SETTINGS.change_probability * np.exp(log_base)
    return np.asarray(np.log(share))
