"""Steps as long as the groove allows: short if it changes fast, long if it does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core.frames import Array
from tjscan.core.gaussian_process import Matern52, OrdinaryKriging
from tjscan.core.units import DEG, MM, MM2, SettingsTable
from tjscan.scanning.seam.fit import fit_tubes_to_sections
from tjscan.scanning.seam.next_section import SHAPE_SPREAD, SHAPE_WAVE
from tjscan.scanning.seam.track import MOST_SECTIONS, RecentSections, recent_section_arrays
from tjscan.scanning.section import ScannedSection, StepLengthRule

AREA_SPREAD: Final = 0.4
"""How much the area varies round a joint, standard deviation as a share of it."""

TRIED_LENGTHS: Final = 50
"""Lengths between the shortest and the longest that are looked at."""


@dataclass(frozen=True, slots=True)
class AdaptiveStepSettings(SettingsTable):
    """The table [scan.adaptive]: how much may change from section to section.

    Steps are as long as that allows; the plan's step counts for the taught poses alone.

    Parameters
    ----------
    least, most : float
        Shortest and longest step, metres.
    angle_change : float
        Of the groove angle, radians.
    area_change : float
        Of the cross-section's area, square metres.
    turn : float
        Of the groove's direction, as it bends at the last section, radians.
    """

    least: Annotated[float, Ge(5), Le(300), MM] = 0.01
    most: Annotated[float, Ge(5), Le(300), MM] = 0.08
    angle_change: Annotated[float, Gt(0), Le(90), DEG] = radians(3.0)
    area_change: Annotated[float, Gt(0), Le(1e5), MM2] = 50e-6
    turn: Annotated[float, Gt(0), Le(90), DEG] = radians(20.0)

    def __post_init__(self) -> None:
        if self.least > self.most:
            raise ValueError("least_mm must not be larger than most_mm")


def adaptive_step_rule(adaptive: AdaptiveStepSettings) -> StepLengthRule:
    """Rule that takes the longest step over which nothing changes by more than is allowed.

    Angle and area are smooth random functions of the groove's length, measured with the sections'
    own errors: noise is not taken for change, and what can't be foreseen shortens the step.
    A change counts as what is expected and one standard deviation more.
    """
    steps = np.linspace(adaptive.least, adaptive.most, TRIED_LENGTHS)

    def rule(sections: Sequence[ScannedSection]) -> float:
        track = recent_section_arrays(sections)
        angles = OrdinaryKriging(
            track.along,
            track.shape[:, 2],
            track.shape_sigmas[:, 2],
            Matern52(SHAPE_SPREAD[2], SHAPE_WAVE),
        )
        allowed = (
            (_change(angles, steps) <= adaptive.angle_change)
            & (_change(_areas(sections, track), steps) <= adaptive.area_change)
            & (fit_tubes_to_sections(track).seam_curvature() * steps <= adaptive.turn)
        )
        return float(steps[max(0, int(np.logical_and.accumulate(allowed).sum()) - 1)])

    return rule


def _areas(sections: Sequence[ScannedSection], track: RecentSections) -> OrdinaryKriging:
    grooves = [scan.groove for scan in sections[-MOST_SECTIONS:]]
    areas = np.array([groove.area for groove in grooves])
    # A hundredth: planes that are turned a little otherwise cut a little more or less.
    sigmas = np.hypot([groove.area_sigma for groove in grooves], 0.01 * areas)
    kernel = Matern52(AREA_SPREAD * float(areas.mean()), SHAPE_WAVE)
    return OrdinaryKriging(track.along, areas, sigmas, kernel)


def _change(process: OrdinaryKriging, steps: Array) -> Array:
    """How much it may change over steps from the last section: expected, and once its doubt."""
    change, sigma = process.predict_change(steps, 0.0)
    return np.asarray(np.abs(change) + sigma)
