"""``summary.json`` gives back what was written; a stitched one adds its stations up."""

from pathlib import Path

import pytest
from cells import PAPER, scan_example

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import JointOrBaseFrame
from tjscan.job.files import read_scan_job
from tjscan.result.summary import ScanSummary, read_summary, summarise_stations, write_summary
from tjscan.runs.scan.results import sections_in_result_frame, summarise_scan
from tjscan.scanning.journal import ScanResult


@pytest.fixture(scope="module")
def result() -> ScanResult:
    return scan_example({"scan.sections": 4})


@pytest.fixture(scope="module")
def summary(result: ScanResult) -> ScanSummary:
    plan = read_scan_job(PAPER, {"scan.sections": 4}).scan
    return summarise_scan(result, plan, JointOrBaseFrame(), None, "a board of steel")


def test_a_summary_comes_back(summary: ScanSummary, tmp_path: Path) -> None:
    write_summary(tmp_path / "summary.json", summary)
    assert read_summary(tmp_path / "summary.json") == summary


def test_stations_are_added_up(result: ScanResult, summary: ScanSummary, tmp_path: Path) -> None:
    sections = sections_in_result_frame(result.sections, JointOrBaseFrame())
    whole = summarise_stations({"left": summary, "right": summary}, sections, "j")
    assert [station.name for station in whole.stations] == ["left", "right"]
    assert whole.scans == 2 * summary.scans
    assert whole.flange_travel_mm == 2 * summary.flange_travel_mm
    assert whole.sections == len(sections)
    # Both are the chain of the same origins; the printed digits make the difference.
    assert whole.groove_length_mm == pytest.approx(summary.groove_length_mm, abs=1e-3)
    assert whole.calibration == summary.calibration
    assert whole.complete
    write_summary(tmp_path / "summary.json", whole)
    assert read_summary(tmp_path / "summary.json") == whole


@pytest.mark.parametrize("content", [b"", b"[]", b'{"sections": "many"}'])
def test_what_is_no_summary_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "summary.json"
    with pytest.raises(ConfigurationError, match="can't be read"):
        read_summary(file)
    file.write_bytes(content)
    with pytest.raises(ConfigurationError, match="is no summary"):
        read_summary(file)
