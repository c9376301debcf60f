"""From station to station: who is asked, what is left behind, how it goes on."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from cells import Notes
from command import tjscan
from station_jobs import QUICK, WHOLE, data_of, written
from written import content

from tjscan.calibration.wizard.operator import Question
from tjscan.core.config import read_toml
from tjscan.core.frames import pose, rot_y
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.recording.journal import Journal
from tjscan.recording.parts import recording_files
from tjscan.report.write import write_run_report
from tjscan.result.summary import read_summary
from tjscan.result.table import read_sections_csv
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.scan.run import ScanContext
from tjscan.runs.stations.run import StationScan, resume_stations, run_stations
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.stopping import StopRequest

STATION_FILES = {
    "SHA256SUMS",
    "job.toml",
    "joint.toml",
    "scan.mcap",
    "sections.csv",
    "sections.csv-metadata.json",
    "groove.ply",
    "scan.png",
    "summary.json",
    "uncertainty.json",
    "report.html",
}


class Asked:
    """Answers as told, and keeps what it was asked."""

    def __init__(self, answer: bool) -> None:
        self.answer, self.questions = answer, list[str]()

    def confirm(self, question: Question) -> bool:
        self.questions.append(question.text)
        return self.answer


class Watched:
    """Keeps which stations were scanned."""

    def __init__(self) -> None:
        self.names: list[str] = []

    @contextmanager
    def __call__(self, name: str, plan: ScanPlan) -> Iterator[Journal]:
        self.names.append(name)
        yield Notes()


def quick(file: Path = WHOLE) -> ScanJob:
    """A job that is soon done."""
    return read_scan_job(file, {"scan.sections": 4})


def in_directory(directory: Path) -> ScanContext:
    """The job that a run directory holds."""
    return ScanContext(read_scan_job(directory / "job.toml"), directory / "job.toml")


@dataclass(frozen=True)
class Story:
    """A run that an attendant stopped before its second station, and let go on later."""

    directory: Path
    refused: tuple[StationScan, ...]
    begun: bool
    asked: tuple[Asked, Asked]
    scanned: tuple[list[str], list[str]]
    done: tuple[StationScan, ...]


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Story:
    """Both stations, four sections each."""
    directory = tmp_path_factory.mktemp("runs") / "whole"
    no, yes, before, later = Asked(False), Asked(True), Watched(), Watched()
    context = ScanContext(quick(), WHOLE, finished=write_run_report)
    refused = run_stations(context, directory, no, before)
    begun = (directory / "right").exists()
    held = replace(in_directory(directory), finished=write_run_report)
    done = resume_stations(held, {}, yes, later)
    return Story(directory, refused, begun, (no, yes), (before.names, later.names), done)


@pytest.fixture(scope="module")
def whole(story: Story) -> Path:
    """The directory of that run."""
    return story.directory


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(whole, tmp_path / "run"))


def cut(station: Path, share: float = 0.6) -> None:
    """Leave of a station what a scan that was cut off leaves."""
    for name in ("sections.csv", "groove.ply", "scan.png", "summary.json"):
        (station / name).unlink()
    recording = station / "scan.mcap"
    recording.write_bytes(recording.read_bytes()[: int(share * recording.stat().st_size)])


def test_each_station_leaves_a_run_directory_of_its_own(whole: Path) -> None:
    assert {"job.toml", "joint.toml", "left", "right"} <= {file.name for file in whole.iterdir()}
    assert read_scan_job(whole / "job.toml").station_names == ("left", "right")
    for name in ("left", "right"):
        assert {file.name for file in (whole / name).iterdir()} == STATION_FILES
        assert read_scan_job(whole / name / "job.toml") == quick().job_at_station(name).model_copy(
            update={"joint": read_scan_job(whole / name / "job.toml").joint}
        )
        summary = read_summary(whole / name / "summary.json")
        assert (summary.frame, summary.corner_error_mm) == ("b", None)
        sections = read_sections_csv(whole / name / "sections.csv")
        assert {section.station for section in sections} == {name}


def test_the_directory_of_a_station_can_be_run_again(whole: Path, tmp_path: Path) -> None:
    assert tjscan("scan", whole / "right" / "job.toml", "--out", tmp_path / "again") == 0
    again = content(tmp_path / "again" / "sections.csv")
    assert again == content(whole / "right" / "sections.csv")


def test_one_station_alone_is_a_run_like_any_other(whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "right"
    assert tjscan("scan", WHOLE, "--station", "right", "--out", out, *QUICK) == 0
    assert {file.name for file in out.iterdir()} == STATION_FILES
    assert content(out / "sections.csv") == content(whole / "right" / "sections.csv")


def test_between_stations_somebody_is_asked(story: Story) -> None:
    for asked in story.asked:
        (question,) = asked.questions  # once more later: the arm may still stand at the first
        assert "4 sections" in question
        assert "Move the arm to station right" in question


def test_who_says_no_stops_before_the_next_station_and_goes_on_later(story: Story) -> None:
    left, right = story.refused
    assert left.is_complete
    assert right.summary is None
    assert not story.begun
    assert all(scan.is_complete for scan in story.done)
    assert story.scanned == (["left"], ["right"])


def test_a_request_to_stop_begins_no_other_station(tmp_path: Path) -> None:
    stop = StopRequest()
    stop.request_stop_after_section()
    context = ScanContext(quick(), WHOLE, stop=stop)
    left, right = run_stations(context, tmp_path / "run", Asked(True), Watched())
    assert not left.is_complete
    assert right.summary is None


def test_what_is_missing_is_scanned_and_what_is_done_stays(run: Path) -> None:
    before = (run / "left" / "scan.mcap").stat().st_mtime_ns
    cut(run / "right")
    asked, watched = Asked(True), Watched()
    scans = resume_stations(in_directory(run), {}, asked, watched)
    assert all(scan.is_complete for scan in scans)
    assert watched.names == ["right"]
    assert asked.questions == []  # it was cut short there, and what moved would be seen
    assert [file.name for file in recording_files(run / "right")] == ["scan.mcap", "scan-2.mcap"]
    assert (run / "left" / "scan.mcap").stat().st_mtime_ns == before


def test_a_station_is_resumed_by_itself(run: Path) -> None:
    cut(run / "right")
    assert tjscan("scan", "--resume", run / "right") == 0
    assert read_summary(run / "right" / "summary.json").sections == 4


def test_one_station_of_a_run_is_gone_on_with(run: Path) -> None:
    cut(run / "left")
    shutil.rmtree(run / "right")
    watched = Watched()
    left, right = resume_stations(in_directory(run), {}, Asked(True), watched, "right")
    assert watched.names == ["right"]
    assert left.summary is None
    assert right.is_complete


def test_a_failed_station_leaves_the_others_whole_and_can_be_taught_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = data_of(WHOLE), tmp_path / "run"
    good = data["station"][1]["first"]
    data["station"][1]["first"] = good | {"position_mm": [0.0, 0.0, -3000.0]}
    file = written(tmp_path, data)
    assert tjscan("scan", file, "--out", out, *QUICK) == 4
    told = " ".join(capsys.readouterr().err.split())
    assert "out of reach" in told
    assert "Station right is not finished" in told
    assert f"--resume {out}" in told
    assert read_summary(out / "left" / "summary.json").complete
    assert (out / "left" / "report.html").is_file()
    assert not (out / "right" / "report.html").exists()
    # What was recorded before the first section is of no use to what follows, and is kept.
    job = out / "job.toml"
    data = read_toml(job)
    data["station"][1]["first"] = good
    job.write_text(tomli_w.dumps(data), encoding="utf-8")
    assert all(
        scan.is_complete for scan in resume_stations(in_directory(out), {}, Asked(True), Watched())
    )
    assert (out / "right.1" / "scan.mcap").exists()


def test_teaching_a_station_changes_its_pose_alone(tmp_path: Path) -> None:
    file = written(tmp_path, data_of(WHOLE))
    old = read_scan_job(file)
    T = old.job_at_station("right").start_poses[1].T
    stands = pose(T[:3, :3] @ rot_y(0.01), T[:3, 3] + (0.002, -0.003, 0.001))
    q = Kinematics.load("ur10e").inverse(stands, near=np.radians((32, 181, 58, -67, -96, 32)))
    home = json.dumps(np.degrees(q).tolist())
    key = "--simulation.station.right.home-deg"
    assert tjscan("teach", file, "--station", "right", "--which", "second", key, home) == 0
    new = read_scan_job(file)
    np.testing.assert_allclose(new.job_at_station("right").start_poses[1].T, stands, atol=1e-5)
    assert new.station[0] == old.station[0]
    assert new.station[1].first == old.station[1].first
    assert tjscan("teach", file, "--which", "second") == 2  # at which?


def test_a_real_arm_waits_for_a_person_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    real = ("--arm.driver", "ur", "--arm.ur.host", "127.0.0.9")
    assert tjscan("scan", WHOLE, "--out", out, *real) == 2
    assert "no terminal to ask at; scan one station at a time" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "hint"),
    [
        (["--station", "middle"], "did you mean"),
        (["--station.right.first.position-mm", "[0, 0]"], "station.1.first.position_mm"),
        (["--simulation.station.right.home-deg", "[0, 0]"], "6 joints"),
        (["--laser.driver", "replay", "--laser.recording", "nowhere"], "--station"),
    ],
)
def test_no_station_is_scanned_of_a_job_that_is_wrong_at_one(
    options: list[str], hint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert tjscan("scan", WHOLE, "--out", out, *options) == 2
    assert hint in " ".join(capsys.readouterr().err.split())
    assert not out.exists()


def test_a_dry_run_looks_at_the_way_at_every_station(tmp_path: Path) -> None:
    assert tjscan("scan", WHOLE, "--dry-run") == 0
    far = ("--station.right.first.position-mm", "[3000, 0, 0]")
    assert tjscan("scan", WHOLE, "--dry-run", *far) == 4
    assert tjscan("scan", WHOLE, "--dry-run", "--station", "left", *far) == 0


def test_what_all_stations_saw_is_one_groove(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert tjscan("scan", WHOLE, "--out", out, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["stitching"]["covered_deg"] == pytest.approx(360)
    summary = read_summary(out / "summary.json")
    assert summary.frame == "j"
    assert [one.name for one in summary.stations] == ["left", "right"]
    assert summary.corner_error_mm is not None
    assert summary.corner_error_mm.mean < 0.1
    assert {section.station for section in read_sections_csv(out / "sections.csv")} == {
        "left",
        "right",
        "left+right",
    }


def test_stations_that_cannot_be_stitched_are_whole_and_it_is_said_what_to_do(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("scan", "--resume", run) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "What each station scanned is whole" in told
    assert not (run / "summary.json").exists()
    for name in ("left", "right"):
        assert read_summary(run / name / "summary.json").complete
