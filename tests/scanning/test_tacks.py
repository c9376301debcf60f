"""Laws of a scan of a tacked joint: tack welds are recorded and stepped over, never started on."""

import numpy as np
import pytest
from cells import EXAMPLES, Notes, example_corner_errors, scan_example

from tjscan.core.errors import StartOnTack
from tjscan.scanning.events import ScanEvent
from tjscan.scanning.progress import StopReason

YARD = EXAMPLES / "yard-joint.toml"
BURIED = 2e-3
"""Metres: under a weld of some millimetres a corner is not known better than that."""

EDGE = 0.8e-3
"""Metres that corners of the seen groove lie from the edges: facets, scale and fit-up."""


def test_a_section_on_a_tack_is_recorded_as_tack_and_stepped_over() -> None:
    notes = Notes()
    result = scan_example({"scan.sections": 7}, file=YARD, notes=notes)
    assert result.stop is StopReason.SECTIONS
    assert [section.groove.on_tack for section in result.sections] == [False] * 4 + [True] + [
        False
    ] * 2
    assert [name for name, _ in notes.events if name == ScanEvent.TACK] == [ScanEvent.TACK]
    assert result.counts.half_steps == result.counts.retreats == 0


def test_a_tack_buries_the_root_and_its_sigma_says_how_deep() -> None:
    result = scan_example({"scan.sections": 6}, file=YARD)
    errors = example_corner_errors(result, YARD)
    tack = result.sections[4]
    assert tack.groove.absent == ("p3", "p4")
    sigmas = np.sqrt(np.trace(tack.groove.corner_covariances_s, axis1=1, axis2=2))
    assert errors[4, 0] < EDGE
    assert sigmas[0] < EDGE
    assert (sigmas[1:] > BURIED).all()


@pytest.mark.parametrize("which", ["first", "second"])
def test_a_taught_pose_on_a_tack_says_to_move_on(which: str) -> None:
    on_tack = {
        f"scan.{which}.position_mm": [-60.3, 949.6, 360.1],
        f"scan.{which}.euler_zyx_deg": [7.47, -63.96, 160.79],
    }
    with pytest.raises(StartOnTack, match=f"the {which} taught pose.*Move 20 mm on"):
        scan_example(on_tack, file=YARD)
