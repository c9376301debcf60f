"""Laws of a scan of a tacked joint: tack welds are recorded and stepped over, never started on."""

from dataclasses import replace

import numpy as np
import pytest
from cells import (
    EXAMPLES,
    FAULTLESS,
    Notes,
    example_corner_errors,
    reading_fails_at,
    scan_example,
)

from tjscan.core.errors import StartOnTack
from tjscan.groove.root import WELD_IN_ROOT
from tjscan.groove.section import section_from_points
from tjscan.laser.profile import Profile
from tjscan.scanning.journal import ScanEvent, StopReason, untaught_step_lengths
from tjscan.scanning.retries import step_retries
from tjscan.scanning.section import ProfileView, ScannedSection, Substep
from tjscan.scanning.sections_before import name_tack_of_section

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


def section_with(
    width: float, depth: float, conditions: tuple[str, ...] = (), sigma: float = 0.1e-3
) -> ScannedSection:
    """A section whose root is so wide and so far behind the wall, metres."""
    z_root = 0.23 + depth
    groove = section_from_points(
        [
            (0.05, 0, 0.23),
            (0.015, 0, 0.23),
            (0.0, 0, z_root),
            (-width, 0, z_root),
            (-0.04, 0, 0.2),
        ],
        covariance=np.diag([sigma**2] * 6 + [1e-6] * 2),
    )
    nowhere = Profile(np.empty(0), np.empty(0))
    view = ProfileView(0, Substep.PREDICTION, np.eye(4), np.eye(4), nowhere, 0.0, np.zeros(6))
    return ScannedSection(view, replace(groove, conditions=conditions), np.eye(4))


ROOT = section_with(0.006, 0.023)


def test_weld_metal_that_lies_higher_than_the_root_before_is_a_tack() -> None:
    found = name_tack_of_section(section_with(0.011, 0.018, (WELD_IN_ROOT,)), [ROOT]).groove
    assert found.on_tack
    assert found.absent == ("p3", "p4")
    assert WELD_IN_ROOT not in found.conditions
    sigmas = np.sqrt(np.trace(found.corner_covariances_s, axis1=1, axis2=2))
    assert sigmas[0] == pytest.approx(0.1e-3 * np.sqrt(2))
    assert (sigmas[1:] > BURIED).all()


@pytest.mark.parametrize(
    ("found", "before"),
    [
        (section_with(0.0065, 0.0225, (WELD_IN_ROOT,)), [ROOT]),  # a bead that bulges
        (section_with(0.011, 0.018), [ROOT]),  # a flat root: another groove, not a weld over it
        (section_with(0.011, 0.018, (WELD_IN_ROOT,)), []),  # nothing to compare it with
        (section_with(0.011, 0.018, (WELD_IN_ROOT,)), [section_with(0.011, 0.018)]),
        (section_with(0.011, 0.018, (WELD_IN_ROOT,)), [section_with(0.006, 0.023, sigma=2e-3)]),
    ],
    ids=["bulge", "flat", "first", "same as before", "not known before"],
)
def test_without_a_rise_over_the_root_before_there_is_no_tack(
    found: ScannedSection, before: list[ScannedSection]
) -> None:
    assert name_tack_of_section(found, before) is found


def test_from_tack_to_tack_the_root_before_them_counts() -> None:
    tack = section_with(0.011, 0.018, (WELD_IN_ROOT,))
    first = name_tack_of_section(tack, [ROOT])
    assert name_tack_of_section(tack, [ROOT, first]).groove.on_tack


def test_what_hides_the_groove_for_longer_than_a_step_is_stepped_over() -> None:
    notes = Notes()
    # Nothing is read from the full, the half and the quarter step, each with the views beside it;
    # before the quarter step, and before the long one, the last section is seen once more.
    hidden = {*range(6, 18), *range(19, 25)}
    result = scan_example(
        FAULTLESS | {"scan.sections": 6, "scan.step_mm": 10.0},
        notes=notes,
        read=reading_fails_at(hidden),
    )
    assert result.stop is StopReason.SECTIONS
    names = [name for name, _ in notes.events if name in ("half step", "retreat", "step over")]
    assert names == ["half step", "retreat", "step over"]
    assert untaught_step_lengths(result.sections)[2] == pytest.approx(0.030, rel=0.05)
    assert untaught_step_lengths(result.sections)[3] == pytest.approx(0.010, rel=0.05)


def test_out_of_reach_no_longer_step_is_tried() -> None:
    events = [retry.event for retry in step_retries(0.010, past_tacks=False)]
    assert events == [ScanEvent.HALF_STEP, ScanEvent.RETREAT]
