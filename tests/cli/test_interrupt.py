"""Ctrl-C: once the scan ends after its section, twice the arm stops; it can go on either way."""

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

import gated_scan
import numpy as np
import pytest
from cells import FAULTLESS, PAPER, Notes, scan_example
from command import tjscan

from tjscan.cli.interrupt import ctrl_c_presser
from tjscan.core.errors import ScanInterrupted
from tjscan.scanning.journal import StopReason
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ProfileView
from tjscan.scanning.stopping import StopRequest

SAME = 1e-9
"""Millimetres: what rounding leaves when noise is off."""

OPTIONS = [word for key, value in FAULTLESS.items() for word in (f"--{key}", str(value))]
ALL = ["--scan.sections", "16"]

CRAWLING = (
    "import sys; from tjscan.cli import main; "
    "sys.argv += ['--realtime', '--arm.speed-mm-s', '1']; main()"
)
"""A scan at one millimetre per second: minutes are left of the section when keys are pressed."""


def recorded(run: Path) -> tuple[np.ndarray, list[str]]:
    """The five points of every section as recorded, in mm, and the names of events."""
    scan = read_recorded_scan(run)
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
def scanning(run: Path, *command: str, until: str) -> Iterator["subprocess.Popen[str]"]:
    """A process that goes on with a scan, once it has written some words."""
    words, pipe = [*command, "scan", "--resume", str(run), *ALL], subprocess.PIPE
    with subprocess.Popen([sys.executable, *words], stdin=pipe, stderr=pipe, text=True) as process:
        try:
            wait_for(process, until)
            yield process
        finally:
            process.kill()


def wait_for(process: "subprocess.Popen[str]", words: str) -> None:
    """Read what a process writes until it has written some words."""
    assert process.stderr is not None
    assert any(words in line for line in process.stderr)


def press(process: "subprocess.Popen[str]") -> None:
    """Press Ctrl-C, and wait until it is answered."""
    process.send_signal(signal.SIGINT)
    wait_for(process, "stopping after the section")


def test_ctrl_c_once_ends_the_scan_after_its_section(
    begun: Path, whole: np.ndarray, tmp_path: Path
) -> None:
    run = shutil.copytree(begun, tmp_path / "run")
    with scanning(run, gated_scan.__file__, until=gated_scan.UNDER_WAY) as process:
        press(process)
        process.communicate("go on\n")
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
    with scanning(run, "-c", CRAWLING, until="resumed: after section 3") as process:
        press(process)
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

    def record(self, message: object) -> None:
        super().record(message)
        if isinstance(message, ProfileView) and len(self.views) == self._profiles:
            (
                self.stop.request_stop_now
                if self._at_once
                else self.stop.request_stop_after_section
            )()


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
    with pytest.raises(ScanInterrupted):
        scan_example({}, notes=notes, stop=notes.stop)
    assert len(notes.views) == profiles


def test_a_request_stops_the_arm_of_the_scan_that_hears_it_and_no_other() -> None:
    stops: list[str] = []
    request = StopRequest()
    assert not request.scan_is_running
    with request.halt_arm_on_stop_now(lambda: stops.append("arm")):
        assert request.scan_is_running
        request.request_stop_after_section()
        assert stops == []
        request.request_stop_now()
    assert not request.scan_is_running
    request.request_stop_now()
    assert stops == ["arm"]


def press_and_wait(press: Callable[[], None]) -> None:
    """Press in another thread, and wait for nothing but that."""
    Thread(target=press).start()
    Event().wait(30)


def test_a_stop_on_a_page_is_heard_where_ctrl_c_is_not() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as of a script's background process
    try:
        press = ctrl_c_presser()
        with pytest.raises(KeyboardInterrupt):
            press_and_wait(press)
    finally:
        signal.signal(signal.SIGINT, before)
