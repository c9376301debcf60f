"""Laws of steps that are as long as the groove allows."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from cells import scan_example
from seams import NONE, Noise, Seam, seam

from tjscan.scanning.journal import StopReason, untaught_step_lengths
from tjscan.scanning.plan import TRIED_STEP_LENGTHS, AdaptiveStepSettings, adaptive_step_rule
from tjscan.scanning.section import ScannedSection
from tjscan.scanning.smooth import tube_fit_predictor

LIMITS = AdaptiveStepSettings(0.01, 0.1)


def round_the_joint(world: Seam, sections: int) -> tuple[list[ScannedSection], list[float]]:
    """Sections at the rule's steps from before the crown on, and these steps."""
    rule, predictor = adaptive_step_rule(LIMITS), tube_fit_predictor(world.plan)
    scans, steps = world.walk(-1.2, 0.03, 3), []
    for _ in range(sections):
        steps.append(rule(scans))
        scans.append(world.look(predictor(scans, steps[-1]), len(scans)))
    return scans, steps


@pytest.mark.parametrize("joint", ["tjoint-600x457", "tjoint-406x324"])
def test_nothing_changes_by_much_more_than_is_allowed(joint: str) -> None:
    scans, steps = round_the_joint(seam(joint), 14)
    grooves = [scan.groove for scan in scans[2:]]
    angles = np.abs(np.diff([g.groove_angle for g in grooves]))
    areas = np.abs(np.diff([g.area for g in grooves]))
    # One standard deviation is kept, so one change in some is larger, by little.
    assert np.mean(angles <= LIMITS.angle_change) > 0.8
    assert angles.max() < 1.5 * LIMITS.angle_change
    assert areas.max() < 1.5 * LIMITS.area_change
    assert max(steps) > 1.4 * min(steps)


def test_noise_is_not_taken_for_change() -> None:
    world = seam()
    scans = world.walk(-1.2, 0.02, 8)
    rule = adaptive_step_rule(LIMITS)
    quiet = rule(scans)
    noisy = [
        rule(replace(world, noise=Noise(), rng=np.random.default_rng(seed)).walk(-1.2, 0.02, 8))
        for seed in range(8)
    ]
    assert world.noise == NONE
    # The change over a step is foreseen from openings that are read to 0.1° of 3° allowed.
    assert np.mean(noisy) == pytest.approx(quiet, rel=0.15)
    assert np.std(noisy) < 0.25 * quiet


def test_steps_keep_their_bounds_and_depend_on_the_sections_alone() -> None:
    scans = seam(noise=Noise()).walk(0.3, 0.03, 4)
    strict = replace(LIMITS, angle_change=radians(0.01))
    generous = AdaptiveStepSettings(0.01, 0.1, radians(80), 1.0, radians(80))
    assert adaptive_step_rule(strict)(scans) == strict.least
    assert adaptive_step_rule(generous)(scans) == pytest.approx(generous.most)
    step = adaptive_step_rule(LIMITS)(scans)
    assert step == adaptive_step_rule(LIMITS)(tuple(scans))
    places = (step - LIMITS.least) / (LIMITS.most - LIMITS.least) * (TRIED_STEP_LENGTHS - 1)
    assert places == pytest.approx(round(places))


def test_less_is_allowed_shorter_steps_follow() -> None:
    scans = seam(noise=Noise()).walk(0.3, 0.03, 4)
    steps = [
        adaptive_step_rule(replace(LIMITS, angle_change=radians(a)))(scans)
        for a in (0.5, 1, 2, 4, 8)
    ]
    assert steps == sorted(steps)


def test_a_scan_with_adaptive_steps_ends_where_it_was_asked_to() -> None:
    result = scan_example(
        {"scan.prediction_case": "smooth", "scan.adaptive.least_mm": 15, "scan.length_mm": 300}
    )
    lengths = untaught_step_lengths(result.sections)
    assert result.stop is StopReason.LENGTH
    assert sum(lengths) == pytest.approx(0.3, abs=0.04)
    assert min(lengths) > 0.0149
    assert max(lengths) < 0.0805
