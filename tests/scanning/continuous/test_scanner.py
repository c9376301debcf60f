"""Laws of the continuous scan on the example's cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from cells import CLOCKWISE, PAPER, Notes, example_corner_errors
from continuous_scans import HeardThrough, flange_speeds, passing_views, scan_continuously

from tjscan.core.errors import ArmFault, ConfigurationError, LaserFault
from tjscan.laser.line_laser import StreamedProfile
from tjscan.laser.profile import Profile
from tjscan.recording.journal import RunEvent
from tjscan.scanning.journal import ScanEvent, StopReason, reason_to_stop
from tjscan.scanning.section import ProfileView, ScannedSection, Substep
from tjscan.scanning.stopping import StopRequest

AT_REST = 2e-3
"""Metres per second: slower is at rest."""


@pytest.mark.parametrize("file", [PAPER, CLOCKWISE], ids=["ccw", "cw"])
def test_the_groove_is_followed_without_a_stop_and_measured_every_2_mm(file: object) -> None:
    notes = Notes()
    result = scan_continuously({}, file=file, notes=notes)  # type: ignore[arg-type]
    assert result.stop is StopReason.LENGTH
    assert result.counts.stepwise == 0
    measured = result.sections[1:]
    steps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in measured], axis=0), axis=1)
    assert abs(steps.mean() - 2e-3) < 0.1e-3
    errors = 1e3 * example_corner_errors(replace(result, sections=tuple(measured)), file)  # type: ignore[arg-type]
    assert errors.mean() <= 0.07
    assert np.percentile(errors, 95) <= 0.15
    speeds = flange_speeds(passing_views(notes))
    moving = np.flatnonzero(speeds > AT_REST)
    assert (speeds[moving[0] : moving[-1]] > AT_REST).all()


def test_every_profile_is_recorded_before_its_section() -> None:
    notes = Notes()
    result = scan_continuously({}, notes=notes)
    fused = {v.index: v for v in notes.views if v.substep is Substep.FUSED}
    for section in result.sections[1:]:
        assert fused[section.view.index] is section.view
    times = np.array([view.time for view in passing_views(notes)])
    assert np.median(np.diff(times)) == pytest.approx(5e-3, rel=1e-3)
    assert (np.diff(times) > 0).all()


def test_a_silent_laser_brings_the_arm_to_rest_on_the_path_and_it_goes_on() -> None:
    notes = Notes()
    silent = HeardThrough(lambda n, profile: None if 300 <= n < 740 else profile)
    result = scan_continuously({}, notes=notes, through=silent)
    assert result.stop is StopReason.LENGTH
    steps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in result.sections], axis=0), axis=1)
    assert steps.max() < 4.5e-3  # it returned to where it had read last
    assert example_corner_errors(result)[1:].max() < 0.4e-3


def test_a_laser_that_stays_silent_is_a_fault_of_the_laser() -> None:
    dead = HeardThrough(lambda n, profile: None if n > 100 else profile)
    with pytest.raises(LaserFault, match="no profile"):
        scan_continuously({}, through=dead)


def test_repeated_profiles_are_not_taken_for_new_ones() -> None:
    kept: list[Profile | None] = []

    def stuck(n: int, profile: Profile | None) -> Profile | None:
        kept.append(profile if not 150 <= n < 200 else kept[149])
        return kept[-1]

    notes = Notes()
    scan_continuously({}, notes=notes, through=HeardThrough(stuck))
    digests = [view.profile.digest for view in passing_views(notes)]
    assert len(set(digests)) == len(digests)


def test_where_the_groove_cannot_be_read_the_scan_steps_over_and_says_so() -> None:
    blank = np.full(640, np.nan)

    def blind(n: int, profile: Profile | None) -> Profile | None:
        if profile is None or not 150 <= n < 800:
            return profile
        return replace(profile, x_s=blank, z_s=blank)

    notes = Notes()
    result = scan_continuously({}, notes=notes, through=HeardThrough(blind))
    assert result.stop is StopReason.LENGTH
    assert result.counts.stepwise >= 1
    assert any(name == ScanEvent.STEPWISE and "too few points" in d for name, d in notes.events)


class StopsAt(Notes):
    """Asks for a stop with the section of a number."""

    def __init__(self, ask: object, index: int) -> None:
        super().__init__()
        self._ask, self._index = ask, index

    def record(self, message: object) -> None:
        super().record(message)
        if isinstance(message, ScannedSection) and message.view.index == self._index:
            self._ask()  # type: ignore[operator]


def test_a_stop_after_the_section_ends_at_rest_on_the_path() -> None:
    stop = StopRequest()
    notes = StopsAt(stop.request_stop_after_section, 20)
    result = scan_continuously({"scan.length_mm": 300.0}, notes=notes, stop=stop)
    assert len(result.sections) < 50  # of 170
    assert result.stop is StopReason.REQUESTED
    assert flange_speeds(passing_views(notes))[-3:].max() < AT_REST


def test_a_stop_now_leaves_what_was_measured() -> None:
    stop = StopRequest()
    notes = StopsAt(stop.request_stop_now, 20)
    with pytest.raises((ArmFault, Exception)) as raised:
        scan_continuously({}, notes=notes, stop=stop)
    assert type(raised.value).__name__ == "ScanInterrupted"
    assert len(notes.sections) == 21
    assert isinstance(notes.views[-1], ProfileView)


def test_a_groove_that_closes_ends_the_scan_where_it_began(monkeypatch: pytest.MonkeyPatch) -> None:
    def closes(plan: object, sections: list[ScannedSection], step: float) -> StopReason | None:
        done = reason_to_stop(plan, sections, step)  # type: ignore[arg-type]
        return StopReason.CLOSED if len(sections) > 30 else done

    monkeypatch.setattr("tjscan.scanning.continuous.scanner.reason_to_stop", closes)
    notes = Notes()
    result = scan_continuously({"scan.length_mm": 300.0}, notes=notes)
    assert result.stop is StopReason.CLOSED
    assert len(result.sections) == 31
    assert flange_speeds(passing_views(notes))[-3:].max() < AT_REST


@pytest.mark.parametrize("hidden", [range(190), range(60, 400)], ids=["first", "most"])
def test_a_shuttle_that_does_not_see_the_groove_all_the_way_is_refused(hidden: range) -> None:
    blank = np.full(640, np.nan)

    class Blinded(HeardThrough):
        def stream(self, period: float) -> Iterator[StreamedProfile | None]:
            for n, streamed in enumerate(self.laser.stream(period)):
                hides = replace(streamed.profile, x_s=blank, z_s=blank)
                yield StreamedProfile(hides) if n in hidden else streamed

    with pytest.raises(LaserFault, match="quarters"):
        scan_continuously({}, through=Blinded(lambda n, profile: profile))


def test_stamps_that_leap_end_the_scan_as_a_fault() -> None:
    def leaps(n: int, profile: Profile | None) -> Profile | None:
        late = 0.4 if n > 200 else 0.0
        return None if profile is None else replace(profile, time=profile.time + late)

    with pytest.raises(LaserFault, match="leaps"):
        scan_continuously({}, through=HeardThrough(leaps))


def test_profiles_taken_before_the_arm_follows_are_left_out() -> None:
    class Buffering(HeardThrough):
        def stream(self, period: float) -> Iterator[StreamedProfile | None]:
            for n, streamed in enumerate(self.laser.stream(period)):
                early = replace(streamed.profile, time=streamed.profile.time - 0.5)
                yield StreamedProfile(early) if n < 2 else streamed

    notes = Notes()
    result = scan_continuously({}, notes=notes, through=Buffering(lambda n, profile: profile))
    assert result.stop is StopReason.LENGTH
    times = [view.time for view in notes.views if view.substep is Substep.PASSING]
    assert np.diff(times).max() < 0.5  # nor is one taken for later


def test_what_is_not_seen_on_the_way_is_gone_back_to() -> None:
    notes = Notes()
    silent = HeardThrough(lambda n, profile: None if 300 <= n < 380 else profile)
    result = scan_continuously({}, notes=notes, through=silent)
    assert result.counts.retreats >= 1
    steps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in result.sections], axis=0), axis=1)
    assert steps.max() < 4.5e-3


def test_a_scan_that_goes_on_by_single_steps_leaves_nothing_out() -> None:
    stop = StopRequest()
    notes = StopsAt(stop.pause, 20)
    original = notes.record

    def record(message: object) -> None:
        original(message)
        if isinstance(message, RunEvent) and message.name == ScanEvent.PAUSED:
            stop.go_one_step() if len(notes.sections) < 26 else stop.go_on()

    notes.record = record  # type: ignore[method-assign]
    result = scan_continuously({}, notes=notes, stop=stop)
    assert result.stop is StopReason.LENGTH
    steps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in result.sections], axis=0), axis=1)
    assert steps.max() < 4.5e-3


def test_poses_that_lead_the_other_way_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="behind it"):
        scan_continuously({"scan.direction": "clockwise"})
