"""What the objective weighs, and where its loss functions turn steep. Suzuki et al. (2022), V."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TowingWeights:
    """Weights of the objective's terms. The defaults are those of the paper's simulation, V-C.

    Parameters
    ----------
    bend, obstacle, change : float
        w_θ, w_d and w_c: of 100 together, as the paper has them.
    pace : float
        Of the vehicles' steps, s/m²: the term is pace / (N dt) Σ |Δp|². The paper has none.
    pull : float
        Of the cable's force on the welder. The paper has none.
    """

    bend: float = 75.0
    obstacle: float = 24.0
    change: float = 1.0
    pace: float = 200.0
    pull: float = 0.0


@dataclass(frozen=True, slots=True)
class EffortTargets:
    """Where the loss functions have their inflection: the paper's effort targets.

    Parameters
    ----------
    bend : float
        Angle of a joint, radians; its square is c_θ.
    distance : float
        Of a link from an obstacle, metres: c_d.
    change : float
        Of a joint's angle from the estimate, radians: c_c.
    pull : float
        Of the cable on the welder, newton: half of what a metre of the paper's cable could rub.
    """

    bend: float = 0.77
    distance: float = 0.30
    change: float = 0.60
    pull: float = 3.0
