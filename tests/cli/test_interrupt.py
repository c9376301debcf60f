"""Ctrl-C: once the scan ends after its section, twice the arm stops; it can go on either way."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np
import pytest
from cells import FAULTLESS, PAPER, Notes, scan_example
from command import tjscan

from tjscan.core.errors import Interrupted
from tjscan.scanning.progress import StopReason
from tjscan.scanning.reader import read_entries, read_scan
from tjscan.scanning.recorded import RecordedEvent
from tjscan.scanning.section import View
from tjscan.scanning.stopping import StopRequest

SAME = 1e-9
"""Millimetres: what rounding leaves when noise is off."""

OPTIONS = [word for key, value in FAULTLESS.items() for word in (f"--{key}", str(value))]
ALL = ["--scan.sections", "16"]

LEISURELY, CRAWLING = 100, 1
"""Millimetres per second: at the one some ten seconds of scan are left, at the other minutes of
every section. Whatever else the machine does, a key is pressed before they are over."""


def recorded(run: Path) -> tuple[np.ndarray, list[str]]:
    """The five points of every section as recorded, in mm, and the names of events."""
    scan = read_scan(run)
    points = [scan.sections[i].points_b for i in sorted(scan.sections)]
    return 1e3 * np.array(points), [event.name for event in scan.events]


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that ended at its fourth section; the arm stands there."""
    run = tmp_path_factory.mktemp("runs") / "begun"
    assert tjscan("scan", PAPER, "--out", run, "--scan.sections", "4", *OPTIONS) == 0
    (run / "summary.json").unlink()
    return run


@pytest.fixture(scope="module")
def whole(begun: Path, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Sections of a run that nothing interrupted."""
    run = shutil.copytree(begun, tmp_path_factory.mktemp("runs") / "whole")
    assert tjscan("scan", "--resume", run, *ALL) == 0
    return recorded(run)[0]


@contextmanager
def scanning(run: Path, speed: int) -> Iterator[tuple["subprocess.Popen[str]", IO[str]]]:
    """A process that goes on with a scan in real time."""
    command = [sys.executable, "-c", "from tjscan.cli import main; main()", "scan", "--resume"]
    options = [str(run), "--realtime", "--arm.speed-mm-s", str(speed), *ALL]
    with subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        while process.poll() is None and "resumed" not in events_in(run / "scan-2.mcap"):
            os.sched_yield()
        try:
            yield process, process.stderr
        finally:
            process.kill()


def events_in(recording: Path) -> list[str]:
    if not recording.exists():
        return []
    return [entry.name for _, entry in read_entries(recording) if isinstance(entry, RecordedEvent)]


def press(process: "subprocess.Popen[str]", told: IO[str]) -> None:
    """Press Ctrl-C, and wait until it was heard."""
    process.send_signal(signal.SIGINT)
    for line in told:
        if "stopping after the section" in line:
            return
    raise AssertionError


def test_ctrl_c_once_ends_the_scan_after_its_section(
    begun: Path, whole: np.ndarray, tmp_path: Path
) -> None:
    run = shutil.copytree(begun, tmp_path / "run")
    with scanning(run, LEISURELY) as (process, told):
        press(process, told)
        process.communicate()
    assert process.returncode == 130
    sections, events = recorded(run)
    assert events[-2:] == ["stop requested", "stop"]
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    assert summary["stopped_because"] == "stop requested"
    assert not summary["complete"]
    assert 4 < summary["sections"] == len(sections) < len(whole)
    assert tjscan("scan", "--resume", run, *ALL) == 0
    np.testing.assert_allclose(recorded(run)[0], whole, atol=SAME)


def test_ctrl_c_twice_stops_the_arm_and_all_is_recorded(
    begun: Path, whole: np.ndarray, tmp_path: Path
) -> None:
    run = shutil.copytree(begun, tmp_path / "run")
    with scanning(run, CRAWLING) as (process, told):
        press(process, told)
        process.send_signal(signal.SIGINT)
        rest = process.communicate()[1]
    assert process.returncode == 130
    assert "interrupted" in rest
    assert "Traceback" not in rest
    sections, events = recorded(run)
    assert events[-1] == "interrupted"
    assert len(sections) == 4
    assert not (run / "summary.json").exists()
    assert tjscan("scan", "--resume", run, *ALL) == 0
    np.testing.assert_allclose(recorded(run)[0], whole, atol=SAME)


class StopsAfter(Notes):
    """Asks for an end when so many profiles were taken."""

    def __init__(self, profiles: int, *, at_once: bool) -> None:
        super().__init__()
        self.stop, self._profiles, self._at_once = StopRequest(), profiles, at_once

    def view(self, view: View) -> None:
        super().view(view)
        if len(self.views) == self._profiles:
            (self.stop.ask_at_once if self._at_once else self.stop.ask)()


@pytest.mark.parametrize(("profiles", "sections"), [(1, 2), (2, 2), (3, 3), (4, 3), (5, 4)])
def test_the_section_under_way_is_finished_and_no_other_is_begun(
    profiles: int, sections: int
) -> None:
    notes = StopsAfter(profiles, at_once=False)
    result = scan_example({}, notes=notes, stop=notes.stop)
    assert result.stop is StopReason.REQUESTED
    assert len(result.sections) == sections
    assert [name for name, _ in notes.events] == ["stop requested", "stop"]


@pytest.mark.parametrize("profiles", [1, 2, 3, 4])
def test_nothing_moves_after_an_end_at_once(profiles: int) -> None:
    notes = StopsAfter(profiles, at_once=True)
    with pytest.raises(Interrupted):
        scan_example({}, notes=notes, stop=notes.stop)
    assert len(notes.views) == profiles


def test_a_request_stops_the_arm_of_the_scan_that_hears_it_and_no_other() -> None:
    stops: list[str] = []
    request = StopRequest()
    assert not request.heard
    with request.halting(lambda: stops.append("arm")):
        assert request.heard
        request.ask()
        assert stops == []
        request.ask_at_once()
    assert not request.heard
    request.ask_at_once()
    assert stops == ["arm"]
