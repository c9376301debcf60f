"""A job file says what is wrong, where, and what would be right."""

from dataclasses import FrozenInstanceError
from pathlib import Path

import pytest

from tjscan.cli.options.shared import parse_overrides
from tjscan.core.errors import ConfigurationError
from tjscan.groove.settings import DEFAULT_SETTINGS
from tjscan.job.files import ScanJob, read_scan_job

JOB = """
[scan]
step_mm = 40
length_mm = 560
first = { position_mm = [800, 0, 300], euler_zyx_deg = [0, 90, 0] }
second = { position_mm = [800, 40, 300], euler_zyx_deg = [0, 90, 0] }

[calibration]
T_f_s_mm = [[1, 0, 0, 0], [0, 1, 0, -115], [0, 0, 1, 168], [0, 0, 0, 1]]

[joint]
file = "joint.toml"
position_mm = [0, 800, 0]
euler_zyx_deg = [90, 0, 0]

[simulation.arm]
home_deg = [0, -90, 90, -90, -90, 0]
"""


def write(folder: Path, text: str) -> Path:
    file = folder / "job.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_lengths_become_metres_once(tmp_path: Path) -> None:
    job = read_scan_job(write(tmp_path, JOB))
    assert job.calibration.T_f_s is not None
    assert job.calibration.T_f_s[:3, 3] == pytest.approx((0.0, -0.115, 0.168))
    assert job.start_poses[0].T[:3, 3] == pytest.approx((0.8, 0.0, 0.3))


@pytest.mark.parametrize(
    ("old", "new", "key", "hint"),
    [
        ("step_mm = 40", "step_m = 0.04", "scan.step_m", "did you mean: step_mm?"),
        ("step_mm = 40", "step_mm = 0.04", "scan.step_mm", "greater than or equal to 5"),
        ("step_mm = 40", 'step_mm = "40"', "scan.step_mm", "number"),
        ("step_mm = 40", "step_mm = nan", "scan.step_mm", "finite"),
        ("step_mm = 40", 'direction = "cw"', "scan.direction", "'clockwise'"),
        ("[joint]", "[groove]\nnoise_um = 50\n[joint]", "groove.noise_um", "noise_mm"),
        ("[joint]", '[groove]\nmodel = "butt-v"\n[joint]', "groove.model", "'butt-v-sharp'"),
        ("[joint]", "[groove]\ninlier_share = 0\n[joint]", "groove.inlier_share", "greater"),
        ("[scan]", "[scann]", "scann", "did you mean: scan?"),
        ("[800, 0, 300]", "[800, 0]", "scan.first.position_mm.2", "required"),
        ("[1, 0, 0, 0]", "[2, 0, 0, 0]", "calibration.T_f_s_mm", "not orthonormal"),
        ("[1, 0, 0, 0]", "[-1, 0, 0, 0]", "calibration.T_f_s_mm", "left-handed"),
        ("[simulation.arm]", "[simulation.arms]", "simulation.arms", "did you mean: arm?"),
    ],
)
def test_a_wrong_key_or_value_is_named_with_what_would_be_right(
    tmp_path: Path, old: str, new: str, key: str, hint: str
) -> None:
    file = write(tmp_path, JOB.replace(old, new, 1))
    with pytest.raises(ConfigurationError) as caught:
        read_scan_job(file)
    assert caught.value.file == file
    assert caught.value.key == key
    assert hint in str(caught.value)


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("[leg]\n[brace]\n[groove]", "is a joint: a job names it under joint.file"),
        ("[vehicle]\n[weld]\n[simulation]", "is a job of a crawler: run it with 'tjscan crawl"),
        ('job = "paper.toml"\n[grid]', "is a study: run it with 'tjscan study'"),
    ],
)
def test_a_file_of_another_kind_is_named(tmp_path: Path, text: str, hint: str) -> None:
    with pytest.raises(ConfigurationError, match=hint):
        read_scan_job(write(tmp_path, text))


@pytest.mark.parametrize(
    ("content", "hint"),
    [(b"[scan", "not valid TOML"), (b"\xff\xfe", "UTF-16"), (b"#" * 2_000_000, "too large")],
)
def test_a_file_that_is_no_job_is_refused(tmp_path: Path, content: bytes, hint: str) -> None:
    file = tmp_path / "job.toml"
    file.write_bytes(content)
    with pytest.raises(ConfigurationError, match=hint):
        read_scan_job(file)


def test_a_missing_file_names_the_nearest(tmp_path: Path) -> None:
    write(tmp_path, JOB)
    with pytest.raises(ConfigurationError, match=r"no such file. Did you mean: job\.toml\?"):
        read_scan_job(tmp_path / "jobb.toml")


def test_dotted_options_replace_keys(tmp_path: Path) -> None:
    overrides = parse_overrides(
        ["--scan.step-mm", "20", "--scan.direction=clockwise", "--simulation.laser.ghosts", "0"]
    )
    job = read_scan_job(write(tmp_path, JOB), overrides)
    assert job.scan.step == 0.02
    assert job.scan.direction == "clockwise"
    assert job.simulation is not None
    assert job.simulation.laser.ghosts == 0


@pytest.mark.parametrize("tokens", [["--jsn"], ["scan"], ["--scan.step-mm"]])
def test_options_that_are_none_are_refused(tokens: list[str]) -> None:
    with pytest.raises(ConfigurationError):
        parse_overrides(tokens)


@pytest.mark.parametrize("text", ['[{"kind": "jam", "at_s": 2}]', "[1, 2", '{"x": 1}'])
def test_a_list_or_table_not_written_as_toml_is_refused_with_how_it_is(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r'--a\.b .* TOML .*\[\{key = "word"\}\]'):
        parse_overrides([f"--a.b={text}"])


@pytest.mark.parametrize("key", ["scan.step_mm.x", "scan.step-mmm", "scann.step_mm"])
def test_an_option_for_a_key_that_is_none_is_refused(tmp_path: Path, key: str) -> None:
    with pytest.raises(ConfigurationError):
        read_scan_job(write(tmp_path, JOB), {key: 1})


def test_jobs_are_frozen(tmp_path: Path) -> None:
    job = read_scan_job(write(tmp_path, JOB))
    assert isinstance(job, ScanJob)
    with pytest.raises(FrozenInstanceError):
        job.scan.step = 0.01  # type: ignore[misc]


@pytest.mark.parametrize("table", ["", "file = 'c.toml'\nT_f_s_mm = "])
def test_a_calibration_is_a_pose_or_a_file_and_not_both(tmp_path: Path, table: str) -> None:
    rows = "T_f_s_mm = "
    start, end = JOB.split(rows)
    matrix, rest = end.split("\n", 1)
    text = start + (table + matrix if table else "") + "\n" + rest
    with pytest.raises(ConfigurationError, match="either T_f_s_mm or file"):
        read_scan_job(write(tmp_path, text))


def test_a_calibration_on_the_command_line_displaces_that_of_the_job(tmp_path: Path) -> None:
    job = read_scan_job(
        write(tmp_path, JOB), parse_overrides(["--calibration.file", "mine/calibration.toml"])
    )
    assert job.calibration.T_f_s is None
    # A path on a command line counts from where the command is given.
    assert job.calibration.file == str(Path.cwd() / "mine" / "calibration.toml")


def test_devices_are_called_by_their_ids_or_by_what_they_are(tmp_path: Path) -> None:
    job = read_scan_job(write(tmp_path, JOB))
    assert (job.arm.device_id, job.laser.device_id) == ("ur10e", "simulated")
    job = read_scan_job(write(tmp_path, JOB), {"arm.id": "arm 3", "laser.id": "2610-100 7"})
    assert (job.arm.device_id, job.laser.device_id) == ("arm 3", "2610-100 7")


def test_a_groove_is_read_as_its_table_says_and_as_always_without_one(tmp_path: Path) -> None:
    assert read_scan_job(write(tmp_path, JOB)).groove == DEFAULT_SETTINGS
    settings = read_scan_job(write(tmp_path, JOB), {"groove.largest_sigma_mm": 0.2}).groove
    assert settings.largest_sigma == pytest.approx(2e-4)
