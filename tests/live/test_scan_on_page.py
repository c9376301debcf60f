"""A scan on the page: the same scan, whatever becomes of the page."""

import socket
from pathlib import Path

import numpy as np
import pytest
from _live_client import page_client
from cells import PAPER, Notes, scan_example
from command import tjscan
from continuous_scans import scan_continuously

from tjscan.core.errors import ScanInterrupted
from tjscan.job.files import read_scan_job
from tjscan.live.access import LOOPBACK_ADDRESS
from tjscan.live.page import Page, PageAddress
from tjscan.recording.journal import RunEvent
from tjscan.runs.live.scan import ScanShow, show_scan
from tjscan.runs.scan.run import ScanContext
from tjscan.runs.tasks import read_recorded_show
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.stopping import StopRequest

RUN = Path(__file__).parents[1] / "data" / "run-0.1.0"
SHORT = ("--scan.sections", "3")


def recorded_points(run: Path) -> np.ndarray:
    scan = read_recorded_scan(run)
    return np.array([scan.sections[i].points_b for i in sorted(scan.sections)])


@pytest.fixture(scope="module")
def without_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "alone"
    assert tjscan("scan", PAPER, "--out", run, *SHORT) == 0
    return run


def test_sections_are_the_same_to_the_bit_with_a_page(
    without_page: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("scan", PAPER, "--out", tmp_path / "run", *SHORT, "--live", "--port", 0) == 0
    assert "live page: http://127.0.0.1:" in capsys.readouterr().err.replace("\n", "")
    assert np.array_equal(recorded_points(without_page), recorded_points(tmp_path / "run"))


def test_a_scan_that_is_gone_on_with_shows_what_was_scanned(without_page: Path) -> None:
    job = read_scan_job(without_page / "job.toml")
    context = ScanContext(job, without_page / "job.toml")
    with show_scan(context, PageAddress(port=0), print, list, resumed=without_page) as journal:
        page = journal.run.page
        assert page is not None
        journal.run.close()
        with page_client(page) as client:
            client.receive()
    assert {"/run/groove/0/points", "/run/groove/2/surface"} <= client.names()


def test_a_port_that_is_taken_costs_the_page_and_not_the_scan(
    without_page: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server((LOOPBACK_ADDRESS, 0)) as taken:
        port = taken.getsockname()[1]
        run = tmp_path / "run"
        assert tjscan("scan", PAPER, "--out", run, *SHORT, "--live", "--port", port) == 0
        assert "there is no live page" in capsys.readouterr().err
        assert np.array_equal(recorded_points(without_page), recorded_points(run))
        assert tjscan("scan", PAPER, "--out", tmp_path / "no", "--live", "--wait", "--port", port)
        assert "leave out --wait" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_options_of_the_page_need_the_page(tmp_path: Path) -> None:
    assert tjscan("scan", PAPER, "--out", tmp_path / "run", "--wait") == 2
    assert tjscan("scan", PAPER, "--out", tmp_path / "run", "--port", 1) == 2


def test_a_section_is_sent_in_20_kilobytes_to_two_browsers_alike() -> None:
    show = read_recorded_show(RUN)
    sizes: list[tuple[int, int]] = []
    page = Page([show.setting], PageAddress(port=0))
    with page, page_client(page) as one, page_client(page) as other:
        one.receive(), other.receive()
        for step in show.steps:
            page.show_step(step)
            sizes.append((one.receive(), other.receive()))
    number = sum(bool(step.samples) for step in show.steps)
    first, second = np.sum(sizes, axis=0) / number
    assert 1_000 < first < 20_000  # with the views that led to it, and the events
    assert abs(first - second) < 0.02 * first


class PausesAndSteps(Notes):
    """Pauses in the first section; at each pause what was planned is pressed."""

    def __init__(self, *presses: str) -> None:
        super().__init__()
        self.stop, self.presses, self.stood_after = StopRequest(), list(presses), [-1]
        self.stop.pause()

    def record(self, message: object) -> None:
        super().record(message)
        if isinstance(message, RunEvent) and message.name == "paused":
            self.stood_after.append(len(self.sections))
            getattr(self.stop, self.presses.pop(0))()


def test_a_paused_scan_steps_goes_on_and_is_the_same() -> None:
    notes = PausesAndSteps("go_one_step", "go_one_step", "go_on")
    result = scan_example({"scan.sections": 6}, notes=notes, stop=notes.stop)
    assert notes.stood_after[1:] == [2, 3, 4]
    alone = scan_example({"scan.sections": 6})
    for one, other in zip(result.sections, alone.sections, strict=True):
        assert np.array_equal(one.points_b, other.points_b)


def test_paused_again_before_it_moved_it_says_once_more_that_it_stands() -> None:
    """Else a page would say for good that it is about to."""
    stop, said = StopRequest(), 0

    def say() -> None:
        nonlocal said
        said += 1
        stop.go_on()
        if said == 1:
            stop.pause()

    stop.pause()
    stop.wait_while_paused(say)
    assert said == 2


def test_a_paused_scan_ends_as_by_ctrl_c() -> None:
    notes = PausesAndSteps("request_stop_after_section")
    result = scan_example({}, notes=notes, stop=notes.stop)
    assert len(result.sections) == 2
    assert result.detail.startswith("stop requested")
    notes = PausesAndSteps("request_stop_now")
    with pytest.raises(ScanInterrupted):
        scan_example({}, notes=notes, stop=notes.stop)


def test_a_scan_in_motion_shows_how_fast_it_goes_and_no_more_sections_than_there_are() -> None:
    notes = Notes()
    keys = {"scan.mode": "continuous", "scan.length_mm": 40.0}
    scan_continuously(keys, notes=notes)
    job = read_scan_job(PAPER, keys)
    show = ScanShow(ScanContext(job, PAPER), "run")
    steps = [show.step_of_entry(entry) for entry in (*notes.views[-1:], *notes.sections)]
    assert steps[0].facts["doing"] == "following the groove"
    speeds = [float(one.facts["speed"].split()[0]) for one in steps if "speed" in one.facts]
    assert 20.0 < max(speeds) < 80.0
    for step in steps[1:]:
        done, _, total = step.facts["sections"].partition(" of ")
        assert int(done) <= int(total)
