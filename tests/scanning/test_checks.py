"""Never a wild move: whatever says where to go, the arm hears of no set-point that is too far."""

from collections.abc import Sequence

import numpy as np
import pytest
from cells import Notes, scan_example
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rings import PLAN, ring_section
from scipy.spatial.transform import Rotation

from tjscan.core.errors import SetPointTooFar
from tjscan.core.frames import Array, inverse_pose, pose, rot_x, rotation_angle_between
from tjscan.scanning.journal import StopReason
from tjscan.scanning.retries import LARGEST_RETRY_SHIFT, NUDGE_TURN, ViewAdjustment
from tjscan.scanning.section import ScannedSection, SetPoint, StepRequest, Substep
from tjscan.scanning.sections_before import (
    FARTHEST_SET_POINT_STEPS,
    LARGEST_VIEW_SHIFT,
    check_set_point,
)
from tjscan.scanning.target import PREDICTION_CASES, ScanDirection, paper_predictor

ANGLE = 2 * np.arcsin(PLAN.step / 2 / 0.2286)
BEFORE, LAST = ring_section(-ANGLE), ring_section(0.0)
REQUEST = StepRequest(LAST, ring_section(ANGLE).T_b_t[:3, 3], PLAN.step)
GOOD = SetPoint(ring_section(ANGLE).T_b_t, LAST.T_s_t)

anything = st.floats(allow_nan=True, allow_infinity=True)
small = st.floats(-1.0, 1.0)


def nothing_further(to: SetPoint) -> None:
    """What holds of every set-point that passes."""
    T_b_s = to.T_b_t @ inverse_pose(to.T_s_t)
    moved = np.linalg.norm(T_b_s[:3, 3] - LAST.view.T_b_s[:3, 3])
    turned = rotation_angle_between(LAST.view.T_b_s, T_b_s)
    lever = np.linalg.norm(to.T_s_t[:3, 3])
    assert turned <= REQUEST.max_rotation + 1e-6
    assert (
        moved
        <= FARTHEST_SET_POINT_STEPS * REQUEST.length
        + 2 * lever * np.sin(turned / 2)
        + LARGEST_VIEW_SHIFT
        + 1e-3
    )


@settings(max_examples=200)
@given(arrays(np.float64, (4, 4), elements=anything), arrays(np.float64, (4, 4), elements=anything))
def test_no_monster_passes(T_b_t: Array, T_s_t: Array) -> None:
    for to in (SetPoint(T_b_t, GOOD.T_s_t), SetPoint(GOOD.T_b_t, T_s_t), SetPoint(T_b_t, T_s_t)):
        with pytest.raises(SetPointTooFar):
            check_set_point(to, REQUEST, PLAN)


def test_a_step_of_no_length_leads_nowhere() -> None:
    for length in (np.nan, -PLAN.step, 0.0):
        with pytest.raises(SetPointTooFar):
            check_set_point(GOOD, StepRequest(LAST, REQUEST.p_b_ahead, length), PLAN)


@settings(max_examples=300)
@given(arrays(np.float64, 6, elements=small), arrays(np.float64, 6, elements=small), small)
def test_what_passes_leads_no_further_than_the_step_allows(
    off: Array, seen: Array, scale: float
) -> None:
    def change(v: Array) -> Array:
        return pose(Rotation.from_rotvec(3 * scale * v[3:]).as_matrix(), 0.2 * scale * v[:3])

    to = SetPoint(GOOD.T_b_t @ change(off), GOOD.T_s_t @ change(seen))
    try:
        check_set_point(to, REQUEST, PLAN)
    except SetPointTooFar:
        return
    nothing_further(to)


@pytest.mark.parametrize("case", PREDICTION_CASES)
@pytest.mark.parametrize("share", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("offset", [-1, 1])
def test_the_papers_set_points_and_every_nudge_of_them_pass(
    case: int, share: float, offset: int
) -> None:
    to = paper_predictor(PREDICTION_CASES[case], ScanDirection.COUNTERCLOCKWISE)(
        [BEFORE, LAST], share * PLAN.step
    )
    request = StepRequest(LAST, to.T_b_t[:3, 3], share * PLAN.step)
    check_set_point(to, request, PLAN)
    for nudge in (
        ViewAdjustment(standoff=offset * LARGEST_RETRY_SHIFT),
        ViewAdjustment(offset=offset * LARGEST_RETRY_SHIFT),
        ViewAdjustment(work_angle=offset * NUDGE_TURN),
    ):
        check_set_point(nudge.adjusted_set_point(to, PLAN.direction), request, PLAN)


def test_a_hand_may_have_held_the_sensor_otherwise_but_not_anyhow() -> None:
    def turned_by(degrees: float) -> SetPoint:
        return SetPoint(GOOD.T_b_t @ pose(rot_x(np.radians(degrees))), GOOD.T_s_t)

    taught = StepRequest(ring_section(0.0, substep=Substep.TAUGHT), REQUEST.p_b_ahead, PLAN.step)
    with pytest.raises(SetPointTooFar, match="turns the sensor"):
        check_set_point(turned_by(90), REQUEST, PLAN)
    check_set_point(turned_by(90), taught, PLAN)
    with pytest.raises(SetPointTooFar, match="turns the sensor"):
        check_set_point(turned_by(160), taught, PLAN)


@pytest.mark.parametrize(
    "wild",
    [
        lambda last: SetPoint(np.full((4, 4), np.nan), last.T_s_t),
        lambda last: SetPoint(np.full((4, 4), np.inf), last.T_s_t),
        lambda last: SetPoint(pose(p=(0, 0, 0.3)) @ last.T_b_t, last.T_s_t),
        lambda last: SetPoint(last.T_b_t @ pose(rot_x(np.pi)), last.T_s_t),
        lambda last: SetPoint(last.T_b_t, last.T_s_t @ pose(p=(0, 0, -0.1))),
    ],
    ids=["nan", "inf", "far", "over", "near"],
)
def test_a_predictor_gone_wild_moves_nothing(wild: object) -> None:
    def predictor(sections: Sequence[ScannedSection], step: float) -> SetPoint:
        assert callable(wild)
        to: SetPoint = wild(sections[-1])
        return to

    notes = Notes()
    result = scan_example({}, predictor=predictor, notes=notes)
    assert result.stop is StopReason.REFUSED
    assert "refused" in result.detail
    assert [v.substep for v in result.views] == [Substep.TAUGHT, Substep.TAUGHT, Substep.RESUMED]
    assert [name for name, _ in notes.events] == ["half step", "retreat", "stop"]
