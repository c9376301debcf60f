"""What a tow records is read again as it was."""

from dataclasses import fields
from pathlib import Path

import numpy as np
from tow_cycles import make_cycle

from tjscan.recording.journal import RunEvent
from tjscan.towing.journal import TowCycle, TowRecording, TowTruth, read_tow


def test_cycles_truth_and_events_come_back_in_their_order(tmp_path: Path) -> None:
    cycles = [make_cycle(0.1 * k) for k in range(7)]
    truth = TowTruth(
        0.0, np.ones((6, 2)), np.ones((2, 3)), np.ones(3), np.ones(2), np.empty((0, 3)), ("a",)
    )
    with TowRecording(tmp_path / "tow.mcap", truth=lambda: truth) as journal:
        journal.record(RunEvent("start", "0 mm along the seam"))
        for cycle in cycles:
            journal.record(cycle)
    entries = list(read_tow(tmp_path))
    assert isinstance(entries[0], RunEvent)
    found = [entry for entry in entries if isinstance(entry, TowCycle)]
    assert len(found) == sum(isinstance(entry, TowTruth) for entry in entries) == 7
    for was, cycle in zip(cycles, found, strict=True):
        assert (was.wait, was.stopped) == (cycle.wait, cycle.stopped)
        for field in fields(TowCycle):
            if field.name not in ("plan", "wait", "stopped"):
                before, after = (getattr(one, field.name) for one in (was, cycle))
                np.testing.assert_allclose(before, after, atol=1e-9)
        np.testing.assert_allclose(was.plan.angles, cycle.plan.angles, atol=1e-9)
        assert (was.plan.terms, was.plan.limits) == (cycle.plan.terms, cycle.plan.limits)
        assert was.plan.halt == cycle.plan.halt


def test_of_a_tow_that_is_killed_the_first_cycle_is_known_and_less_than_half_a_second_lost(
    tmp_path: Path,
) -> None:
    with TowRecording(tmp_path / "tow.mcap") as journal:
        for done in range(1, 13):
            journal.record(make_cycle(0.1 * done))
            kept = sum(isinstance(entry, TowCycle) for entry in read_tow(tmp_path))
            assert max(1, done - 4) <= kept <= done
