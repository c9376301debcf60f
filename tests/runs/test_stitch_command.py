"""``tjscan stitch``: from run directories to one result, or to a refusal that shows why."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cells import EXAMPLES, PAPER
from command import tjscan

from tjscan.job.files import read_scan_job
from tjscan.result.directory import JOINT_FILE
from tjscan.result.table import read_sections_csv
from tjscan.runs.run import make_run_directory
from tjscan.runs.scan.run import ScanContext, run_scan

EXAMPLE = EXAMPLES / "whole-joint.toml"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the runs of both stations of the example."""
    folder = tmp_path_factory.mktemp("stations")
    job = read_scan_job(EXAMPLE, {"scan.step_mm": 40.0})
    for name in job.station_names:
        run_scan(ScanContext(job.job_at_station(name), EXAMPLE), folder / name)
    return folder


def test_two_runs_become_one_groove(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "stitched"
    runs_in_order = (runs / "right", runs / "left")
    assert tjscan("stitch", *runs_in_order, "--out", out, "--json", pictures=True) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["summary"]["frame"] == "j"
    assert [one["name"] for one in told["summary"]["stations"]] == ["left", "right"]
    assert told["stitching"]["covered_deg"] == pytest.approx(360)
    assert told["stitching"]["loop_gap_after_mm"] < 0.1
    assert told["summary"]["corner_error_mm"]["mean"] < 0.1
    whole_turn = told["summary"]["sections"] * told["summary"]["step_mm"]["mean"]
    assert told["summary"]["groove_length_mm"] == pytest.approx(whole_turn)  # the last step, too
    assert json.loads((out / "stations.json").read_text()) == told["stitching"]
    for name in ("groove.ply", "scan.png", "stitch.png", "report.html"):
        assert (out / name).stat().st_size > 1000
    sections = read_sections_csv(out / "sections.csv")
    assert {section.station for section in sections} == {"left", "right", "left+right"}
    assert (np.diff([section.azimuth for section in sections]) > 0).all()
    # What came out can be stitched again: it holds what it was made of.
    assert tjscan("stitch", out, "--out", tmp_path / "again") == 0
    assert read_sections_csv(tmp_path / "again" / "sections.csv")[0].azimuth == sections[0].azimuth
    assert tjscan("compare", out, out / "joint.toml", "--tolerance-mm", 0.3) == 0


def test_a_result_can_be_moved_and_reported_from_anywhere(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(runs)
    assert tjscan("stitch", "left", "right", "--out", tmp_path / "first") == 0
    moved = (tmp_path / "first").rename(tmp_path / "moved")
    monkeypatch.chdir(tmp_path)
    assert tjscan("report", "moved") == 0
    assert "are not there any more" not in (moved / "report.html").read_text(encoding="utf-8")
    told = json.loads((moved / "stations.json").read_text())
    assert [one["source"] for one in told["stations"]] == ["left", "right"]


def test_a_run_of_several_stations_is_read_again_and_stitched(runs: Path, tmp_path: Path) -> None:
    job = read_scan_job(EXAMPLE, {"scan.step_mm": 40.0})
    assert job.joint is not None
    whole, out = tmp_path / "whole", tmp_path / "again"
    make_run_directory(whole, job, EXAMPLE, {JOINT_FILE: EXAMPLE.parent / job.joint.file})
    for name in job.station_names:
        shutil.copytree(runs / name, whole / name)
    assert tjscan("reprocess", whole, "--out", out, "--groove.noise-mm", "0.06") == 0
    assert "noise_mm = 0.06" in (out / "left" / "job.toml").read_text()
    assert {one.station for one in read_sections_csv(out / "left" / "sections.csv")} == {"left"}
    stations = {section.station for section in read_sections_csv(out / "sections.csv")}
    assert stations == {"left", "right", "left+right"}


def test_a_refusal_leaves_its_picture_and_nothing_else(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = read_scan_job(EXAMPLE, {"scan.sections": 6})
    run_scan(ScanContext(job.job_at_station("right"), EXAMPLE), tmp_path / "right")
    left = read_scan_job(EXAMPLE, {"scan.sections": 6}).job_at_station("left")
    run_scan(ScanContext(left, EXAMPLE), tmp_path / "left")
    out = tmp_path / "stitched"
    assert tjscan("stitch", tmp_path / "left", tmp_path / "right", "--out", out) == 1
    said = capsys.readouterr().err
    assert "stitching refused (" in said
    assert "scan again. " in " ".join(said.split())
    assert "stitch.png shows it" in said
    assert [file.name for file in out.iterdir()] == ["stitch.png"]


def test_a_recording_cut_short_since_is_refused_by_name(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = shutil.copytree(runs / "left", tmp_path / "left")
    whole = (cut / "scan.mcap").read_bytes()
    for size in (0, len(whole) // 2):
        (cut / "scan.mcap").write_bytes(whole[:size])
        assert tjscan("stitch", cut, runs / "right", "--out", tmp_path / "out") == 1
        assert tjscan("report", cut) == 1
        said = " ".join(capsys.readouterr().err.split())
        assert said.count("cut short or damaged since") == 2
    assert not (tmp_path / "out").exists()


def test_recordings_that_changed_places_are_refused(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both would fit: the groove would come out turned by 180°."""
    for name, other in (("left", "right"), ("right", "left")):
        shutil.copytree(runs / name, tmp_path / name)
        shutil.copyfile(runs / other / "scan.mcap", tmp_path / name / "scan.mcap")
    assert tjscan("stitch", tmp_path / "left", tmp_path / "right", "--out", tmp_path / "s") == 2
    assert "its recording is of station 'right'" in capsys.readouterr().err
    alone = read_scan_job(PAPER, {"scan.sections": 3})
    run_scan(ScanContext(alone, PAPER), tmp_path / "alone")
    shutil.copyfile(tmp_path / "alone" / "scan.mcap", tmp_path / "left" / "scan.mcap")
    assert tjscan("stitch", tmp_path / "left", runs / "right", "--out", tmp_path / "s") == 2
    assert "its recording is of a scan without stations" in capsys.readouterr().err


def test_what_is_no_run_of_a_station_is_refused_by_name(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("stitch", tmp_path, "--out", tmp_path / "out") == 2
    assert "is no run directory" in capsys.readouterr().err
    cut = shutil.copytree(runs / "left", tmp_path / "cut")
    (cut / "summary.json").unlink()
    assert tjscan("stitch", cut, runs / "right", "--out", tmp_path / "out") == 2
    assert "--resume" in capsys.readouterr().err
    assert tjscan("stitch", runs / "left", "--out", tmp_path / "out") == 2
    assert "two stations or more" in capsys.readouterr().err
    assert tjscan("stitch", runs / "left", runs / "left", "--out", tmp_path / "out") == 2
    assert "leave one out" in capsys.readouterr().err
    for option in ("--repeatability-mm", "--repeatability-deg", "--out-of-round-mm"):
        for value in ("0", "-1", "nan", "inf", "1000"):
            words = ("stitch", runs / "left", runs / "right", option, value)
            assert tjscan(*words, "--out", tmp_path / "out") == 2
            assert f"{option}: must be" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert tjscan("stitch", runs / "left", runs / "right", "--out", runs) == 2
    assert "is not empty" in capsys.readouterr().err
