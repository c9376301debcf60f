"""Keys of a study that set others."""

from pathlib import Path

import pytest
from studies import Expand, expand_in, resolved_of, settings_of

from tjscan.core.units import MM


@pytest.fixture
def expand(tmp_path: Path) -> Expand:
    return expand_in(tmp_path)


def test_a_joint_can_be_varied_and_ruled(expand: Expand) -> None:
    trials = expand(
        fixed={"rule.room_mm": 100.0, "rule.step_to_brace": 0.1},
        grid={"joint.brace.outer_diameter_mm": [168.3, 610.0], "rule.leg_to_brace": [1.05, 3.0]},
    )
    for trial in trials:
        settings = settings_of(trials, trial)
        step_mm = resolved_of(trials, trial).followed["scan.step_mm"]
        joint = settings.joint.definition("joint")
        ratio = trial.inputs["rule.leg_to_brace"]
        assert joint.leg_radius / joint.brace_radius == pytest.approx(ratio, rel=1e-12)
        assert step_mm == pytest.approx(200 * joint.brace_radius, abs=0.05)
        assert MM.to_file(settings.job.scan.step) == step_mm
