"""The saturating loss of (9), in Suzuki et al. (2022), with what the paper leaves open closed.

ρ(f) = Σ a_i (tanh(b_i (f - c_i)) + d_i), i = 1, 2. The paper gives its limits, 0 and 1, and its
inflection, the effort target. Here both c_i are that target; the slopes b are 4 and 1 over it, so
that one curve turns steeply at the target and a gentle one gives a slope everywhere; their shares
are 0.8 and 0.2; d_i and the scale of a_i follow from the limits.
"""

from __future__ import annotations

from math import exp, tanh

from tjscan.towing.shape.compiled import compiled

SHARES_AND_SLOPES = ((0.8, 4.0), (0.2, 1.0))
"""Of the two curves; slopes over the target."""

RISING = tuple((share / (1 + tanh(b)), b, tanh(b)) for share, b in SHARES_AND_SLOPES)
"""a_i, b_i times the target, and d_i of a rising loss."""


@compiled
def rising_loss(f: float, target: float) -> tuple[float, float, float]:
    """ρ of (9) and two derivatives: 0 at 0, 1 at infinity, inflection at the target."""
    value, first, second = 0.0, 0.0, 0.0
    for a, slope, d in RISING:
        b = slope / target
        t = 1.0 - 2.0 / (1.0 + exp(min(2.0 * b * (f - target), 700.0)))  # tanh, in half its time
        steep = a * b * (1.0 - t * t)
        value += a * (t + d)
        first += steep
        second -= 2.0 * b * t * steep
    return value, first, second


@compiled
def free_share(d: float, target: float) -> tuple[float, float, float]:
    """1 - ρ_d of (9) and two derivatives: 0 deep inside, 1 far away.

    ρ_d falls: a_i < 0 and d_i = -1, so that 1 - ρ_d is a sum of logistic curves.
    """
    value, first, second = 0.0, 0.0, 0.0
    for share, slope in SHARES_AND_SLOPES:
        b = 2.0 * slope / target
        s = 1.0 / (1.0 + exp(min(-b * (d - target), 700.0)))
        steep = share * b * s * (1.0 - s)
        value += share * s
        first += steep
        second += b * (1.0 - 2.0 * s) * steep
    return value, first, second
