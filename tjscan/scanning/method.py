"""How a plan's steps are made: what predicts them, and what says how long they are."""

from __future__ import annotations

from tjscan.scanning.adaptive import adaptive_step_rule
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.prediction import PREDICTION_CASES, SMOOTH_PREDICTION, paper_predictor
from tjscan.scanning.set_point import SetPointPredictor, StepLengthRule
from tjscan.scanning.smooth import tube_fit_predictor


def predictor_for_plan(plan: ScanPlan) -> SetPointPredictor:
    """Predictor of set-points that a plan names."""
    if plan.prediction == SMOOTH_PREDICTION:
        return tube_fit_predictor(plan)
    return paper_predictor(PREDICTION_CASES[plan.prediction], plan.direction)


def step_rule_for_plan(plan: ScanPlan) -> StepLengthRule:
    """The rule that a plan's steps follow: all of the same length, or as the groove allows."""
    if plan.adaptive is not None:
        return adaptive_step_rule(plan.adaptive)
    return lambda sections: plan.step
