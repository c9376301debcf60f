"""A scan that was cut short goes on where it was, and ends as if nothing had happened."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import gated_scan
import numpy as np
import pytest
from _fuzz import section_ends
from cells import FAULTLESS, PAPER, calibration_file
from command import tjscan
from mcap.writer import CompressionType, Writer

from tjscan.core.errors import RecordingError
from tjscan.core.files import lock_and_clean_directory
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import CombinedJournal
from tjscan.recording.parts import recording_files
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.scan.run import ScanContext, check_joint_angles, scan_in_cell
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import Substep

SAME = 1e-9
"""Millimetres: what rounding leaves when noise is off."""

OPTIONS = [word for key, value in FAULTLESS.items() for word in (f"--{key}", str(value))]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that nothing interrupted, noise off."""
    directory = tmp_path_factory.mktemp("runs") / "whole"
    assert tjscan("scan", PAPER, "--out", directory, *OPTIONS) == 0
    return directory


def corners(run: Path) -> np.ndarray:
    with (run / "sections.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    return np.array([[float(v) for k, v in row.items() if k.startswith("p")] for row in rows])


def recorded_corners(run: Path) -> np.ndarray:
    """The five points of every section as recorded, in mm."""
    sections = read_recorded_scan(run).sections
    return 1e3 * np.array([sections[i].points_b for i in sorted(sections)])


def cut(run: Path, copy: Path, share: float) -> Path:
    """A copy of a run whose recording was cut off, with no results."""
    shutil.copytree(run, copy)
    for name in ("sections.csv", "groove.ply", "scan.png", "summary.json"):
        (copy / name).unlink()
    recording = copy / "scan.mcap"
    recording.write_bytes(recording.read_bytes()[: int(share * recording.stat().st_size)])
    return copy


@pytest.mark.parametrize("share", [0.02, 0.13, 0.5, 0.93])
def test_a_scan_cut_anywhere_ends_as_the_whole_one(
    whole: Path, tmp_path: Path, share: float
) -> None:
    run = cut(whole, tmp_path / "cut", share)
    before = (run / "scan.mcap").read_bytes()
    assert tjscan("scan", "--resume", run) == 0
    assert (run / "scan.mcap").read_bytes() == before
    np.testing.assert_allclose(recorded_corners(run), recorded_corners(whole), atol=SAME)
    np.testing.assert_allclose(corners(run), corners(whole), atol=1.1e-4)  # four decimals
    assert json.loads((run / "summary.json").read_text(encoding="utf-8"))["sections"] == 16
    assert (run / "report.html").is_file()


def test_the_smooth_case_and_adaptive_steps_go_on_as_if_nothing_had_happened(
    tmp_path: Path,
) -> None:
    options = ["--scan.prediction-case", "smooth", "--scan.adaptive.most-mm", "60"]
    whole = tmp_path / "whole"
    assert tjscan("scan", PAPER, "--out", whole, *OPTIONS, *options) == 0
    run = cut(whole, tmp_path / "cut", 0.55)
    assert tjscan("scan", "--resume", run) == 0
    np.testing.assert_allclose(recorded_corners(run), recorded_corners(whole), atol=SAME)


def spoil(recording: Path, place: int) -> None:
    """Flip a bit of a recording."""
    data = bytearray(recording.read_bytes())
    data[place] ^= 1
    recording.write_bytes(data)


def test_a_scan_goes_on_where_the_end_of_its_recording_is_damaged(
    whole: Path, tmp_path: Path
) -> None:
    run = cut(whole, tmp_path / "cut", 1.0)
    end = section_ends((run / "scan.mcap").read_bytes())[7]
    os.truncate(run / "scan.mcap", end)
    spoil(run / "scan.mcap", end - 20)
    assert tjscan("scan", "--resume", run) == 0
    np.testing.assert_allclose(corners(run), corners(whole), atol=1.1e-4)  # four decimals
    (damaged,) = (one for one in read_recorded_scan(run).events if one.name == "damaged")
    assert "checksum" in damaged.detail


def test_a_scan_does_not_go_on_where_joints_and_flange_contradict_each_other(whole: Path) -> None:
    view = read_recorded_scan(whole).views[-1]
    arm = Kinematics.load("ur10e")
    check_joint_angles(view, arm, whole)
    for joint in range(5):  # the last turns the flange where it stands
        q = view.q.copy()
        q[joint] += 0.3
        with pytest.raises(RecordingError, match=r"lead \d+ mm away from its flange pose"):
            check_joint_angles(replace(view, q=q), arm, whole)
    with pytest.raises(RecordingError, match="5 joint angles, the arm has 6"):
        check_joint_angles(replace(view, q=view.q[:5]), arm, whole)


def test_a_scan_does_not_go_on_over_a_hole(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = cut(whole, tmp_path / "cut", 0.5)
    spoil(run / "scan.mcap", (run / "scan.mcap").stat().st_size // 2)
    assert tjscan("scan", "--resume", run) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "messages are missing" in told
    assert f"tjscan reprocess {run}" in told
    assert recording_files(run) == [run / "scan.mcap"]


def test_a_scan_may_be_cut_twice_and_go_on_further(whole: Path, tmp_path: Path) -> None:
    run = cut(whole, tmp_path / "cut", 0.3)
    assert tjscan("scan", "--resume", run, "--scan.sections", "8") == 0
    assert tjscan("scan", "--resume", run) == 0
    assert [file.name for file in recording_files(run)] == [
        "scan.mcap",
        "scan-2.mcap",
        "scan-3.mcap",
    ]
    np.testing.assert_allclose(recorded_corners(run), recorded_corners(whole), atol=SAME)


@pytest.mark.parametrize(
    "elsewhere_deg", [(-40, -70, -90, -40, 90, 30), (60, -120, 100, 20, -90, 0)]
)
def test_an_arm_that_was_moved_goes_back_to_the_configuration_in_which_it_scanned(
    whole: Path, tmp_path: Path, elsewhere_deg: tuple[float, ...]
) -> None:
    done = read_recorded_scan(cut(whole, tmp_path / "cut", 0.3))
    job = read_scan_job(PAPER, FAULTLESS)
    q = np.radians(elsewhere_deg)
    moved = replace(done.views[-1], q=q, T_b_f=Kinematics.load("ur10e").forward(q))
    cell = ScanContext(job, PAPER).make_cell(left=moved)
    result = scan_in_cell(cell, job, CombinedJournal(), done)
    back = next(view for view in result.views if view.substep == Substep.RESUMED)
    section = done.sections[back.index]
    assert np.abs(q - section.view.q).max() > 1
    np.testing.assert_allclose(back.q, section.view.q, atol=1e-6)
    points = 1e3 * np.array([section.points_b for section in result.sections])
    np.testing.assert_allclose(points, recorded_corners(whole), atol=1e-5)


def test_a_finished_scan_measures_nothing_more_and_its_results_are_written(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = cut(whole, tmp_path / "run", 1.0)
    before = (run / "scan.mcap").read_bytes()
    assert tjscan("scan", "--resume", run) == 0
    assert "nothing is left to scan" in " ".join(capsys.readouterr().err.split())
    assert recording_files(run) == [run / "scan.mcap"]
    assert (run / "scan.mcap").read_bytes() == before
    np.testing.assert_array_equal(corners(run), corners(whole))
    again, then = (json.loads((d / "summary.json").read_text("utf-8")) for d in (run, whole))
    assert {key for key in then if again[key] != then[key]} <= {"provenance"}


@pytest.mark.parametrize("recorded", [None, 0, 5, 100], ids=str)
def test_a_scan_that_was_killed_as_it_began_to_record_begins_again(
    whole: Path, tmp_path: Path, recorded: int | None
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    for name in ("job.toml", "joint.toml"):
        shutil.copyfile(whole / name, run / name)
    if recorded is not None:
        (run / "scan.mcap").write_bytes((whole / "scan.mcap").read_bytes()[:recorded])
    assert tjscan("scan", "--resume", run, "--scan.sections", "3") == 0
    np.testing.assert_allclose(recorded_corners(run), recorded_corners(whole)[:3], atol=SAME)


def test_a_run_whose_recording_is_gone_does_not_go_on(whole: Path, tmp_path: Path) -> None:
    run = shutil.copytree(whole, tmp_path / "run")
    (run / "scan.mcap").unlink()
    assert tjscan("scan", "--resume", run) == 2
    assert not (run / "scan.mcap").exists()


def test_a_recording_of_another_program_is_not_gone_on_with(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = cut(whole, tmp_path / "cut", 0.5)
    with (run / "scan.mcap").open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, use_chunking=False)
        writer.start(profile="ros2")
        schema = writer.register_schema("Imu", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/imu", "json", schema), 0, b"{}", 0)
        writer.finish()
    assert tjscan("scan", "--resume", run) == 1
    assert "was recorded by another program: mcap-python" in " ".join(
        capsys.readouterr().err.split()
    )
    assert len(recording_files(run)) == 1


def test_a_joint_that_moved_is_not_scanned_on(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = cut(whole, tmp_path / "cut", 0.5)
    aside = "[[1, 0, 0, 1.25], [0, 1, 0, -114.845], [0, 0, 1, 167.616], [0, 0, 0, 1]]"
    assert tjscan("scan", "--resume", run, "--simulation.T_f_s_mm", aside) == 4
    told = " ".join(capsys.readouterr().err.split())
    assert "from where it was" in told
    assert not (run / "summary.json").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["--scan.direction", "clockwise"],
        ["--scan.standoff-mm", "200"],
        ["--joint.file", "other.toml"],
        ["--groove.noise-mm", "0.1"],
        ["--dry-run"],
        ["--out", "elsewhere"],
    ],
)
def test_what_matters_cannot_change_while_a_scan_goes_on(
    whole: Path, tmp_path: Path, arguments: list[str]
) -> None:
    run = cut(whole, tmp_path / "cut", 0.5)
    assert tjscan("scan", "--resume", run, *arguments) == 2
    assert len(recording_files(run)) == 1


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "old", "new", "key"),
    [
        ("job.toml", "standoff_mm = 230.0", "standoff_mm = 220.0", "scan.standoff_mm"),
        ("job.toml", "-114.845", "-115.845", "calibration.T_f_s_mm"),
        ("job.toml", 'model = "ur10e"', 'model = "ur10e"\nid = "arm 3"', "arm.id"),
        ("joint.toml", "= 457.2", "= 457.4", "joint.toml: brace.outer_diameter_mm"),
    ],
)
def test_a_run_whose_files_were_edited_does_not_go_on_and_says_which_key(
    whole: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    old: str,
    new: str,
    key: str,
) -> None:
    run = cut(whole, tmp_path / "cut", 0.5)
    edit(run / name, old, new)
    assert tjscan("scan", "--resume", run) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert f"{key}: was " in told
    assert len(recording_files(run)) == 1


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("-114.845", "-114.846", "calibration.toml: T_f_s_mm"),
        ('laser = "simulated"', 'laser = "another"', "another"),
    ],
)
def test_a_run_whose_calibration_was_edited_does_not_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, key: str
) -> None:
    file, run = calibration_file(tmp_path / "calibration.toml"), tmp_path / "run"
    options = ["--calibration.file", file, "--scan.sections", "3", *OPTIONS]
    assert tjscan("scan", PAPER, "--out", run, *options) == 0
    edit(run / "calibration.toml", old, new)
    assert tjscan("scan", "--resume", run) == 2
    assert key in " ".join(capsys.readouterr().err.split())


def test_what_may_change_is_told_and_recorded(whole: Path, tmp_path: Path) -> None:
    run = cut(whole, tmp_path / "cut", 0.5)
    assert tjscan("scan", "--resume", run, "--scan.sections", "12") == 0
    changed = [event.detail for event in read_recorded_scan(run).events if event.name == "changed"]
    assert changed == ["scan.sections was not there, is 12"]


@pytest.mark.parametrize("name", ["scan.mcap", "job.toml", "joint.toml"])
def test_a_run_with_links_out_of_it_does_not_go_on(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    run = cut(whole, tmp_path / "cut", 0.5)
    elsewhere = tmp_path / name
    (run / name).rename(elsewhere)
    (run / name).symlink_to(elsewhere)
    before = elsewhere.read_bytes()
    assert tjscan("scan", "--resume", run) == 2
    assert "leads out of" in " ".join(capsys.readouterr().err.split())
    assert elsewhere.read_bytes() == before


def test_nothing_is_recorded_through_a_link_that_leads_nowhere_yet(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, elsewhere = cut(whole, tmp_path / "cut", 0.5), tmp_path / "elsewhere.mcap"
    (run / "scan-2.mcap").symlink_to(elsewhere)
    assert tjscan("scan", "--resume", run) == 2
    assert "leads out of" in " ".join(capsys.readouterr().err.split())
    assert not elsewhere.exists()


def test_results_replace_a_link_and_leave_alone_what_it_leads_to(
    whole: Path, tmp_path: Path
) -> None:
    run, elsewhere = cut(whole, tmp_path / "cut", 0.97), tmp_path / "precious.csv"
    elsewhere.write_text("precious", encoding="utf-8")
    (run / "sections.csv").symlink_to(elsewhere)
    assert tjscan("scan", "--resume", run) == 0
    assert elsewhere.read_text(encoding="utf-8") == "precious"
    assert not (run / "sections.csv").is_symlink()


def test_what_a_dead_process_left_in_the_making_is_swept_away(tmp_path: Path) -> None:
    run = tmp_path / "run"
    (run / ".partial-dead").mkdir(parents=True)
    (run / ".partial-dead" / "job.toml").write_text("half a", encoding="utf-8")
    assert tjscan("scan", PAPER, "--out", run, "--scan.sections", "3") == 0
    assert not list(run.glob(".partial*"))


@pytest.mark.parametrize("moment", [2, 5, 7])
def test_a_scan_killed_between_two_renames_goes_on(
    whole: Path, tmp_path: Path, moment: int
) -> None:
    run = tmp_path / "run"
    script = (
        "import os, signal, sys\n"
        "from itertools import count\n"
        "from pathlib import Path\n"
        "from tjscan.cli import main\n"
        "replace, numbers = Path.replace, count(1)\n"
        "def kill(*paths):\n"
        f"    if next(numbers) == {moment}:\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "    return replace(*paths)\n"
        "Path.replace = kill\n"
        "main(sys.argv[1:])\n"
    )
    options = ["scan", str(PAPER), "--out", str(run), "--scan.sections", "3", *OPTIONS]
    killed = subprocess.run([sys.executable, "-c", script, *options], check=False)
    assert killed.returncode == -signal.SIGKILL
    finished = (run / "summary.json").exists()
    assert all((run / name).exists() for name in ("sections.csv", "groove.ply")) or not finished
    again = ["scan", "--resume", str(run)] if (run / "job.toml").exists() else options
    assert tjscan(*again) == 0
    np.testing.assert_allclose(recorded_corners(run), recorded_corners(whole)[:3], atol=SAME)
    assert not list(run.glob(".partial*"))


def test_a_run_in_the_making_belongs_to_who_makes_it(tmp_path: Path) -> None:
    with lock_and_clean_directory(tmp_path):
        assert tjscan("scan", PAPER, "--out", tmp_path, "--scan.sections", "3") == 1
    assert not list(tmp_path.iterdir())


def test_files_that_no_scan_left_are_not_written_over(tmp_path: Path) -> None:
    own = tmp_path / "joint.toml"
    own.write_text("my own", encoding="utf-8")
    assert tjscan("scan", PAPER, "--out", tmp_path, "--scan.sections", "3") == 2
    assert own.read_text(encoding="utf-8") == "my own"


def test_only_one_process_records_into_a_run(tmp_path: Path) -> None:
    with (
        lock_and_clean_directory(tmp_path),
        pytest.raises(RecordingError, match="another process"),
        lock_and_clean_directory(tmp_path),
    ):
        pass
    with lock_and_clean_directory(tmp_path):
        pass  # it was let go


@pytest.fixture
def scanning(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """A scan in a process of its own that is held in its fifth section, and its run directory."""
    run = tmp_path / "run"
    command = [sys.executable, gated_scan.__file__, "scan", str(PAPER), "--out", str(run), *OPTIONS]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        yield process, run
    finally:
        process.kill()
        process.communicate()


def test_a_killed_scan_goes_on(whole: Path, scanning: tuple[subprocess.Popen[bytes], Path]) -> None:
    process, run = scanning
    assert process.stderr is not None
    assert any(gated_scan.UNDER_WAY.encode() in line for line in process.stderr)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (run / "summary.json").exists()
    assert len(recorded_corners(run)) == gated_scan.HELD
    assert tjscan("scan", "--resume", run) == 0
    np.testing.assert_allclose(recorded_corners(run), recorded_corners(whole), atol=SAME)


def test_a_full_disk_is_told_and_what_was_written_before_is_whole(
    whole: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    script = (
        "import resource, sys\n"
        "from tjscan.cli import main\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))\n"
        "main(sys.argv[1:])\n"
    )
    command = [sys.executable, "-c", script, "scan", str(PAPER), "--out", str(run), *OPTIONS]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    assert told.returncode == 1
    assert "can't be written" in told.stderr
    assert "Traceback" not in told.stderr
    assert not (run / "summary.json").exists()
    assert tjscan("scan", "--resume", run) == 0
    np.testing.assert_allclose(recorded_corners(run), recorded_corners(whole), atol=SAME)
