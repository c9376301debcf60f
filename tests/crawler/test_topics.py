"""What a crawl records, read again."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tjscan.crawler.journal import (
    PLANNED_PASS_TOPIC,
    CrawlCycle,
    CrawlRecording,
    PlannedPass,
    read_crawl,
)
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import STATE_COUNT, SlipEstimate
from tjscan.recording.journal import RunEvent
from tjscan.recording.topic import Topic
from tjscan.vehicle.vehicle import AT_REST, VehicleState

SLIP_TOPIC = Topic.of("/slip", SlipEstimate)


def test_slip_is_read_as_it_was_believed() -> None:
    believed = SlipEstimate(np.arange(STATE_COUNT) / 7, np.eye(STATE_COUNT) / 3)
    read = SLIP_TOPIC.decode(SLIP_TOPIC.encode(believed))
    np.testing.assert_array_equal(read.x, believed.x)
    np.testing.assert_array_equal(read.P, believed.P)


def test_slip_that_is_damaged_is_refused() -> None:
    with pytest.raises(ValueError, match="reshape"):
        SLIP_TOPIC.decode(SLIP_TOPIC.encode(SlipEstimate(np.zeros(STATE_COUNT), np.eye(8))))


def test_a_pass_of_a_program_that_stated_no_closing_is_read() -> None:
    row = np.zeros(2)
    planned = PlannedPass(1, 0.0, 1.0, 0.0, 1.0, None, None, row, row, row, row, row, row, row)
    written = json.loads(PLANNED_PASS_TOPIC.encode(planned))
    assert PLANNED_PASS_TOPIC.decode(json.dumps(written).encode()).closed is not None
    del written["closed"]
    assert PLANNED_PASS_TOPIC.decode(json.dumps(written).encode()).closed is None


@pytest.mark.parametrize(
    ("period", "struck_at", "known"),
    [
        (0.01, 3, 4),  # an arc that was struck is known at once
        (0.3, None, 9),  # and of a slow machine's cycles no more than half a second is not
        (0.01, None, 0),
    ],
)
def test_a_killed_program_leaves_what_was_done_but_for_half_a_second(
    tmp_path: Path, period: float, struck_at: int | None, known: int
) -> None:
    with CrawlRecording(tmp_path / "crawl.mcap") as journal:
        for k in range(10):
            arc = struck_at is not None and k >= struck_at
            state, torch = VehicleState(period * k, AT_REST), TorchEstimate(0.0, 1e-3, 0.0)
            cycle = CrawlCycle(Phase.WELDING, 1, 0.01 * k, state, AT_REST, torch, 0.0, 0.0, arc)
            journal.record(cycle)
        assert len(list(read_crawl(tmp_path))) == known  # as it stands while the program runs
    assert len(list(read_crawl(tmp_path))) == 10


@pytest.mark.parametrize(("period", "stops"), [(0.01, True), (0.3, False)])
def test_the_last_cycle_of_what_is_left_has_the_slip_that_was_believed_there(
    tmp_path: Path, period: float, stops: bool
) -> None:
    with CrawlRecording(tmp_path / "crawl.mcap") as journal:
        for k in range(9):
            slip = SlipEstimate(np.full(STATE_COUNT, 0.1 * k), np.eye(STATE_COUNT))
            state, torch = VehicleState(period * k, AT_REST), TorchEstimate(0.0, 1e-3, 0.0)
            cycle = CrawlCycle(Phase.WELDING, 1, 0.01 * k, state, AT_REST, torch, 0.0, 0.0, False)
            journal.record(replace(cycle, slip=slip))
        if stops:
            journal.record(RunEvent(Phase.STOP, "a drive fails"))
        left = [entry for entry in read_crawl(tmp_path) if isinstance(entry, CrawlCycle)]
    last = left[-1]
    assert last.slip is not None
    assert last.slip.x[0] == pytest.approx(10 * last.travel)
