"""What a scan does when a profile is bad: it goes on where it can, and claims nothing wrong."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from _sensors import Fault, FaultyLaser, empty, frozen, late, missing, spurious
from cells import FAULTLESS, Notes, example_corner_errors, reading_fails_at, scan_example

from tjscan.core.errors import GrooveNotFound, LaserFault
from tjscan.core.frames import pose, rot_y
from tjscan.groove.prior import GroovePrior
from tjscan.groove.read import read_groove
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile
from tjscan.recording.journal import CombinedJournal, RunEvent
from tjscan.scanning.journal import (
    RecordedScan,
    RetryCounts,
    ScanEvent,
    ScanResult,
    ScanResultsJournal,
    StopReason,
    untaught_step_lengths,
)
from tjscan.scanning.profile_taker import AGREEING_PROFILES, merge_repeated_profiles
from tjscan.scanning.retries import MOST_MISSING_PROFILES
from tjscan.scanning.section import Substep
from tjscan.scanning.sections_before import GrooveReader, check_section_orientation

SHORT = {"scan.sections": 7}
TRUE_CORNER = 0.4e-3
"""Metres: a corner further from its edge than the scan's own 95th percentile may be is wrong."""

SIDE_VIEW = 2 + 2 * 2
"""Number of a profile in the middle of a scan: the prediction view of section 4."""


def bursts(fault: Fault, seed: int) -> Callable[[int], Fault | None]:
    """One to five captures in a row that fail, about one time in six."""
    rng = np.random.default_rng(seed)
    failing = np.zeros(400, dtype=bool)
    for start in np.flatnonzero(rng.random(400) < 0.15).tolist():
        if not failing[max(start - 1, 0)]:
            failing[start : start + int(rng.integers(1, 6))] = True
    return lambda k: fault if bool(failing[k]) else None


def scan_with(faults: Callable[[int], Fault | None], notes: Notes | None = None) -> ScanResult:
    return scan_example(SHORT, notes=notes, through=lambda laser: FaultyLaser(laser, faults))


@pytest.mark.parametrize("fault", [missing, empty, frozen, late], ids=lambda f: str(f.__name__))
def test_up_to_five_bad_profiles_in_a_row_cost_no_section(fault: Fault) -> None:
    notes = Notes()
    result = scan_with(bursts(fault, 3), notes)
    assert result.stop is StopReason.SECTIONS
    assert result.counts.taken_again > 0
    assert result.counts == RetryCounts(taken_again=result.counts.taken_again)
    assert example_corner_errors(result).max() < TRUE_CORNER
    assert {name for name, _ in notes.events} == {"taken again", "stop"}


@pytest.mark.parametrize("back", [1, 2, 3, 4])
def test_no_profile_of_another_place_is_taken_however_old_it_is(back: int) -> None:
    given: list[Profile] = []

    def out_of_a_ring(now: Profile, before: Profile) -> Profile:
        return replace(given[-back], time=now.time)

    class Remembering(FaultyLaser):
        def capture(self) -> Profile:
            given.append(super().capture())
            return given[-1]

    failing = range(SIDE_VIEW, SIDE_VIEW + MOST_MISSING_PROFILES)
    result = scan_example(
        SHORT,
        through=lambda laser: Remembering(laser, lambda k: out_of_a_ring if k in failing else None),
    )
    assert result.stop is StopReason.SECTIONS
    assert result.counts == RetryCounts(taken_again=MOST_MISSING_PROFILES)
    assert example_corner_errors(result).max() < TRUE_CORNER


@pytest.mark.parametrize(("share", "merges"), [(0.3, False), (0.55, True)])
def test_points_anywhere_cost_no_section(share: float, merges: bool) -> None:
    # A third of them is read as it is; of profiles with over a half, several are merged.
    fault = spurious(share, 5)
    result = scan_with(lambda k: fault)
    assert result.stop is StopReason.SECTIONS
    assert (result.counts.merged > 0) is merges
    assert example_corner_errors(result).max() < TRUE_CORNER


@pytest.mark.parametrize("fault", [missing, frozen, late], ids=lambda f: str(f.__name__))
def test_a_laser_that_stays_away_ends_the_scan_and_what_was_found_is_told(fault: Fault) -> None:
    notes = Notes()
    with pytest.raises(LaserFault, match=f"{MOST_MISSING_PROFILES + 1} profiles in a row"):
        scan_with(lambda k: fault if k >= SIDE_VIEW else None, notes)
    assert len(notes.sections) == 4
    assert [name for name, _ in notes.events] == ["taken again"] * MOST_MISSING_PROFILES


def test_a_groove_that_is_gone_ends_the_scan_after_every_remedy() -> None:
    notes = Notes()
    result = scan_with(lambda k: empty if k >= SIDE_VIEW else None, notes)
    assert result.stop is StopReason.LOST
    assert "not there any more" in result.detail
    assert notes.sections == list(result.sections)
    assert len(result.sections) == 4
    order = list(dict.fromkeys(name for name, _ in notes.events))
    assert order == ["taken again", "nudge", "half step", "retreat", "stop"]
    assert result.counts.half_steps == result.counts.retreats == 1


def test_a_joint_has_not_moved_if_the_section_before_the_last_is_where_it_was() -> None:
    notes = Notes()
    found: list[Profile] = []

    def read(profile: Profile, *, prior: GroovePrior | None = None) -> GrooveSection:
        if len(notes.sections) == 4 and not found:
            if not np.allclose(notes.views[-1].T_b_f, notes.sections[-2].view.T_b_f, atol=1e-3):
                raise GrooveNotFound("no bevel", "hidden")
            found.append(profile)
        return read_groove(profile, prior=prior)

    result = scan_example(SHORT, notes=notes, read=read)
    assert found
    assert result.stop is StopReason.SECTIONS
    assert result.counts.retreats == 1
    assert example_corner_errors(result).max() < TRUE_CORNER


@pytest.mark.parametrize(
    ("first", "profiles"),
    [*((SIDE_VIEW, k) for k in (1, 2, 3, 4)), *((SIDE_VIEW + 1, k) for k in (1, 2, 3))],
)
def test_the_mildest_remedy_that_helps_is_taken(first: int, profiles: int) -> None:
    # Noise off: what is taken again is the same, so nothing can be merged.
    notes = Notes()
    failing = range(first, first + profiles)
    result = scan_example(FAULTLESS | SHORT, notes=notes, read=reading_fails_at(failing))
    assert result.stop is StopReason.SECTIONS
    assert [name for name, _ in notes.events] == [
        "taken again",
        *["nudge"] * (profiles - 1),
        "stop",
    ]
    np.testing.assert_allclose(untaught_step_lengths(result.sections), 0.040, rtol=0.03)
    assert len(notes.views) == len(result.views)  # the profiles that could not be read as well


def test_where_a_correction_shows_nothing_the_prediction_view_is_taken_once_more() -> None:
    # Case 1 at 60 mm: the correction turns the sensor a lot.
    keys = FAULTLESS | {"scan.sections": 5, "scan.prediction_case": 1, "scan.step_mm": 60.0}
    result = scan_example(keys, read=reading_fails_at(range(SIDE_VIEW + 1, SIDE_VIEW + 4)))
    predicted, *_, last = [v for v in result.views if v.index == 4]
    section = result.sections[4]
    assert result.stop is StopReason.SECTIONS
    assert section.view is last
    assert last.substep is Substep.CORRECTION
    np.testing.assert_allclose(last.T_b_f, predicted.T_b_f, atol=1e-6)
    assert example_corner_errors(result).max() < TRUE_CORNER


@pytest.mark.parametrize(
    ("first", "nudges"), [(SIDE_VIEW, 4), (SIDE_VIEW + 1, 2)], ids=["prediction", "correction"]
)
def test_where_nothing_is_read_a_shorter_step_is_made(first: int, nudges: int) -> None:
    notes = Notes()
    result = scan_example(
        FAULTLESS | SHORT, notes=notes, read=reading_fails_at(range(first, first + 2 + nudges))
    )
    assert result.stop is StopReason.SECTIONS
    assert result.counts == RetryCounts(taken_again=1, nudges=nudges, half_steps=1)
    assert untaught_step_lengths(result.sections)[2] == pytest.approx(0.020, rel=0.03)
    assert untaught_step_lengths(result.sections)[3] == pytest.approx(0.040, rel=0.03)


def test_where_that_does_not_help_the_last_section_is_seen_again() -> None:
    result = scan_example(
        FAULTLESS | SHORT, read=reading_fails_at(range(SIDE_VIEW, SIDE_VIEW + 12))
    )
    assert result.stop is StopReason.SECTIONS
    assert result.counts == RetryCounts(taken_again=2, nudges=8, half_steps=1, retreats=1)
    assert [v.index for v in result.views if v.substep is Substep.RESUMED] == [3]
    assert untaught_step_lengths(result.sections)[2] == pytest.approx(0.010, rel=0.05)


def readings_changed_from(first: int, change: Callable[[Profile], Profile]) -> GrooveReader:
    """A reader that sees something else from a profile on."""
    count = iter(range(10_000))

    def read(profile: Profile, *, prior: GroovePrior | None = None) -> GrooveSection:
        return read_groove(change(profile) if next(count) >= first else profile, prior=prior)

    return read


@pytest.mark.parametrize(
    "change",
    [
        lambda p: Profile(p.x_s + 0.05, p.z_s, None, p.time),
        lambda p: Profile(p.x_s * 1.35, p.z_s * 1.35, None, p.time),
        lambda p: Profile(0.5 * p.x_s, p.z_s, None, p.time),
    ],
    ids=["elsewhere", "larger", "steeper"],
)
def test_another_groove_is_not_taken_for_this_one(change: Callable[[Profile], Profile]) -> None:
    result = scan_example(FAULTLESS | SHORT, read=readings_changed_from(SIDE_VIEW, change))
    assert result.stop is StopReason.LOST
    assert len(result.sections) == 4
    assert example_corner_errors(result).max() < TRUE_CORNER


def test_a_correction_that_shows_another_place_than_the_prediction_is_not_believed() -> None:
    # The arm's pose is right, the profile is that of a sensor that stands 4 mm beside.
    count = iter(range(10_000))

    def read(profile: Profile, *, prior: GroovePrior | None = None) -> GrooveSection:
        shift = 0.004 if next(count) >= SIDE_VIEW + 1 else 0.0
        moved = Profile(profile.x_s + shift, profile.z_s, None, profile.time)
        return read_groove(moved, prior=prior)

    notes = Notes()
    keys = FAULTLESS | {"scan.sections": 5, "scan.prediction_case": 2}
    scan_example(keys, read=read, notes=notes)
    assert notes.events[0][0] == "taken again"
    assert "from where the prediction view showed them" in notes.events[0][1]


def profiles(count: int, spurious_share: float, seed: int) -> tuple[Profile, list[Profile]]:
    """A bent line, and noisy profiles of it of which a share of the points lies anywhere."""
    rng = np.random.default_rng(seed)
    x_s = np.linspace(-0.04, 0.04, 300)
    true = Profile(x_s, 0.23 + 0.3 * np.abs(x_s))
    noisy = []
    for _ in range(count):
        z_s = true.z_s + rng.normal(0, 0.03e-3, 300)
        z_s = np.where(rng.random(300) < spurious_share, rng.uniform(0.19, 0.29, 300), z_s)
        noisy.append(Profile(x_s, np.where(rng.random(300) < 0.05, np.nan, z_s), time=2.0))
    return true, noisy


@pytest.mark.parametrize("seed", range(5))
def test_what_most_profiles_agree_on_is_kept_and_nothing_else(seed: int) -> None:
    true, noisy = profiles(7, 0.3, seed)
    merged = merge_repeated_profiles(noisy)
    assert merged is not None
    assert merged.time == 2.0
    off = np.abs(merged.z_s - true.z_s)[merged.valid]
    assert len(off) > 0.9 * 300
    assert np.mean(off > 0.2e-3) < 0.005


def test_profiles_without_faults_merge_to_their_mean() -> None:
    true, noisy = profiles(7, 0.0, 1)
    merged = merge_repeated_profiles(noisy)
    assert merged is not None
    assert np.nanstd(merged.z_s - true.z_s) < 0.03e-3 / np.sqrt(5)


def test_copies_of_one_profile_agree_on_nothing() -> None:
    _, noisy = profiles(1, 0.3, 1)
    assert merge_repeated_profiles(noisy * 7) is None
    _, noisy = profiles(AGREEING_PROFILES - 1, 0.0, 1)
    assert merge_repeated_profiles(noisy) is None


def test_a_groove_seen_from_behind_is_refused() -> None:
    groove = scan_example(FAULTLESS | {"scan.sections": 3}).sections[-1].groove
    check_section_orientation(groove)
    for axis in (rot_y(np.pi), np.diag((1.0, -1.0, -1.0))):
        with pytest.raises(GrooveNotFound, match="not above"):
            check_section_orientation(replace(groove, T_s_g=pose(axis) @ groove.T_s_g))


def test_what_was_counted_before_a_cut_counts_on() -> None:
    event = RunEvent(ScanEvent.MERGED, "section 1")
    done = RecordedScan(None, (), {}, (event,))
    log = ScanResultsJournal(CombinedJournal())
    log.restore_from_recording(done, ())
    log.record_event(ScanEvent.MERGED, "section 2")
    assert done.retry_counts.merged == 1
    assert log.counts.merged == 2
