"""A report renders what any algorithm registers, and knows none of them."""

import shutil
from base64 import b64decode
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from cells import FAULTLESS, PAPER
from command import tjscan

from tjscan.core.errors import RecordingError
from tjscan.recording.journal import RunEvent
from tjscan.report.charts import draw_scan_charts
from tjscan.report.data import read_report_data
from tjscan.report.write import render_report_page
from tjscan.result.chapter import ReportChapter, ReportChart
from tjscan.runs.calibration import report as calibration_report
from tjscan.runs.scan import report as scan_report

FED = ReportChapter(
    facts=(("wire feeder", "spool 7 <full>"),),
    findings=("The wire slipped twice.",),
    charts=(ReportChart("wire speed", "bead", "speed / mm/s", np.arange(3.0), np.ones(3), 1.0),),
    events=(RunEvent("slip", "at bead 2", datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC)),),
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("runs") / "exact"
    keys = {**FAULTLESS, "scan.sections": 4}
    options = [word for key, value in keys.items() for word in (f"--{key}", value)]
    assert tjscan("scan", PAPER, "--out", directory, *options, pictures=True) == 0
    return directory


def test_a_report_shows_the_chapter_of_any_algorithm(run: Path) -> None:
    data = read_report_data(run)
    (place,) = data.places
    page = render_report_page(replace(data, places=(replace(place, chapters=(FED,)),)))
    for words in (
        "wire feeder",
        "spool 7 &lt;full&gt;",
        "The wire slipped twice.",
        "05:06:07",
        "at bead 2",
    ):
        assert words in page
    assert "steps of 40 mm" not in page


def test_charts_of_one_title_are_drawn_together(run: Path) -> None:
    data = read_report_data(run)
    (place,) = data.places
    two = tuple(replace(place, name=name, chapters=(FED,)) for name in ("left", "right"))
    picture = draw_scan_charts(replace(data, places=two))
    assert picture is not None
    assert b"<svg" in b64decode(picture.panels[0].split(",")[1])
    assert draw_scan_charts(replace(data, places=())) is None


def test_the_chapter_of_a_scan_holds_every_section(run: Path) -> None:
    chapter = scan_report.scan_chapter(run)
    assert sorted(chapter.profiles) == list(range(4))
    steps, times = chapter.charts
    assert steps.nominal == pytest.approx(40)
    np.testing.assert_allclose(steps.y[1:], 40, atol=2)
    assert times.y[0] == 0
    assert (np.diff(times.y) > 0).all()
    assert dict(chapter.facts)["devices"] == "arm ur10e (simulated), laser simulated (simulated)"
    assert [event.name for event in chapter.events][-1] == "stop"


def test_a_directory_without_a_recording_has_no_chapter_of_a_scan(tmp_path: Path) -> None:
    assert scan_report.scan_chapter(tmp_path).facts == ()


def test_a_recording_that_lost_sections_is_refused(run: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut"
    shutil.copytree(run, cut)
    recording = (cut / "scan.mcap").read_bytes()
    (cut / "scan.mcap").write_bytes(recording[: len(recording) // 2])
    with pytest.raises(RecordingError, match="cut short"):
        scan_report.scan_chapter(cut)


def test_a_calibration_that_is_stated_is_a_finding(run: Path) -> None:
    (finding,) = calibration_report.calibration_chapter(run).findings
    assert "was not calibrated with this program" in finding
