"""The commands as a user types them: what they print, leave behind and end with."""

import csv
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cells import PAPER
from command import tjscan
from written import content

from tjscan.core.errors import ConfigurationError
from tjscan.groove.read import read_groove
from tjscan.job.files import read_scan_job
from tjscan.result.table import SECTIONS_CSV_COLUMNS
from tjscan.scanning.recording import read_recorded_scan

RUN_FILES = {
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


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of five sections."""
    directory = tmp_path_factory.mktemp("runs") / "paper"
    assert tjscan("scan", PAPER, "--out", directory, "--scan.sections", "5") == 0
    return directory


def test_a_run_leaves_all_its_files(run: Path) -> None:
    assert {file.name for file in run.iterdir()} == RUN_FILES


def test_sections_csv_has_its_columns_and_tells_of_a_groove(run: Path) -> None:
    with (run / "sections.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    assert len(rows) == 5
    assert tuple(rows[0]) == SECTIONS_CSV_COLUMNS
    azimuths = [float(row["azimuth_deg"]) for row in rows]
    assert azimuths == sorted(azimuths)  # counterclockwise
    for row in rows:
        p2 = np.array([float(row[f"p2{axis}_mm"]) for axis in "xyz"])
        assert np.hypot(*p2[:2]) == pytest.approx(457.2 / 2, abs=0.3)  # on the brace's wall
        assert 45 < float(row["groove_angle_deg"]) < 70


def test_summary_says_what_it_must(run: Path) -> None:
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    assert summary["sections"] == 5
    assert summary["scans"] == 8
    assert summary["frame"] == "j"
    assert summary["step_mm"]["nominal"] == 40
    assert summary["corner_error_mm"]["mean"] <= summary["corner_error_mm"]["p95"]
    assert {
        "stopped_because",
        "flange_travel_mm",
        "flange_rotation_deg",
        "motion_time_s",
    } <= summary.keys()


def test_the_recorded_profiles_give_the_recorded_sections_again(run: Path) -> None:
    scan = read_recorded_scan(run)
    assert len(scan.views) == 8
    assert len(scan.sections) == 5
    again = scan.reread_sections(read_groove)
    for index, section in scan.sections.items():
        np.testing.assert_allclose(again[index].points_b, section.points_b, atol=1e-12)


def test_the_run_directory_can_be_run_again(run: Path, tmp_path: Path) -> None:
    assert tjscan("scan", run / "job.toml", "--out", tmp_path / "again") == 0
    assert content(tmp_path / "again" / "sections.csv") == content(run / "sections.csv")


def test_json_goes_to_stdout_and_words_to_stderr(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = tjscan("scan", PAPER, "--json", "--out", tmp_path / "run", "--scan.sections=3")
    assert code == 0
    assert json.loads(capsys.readouterr().out)["sections"] == 3


def test_a_dry_run_moves_and_writes_nothing(tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert tjscan("scan", PAPER, "--dry-run", "--out", out) == 0
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["nosuch.toml"], 2, ["nosuch.toml", "no such file"]),
        ([PAPER, "--scan.step-m", "0.04"], 2, ["scan.step_m", "step_mm"]),
        ([PAPER, "--scan.step-mm", "forty"], 2, ["scan.step_mm", "forty"]),
        ([PAPER, "--arm.model", "ur10"], 2, ["paper.toml: arm.model", "ur10e"]),
        ([PAPER, "--arm.model", "none.urdf"], 2, ["none.urdf", "no such URDF"]),
        ([PAPER, "--laser.near-mm", "300"], 2, ["paper.toml: laser", "near_mm"]),
        ([PAPER, "--scan.first.position-mm", "[1e300, 0, 0]"], 2, ["scan.first.position_mm"]),
        ([PAPER, "--scan", "5"], 2, ["scan", "unknown option"]),
        ([PAPER, "--arm.driver", "staubli"], 2, ["arm.driver", "simulated"]),
        ([PAPER, "--joint.file", "nosuch.toml"], 2, ["nosuch.toml"]),
        ([PAPER, "--scan.first.position-mm", "[4000, 0, 0]"], 4, ["reach"]),
        ([PAPER, "--joint.position-mm", "[0, 3000, 0]"], 4, ["first taught pose", "no groove"]),
        ([PAPER, "--groove.minimum-points", "700"], 4, ["first taught pose", "700 are needed"]),
        ([PAPER, "--simulation.arm.home-deg", "[0, 0]"], 2, ["home_deg", "6 joints"]),
        ([], 2, []),
    ],
)
def test_bad_input_gets_one_message_and_its_exit_code(
    arguments: list[object],
    code: int,
    words: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "run"
    assert tjscan("scan", *arguments, "--out", out) == code
    told = " ".join(capsys.readouterr().err.split())
    assert "Traceback" not in told
    assert told.count("tjscan: ") <= 1
    for word in words:
        assert word in told
    assert not (out / "summary.json").exists()
    if code == 2:
        assert not out.exists()


def test_a_joint_that_cannot_exist_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (PAPER.parent.parent / "cad" / "tjoint-600x457.toml").read_text(encoding="utf-8")
    broken = tmp_path / "broken.toml"
    broken.write_text(text.replace("457.2", "657.2"), encoding="utf-8")
    assert tjscan("scan", PAPER, "--joint.file", broken) == 2
    told = capsys.readouterr().err
    assert "broken.toml" in told
    assert "brace" in told


def test_a_run_directory_is_never_overwritten(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (run / "summary.json").read_bytes()
    assert tjscan("scan", PAPER, "--out", run) == 2
    assert "not empty" in " ".join(capsys.readouterr().err.split())
    assert (run / "summary.json").read_bytes() == before


def test_help_loads_nothing_heavy() -> None:
    script = (
        "import sys, tjscan.cli\n"
        "sys.argv = ['tjscan', '--help']\n"
        "try: tjscan.cli.main()\n"
        "except SystemExit: pass\n"
        "heavy = {'scipy', 'open3d', 'pinocchio', 'matplotlib', 'pydantic'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert "Scan a groove as a job file states." in told.stdout


def test_every_key_that_the_help_of_scan_names_is_a_key_of_a_job(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert tjscan("scan", "--help") == 0
    told = capsys.readouterr().out
    keys = set(re.findall(r"--(\w[\w-]*\.[\w.-]*\w)", told))
    assert "scan.step-mm" in keys
    for key in keys:
        with pytest.raises(ConfigurationError) as refused:
            read_scan_job(
                PAPER.with_name("whole-joint.toml"), {key.replace("-", "_"): ["no key takes this"]}
            )
        assert "unknown key" not in refused.value.message


def test_groove_reads_a_run_again(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "readings.png"
    assert tjscan("groove", run, "--json", "--plot", picture, pictures=True) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["readings"]) == 8
    assert all(reading["found"] for reading in told["readings"])
    with (run / "sections.csv").open(encoding="utf-8") as stream:
        last = list(csv.DictReader(line for line in stream if not line.startswith("#")))[-1]
    angle, sigma = told["readings"][-1]["groove_angle_deg"]
    # By itself: the scan also knew the sections before.
    assert abs(angle - float(last["groove_angle_deg"])) < sigma < 1
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_groove_says_why_it_found_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flat = tmp_path / "flat.csv"
    rows = "\n".join(f"{x / 10},250" for x in range(-300, 301))
    flat.write_text(f"x_mm,z_mm\n{rows}\n", encoding="utf-8")
    assert tjscan("groove", flat) == 1
    assert "no groove found" in capsys.readouterr().out
    assert tjscan("groove", tmp_path / "none.csv") == 2
    assert tjscan("groove", flat, "--units", "inch") == 2


@pytest.mark.parametrize("command", ["compare", "groove", "scan"])
def test_a_name_too_long_for_a_file_ends_with_2(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    name = Path("a" * 300 + ".csv")
    assert tjscan(command, name, *([name] if command == "compare" else [])) == 2
    assert "oo long" in capsys.readouterr().err


def test_a_scan_that_ends_early_says_so_with_its_exit_code(tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert tjscan("scan", PAPER, "--scan.length-mm", "3000", "--out", out) == 1
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert not summary["complete"]
    assert summary["stopped_because"] == "next pose out of reach"


def test_an_arm_of_ones_own_is_sought_beside_the_job_and_goes_into_the_run(tmp_path: Path) -> None:
    from tjscan.robot.kinematics import Kinematics

    shutil.copy(Kinematics.load("ur10e").urdf, tmp_path / "mine.urdf")
    job = tmp_path / "job.toml"
    text = PAPER.read_text(encoding="utf-8").replace('model = "ur10e"', 'model = "mine.urdf"')
    cad = PAPER.parent.parent / "cad"
    job.write_text(text.replace("../cad", str(cad)), encoding="utf-8")
    first, again = tmp_path / "first", tmp_path / "again"
    assert tjscan("scan", job, "--scan.sections", "3", "--out", first) == 0
    (tmp_path / "mine.urdf").unlink()
    assert tjscan("scan", first / "job.toml", "--out", again) == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ["--noise-mm", "0"],
        ["--noise-mm", "nan"],
        ["--plot", "nowhere/fits.png"],
        ["--plot", "fits.csv"],
        ["--pitch", "inf", "--units", "mm"],
    ],
)
def test_groove_refuses_options_that_make_no_sense(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "matrix.csv"
    file.write_text("200,201,202\n", encoding="utf-8")
    assert tjscan("groove", file, *arguments) == 2
    assert "Traceback" not in capsys.readouterr().err
    file.write_text("x_mm,z_mm\n", encoding="utf-8")
    assert tjscan("groove", file) == 2
    assert tjscan("groove", tmp_path) == 2


def test_groove_prints_a_table_of_one_line_a_profile(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("groove", run) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split()[:2] == ["profile", "groove_angle_deg"]
    assert len(rows) == 8
    assert max(map(len, rows)) < 130
    column = head.index("depth_mm")
    for row in rows:
        assert 15 < float(row[column:].split()[0]) < 30
    assert tjscan("groove", run, "--corners") == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert "p5_x_z_mm" in head
    assert len(rows) == 8


def test_compare_tells_the_corners_first_and_of_a_unit_that_is_not_used(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("compare", run, run / "joint.toml", "--units", "um") == 0
    printed = capsys.readouterr()
    assert printed.out.index("corners to feature edges") < printed.out.index("cloud to mesh")
    assert "--units um is not used: paper is in mm, as the run states" in printed.err


def test_a_refused_scan_shows_no_bar(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert tjscan("scan", PAPER, "--out", run) == 2
    printed = capsys.readouterr()
    assert "is not empty" in printed.err
    assert "0/16" not in printed.err
