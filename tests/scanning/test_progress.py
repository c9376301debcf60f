"""When a scan is done, on sections laid round a ring."""

from itertools import count

import numpy as np
import pytest

from tjscan.core.frames import inverse_pose, pose, rot_z
from tjscan.groove.section import section_from_points
from tjscan.laser.profile import Profile
from tjscan.scanning.journal import StopReason, groove_length, plan_is_fulfilled, reason_to_stop
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection, Substep

RADIUS = 0.2286
GROOVE = section_from_points(
    1e-3 * np.array(((50, 0, 230), (20, 0, 230), (5, 0, 255), (0, 0, 255), (-40, 0, 190)))
)


def plan(step: float, length: float | None = None, sections: int | None = None) -> ScanPlan:
    return ScanPlan(step=step, pull_angle=0.0, offset=0.0, length=length, sections=sections)


def section(turned: float, index: int) -> ScannedSection:
    """A section whose groove origin lies on a ring of that radius, `turned` from the first."""
    R = rot_z(turned) @ np.array(((0, 0, 1), (1, 0, 0), (0, 1, 0)))
    T_b_g = pose(R, RADIUS * rot_z(turned)[:, 0])
    T_b_s = T_b_g @ inverse_pose(GROOVE.T_s_g)
    view = ProfileView(
        index, Substep.CORRECTION, T_b_s, T_b_s, Profile(np.zeros(1), np.zeros(1)), 0.0, np.zeros(6)
    )
    return ScannedSection(view, GROOVE, GROOVE.T_s_g)


def steps_until_closed(gap: float, nominal: float) -> float:
    """Turn in radians after which a scan with steps of `gap` is closed."""
    angle = 2 * np.arcsin(gap / (2 * RADIUS))
    sections = []
    for i in count():
        sections.append(section(i * angle, i))
        if reason_to_stop(plan(nominal), sections, nominal) is StopReason.CLOSED:
            return float(i * angle)
    raise AssertionError


@pytest.mark.parametrize("nominal_mm", [10, 40, 80, 100])
@pytest.mark.parametrize("stretch", [0.8, 0.97, 1.0, 1.02, 1.1])
@pytest.mark.parametrize("wobble", np.linspace(0, 0.02, 5))
def test_a_ring_is_closed_once_round_and_not_before(
    nominal_mm: int, stretch: float, wobble: float
) -> None:
    nominal = 1e-3 * nominal_mm
    gap = nominal * (stretch + wobble)
    turned = steps_until_closed(gap, nominal)
    step_angle = 2 * np.arcsin(gap / (2 * RADIUS))
    assert turned >= 2 * np.pi - 1.3 * step_angle
    assert turned <= 2 * np.pi + step_angle


def test_the_length_counts_from_the_second_section_and_ends_at_the_nearest_step() -> None:
    sections = [section(i * 0.1, i) for i in range(12)]
    step = groove_length(sections[:2])
    for steps in (3, 7):
        asked = plan(step, length=(steps + 0.4) * step)
        ends = [
            n
            for n in range(2, 12)
            if reason_to_stop(asked, sections[:n], step) is StopReason.LENGTH
        ]
        assert ends[0] == 2 + steps


def test_what_was_asked_decides_whether_a_scan_is_complete() -> None:
    assert plan_is_fulfilled(StopReason.LENGTH, plan(0.04, length=0.5))
    assert plan_is_fulfilled(StopReason.CLOSED, plan(0.04, length=5.0))
    assert plan_is_fulfilled(StopReason.UNREACHABLE, plan(0.04))
    assert not plan_is_fulfilled(StopReason.UNREACHABLE, plan(0.04, length=0.5))
    assert not plan_is_fulfilled(StopReason.LOST, plan(0.04))
