"""What stitching takes for granted, and what it asks of an overlap."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians

from tjscan.joint.tubes.fit import ArmRepeatability


@dataclass(frozen=True, slots=True)
class StitchSettings:
    """How stations are stitched. The defaults of the first two are assumptions.

    Parameters
    ----------
    repeatability : ArmRepeatability
        How exactly the arm reports where it stands; it weighs views against points.
    out_of_round : float
        How far a tube's wall may bulge from a circle, metres: what each station finds of the
        joint's frame is taken to be no surer than that.
    most_out_of_round : float
        How far it may be found to, where the tubes as stations found them disagree with their
        overlaps.
    least_overlap : float
        Azimuth that two stations must share, radians.
    fewest_sections : int
        Sections that each of them must have there.
    largest_sigma : float
        How uncertain an overlap may leave the place where it lies, metres.
    largest_reduced_chi2 : float
        Chi-squared per degree of freedom that the overlap's residuals may have.
    least_counted : float
        Share of the overlap's views to which the robust kernel must give weight.
    """

    repeatability: ArmRepeatability = field(default_factory=ArmRepeatability)
    out_of_round: float = 2e-5
    most_out_of_round: float = 4e-3
    least_overlap: float = radians(10.0)
    fewest_sections: int = 2
    largest_sigma: float = 0.2e-3
    largest_reduced_chi2: float = 6.0
    least_counted: float = 0.75


DEFAULT = StitchSettings()
