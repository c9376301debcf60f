"""Laws of a continuous scan's run directory: resumed, read again, refused."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from cells import PAPER

from tjscan.core.errors import ConfigurationError, ScanInterrupted
from tjscan.job.files import read_scan_job
from tjscan.result.summary import read_summary
from tjscan.runs.scan.reprocess import reprocess_run
from tjscan.runs.scan.run import ScanContext, resume_scan, run_scan
from tjscan.scanning.section import ScannedSection

SHORT = {"scan.mode": "continuous", "scan.length_mm": 80.0}


def table(file: Path) -> list[list[str]]:
    lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    return list(csv.reader(lines))


def test_a_run_is_read_again_to_the_bit_and_has_smoothed_corners(tmp_path: Path) -> None:
    job = read_scan_job(PAPER, SHORT)
    summary = run_scan(ScanContext(job, PAPER), tmp_path / "run")
    assert summary.complete
    assert summary.stepwise == 0
    assert summary.scans > 5 * summary.sections
    reprocess_run(tmp_path / "run", {}, tmp_path / "again")
    for name in ("sections.csv", "smoothed.csv"):
        assert table(tmp_path / "run" / name) == table(tmp_path / "again" / name)
    rows = table(tmp_path / "run" / "smoothed.csv")
    assert len(rows) == 1 + summary.sections


class Breaks:
    def record(self, message: object) -> None:
        if isinstance(message, ScannedSection) and message.view.index == 25:
            raise ScanInterrupted


def test_a_scan_that_broke_off_goes_on_where_it_was(tmp_path: Path) -> None:
    job = read_scan_job(PAPER, SHORT)
    with pytest.raises(ScanInterrupted):
        run_scan(ScanContext(job, PAPER, journal=Breaks()), tmp_path / "run")
    left = tmp_path / "run" / "job.toml"
    summary = resume_scan(ScanContext(read_scan_job(left), left))
    assert summary.complete
    assert read_summary(tmp_path / "run" / "summary.json").sections == pytest.approx(61, abs=2)


def test_a_number_of_sections_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="length_mm"):
        read_scan_job(PAPER, SHORT | {"scan.sections": 9})


def test_devices_that_stand_for_every_profile_are_refused_before_anything_moves(
    tmp_path: Path,
) -> None:
    run_scan(ScanContext(read_scan_job(PAPER, {"scan.length_mm": 40.0}), PAPER), tmp_path / "old")
    recording = str(tmp_path / "old" / "scan.mcap")
    keys = {"laser.driver": "replay", "laser.recording": recording}
    for more in ({}, {"arm.driver": "replay"}):
        job = read_scan_job(PAPER, SHORT | keys | more)
        with pytest.raises(ConfigurationError, match="stepwise"):
            run_scan(ScanContext(job, PAPER), tmp_path / "run")
