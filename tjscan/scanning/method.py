"""How a plan's steps are made: what predicts them, and what says how long they are."""

from __future__ import annotations

from tjscan.scanning.adaptive import adaptive_rule
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.prediction import CASES, SMOOTH, paper_predictor
from tjscan.scanning.set_point import Predictor, StepRule
from tjscan.scanning.smooth import smooth_predictor


def predictor_of(plan: ScanPlan) -> Predictor:
    """The predictor that a plan names."""
    if plan.prediction == SMOOTH:
        return smooth_predictor(plan)
    return paper_predictor(CASES[plan.prediction], plan.direction)


def step_rule_of(plan: ScanPlan) -> StepRule:
    """The rule that a plan's steps follow: all of the same length, or as the groove allows."""
    if plan.adaptive is not None:
        return adaptive_rule(plan.adaptive)
    return lambda sections: plan.step
