"""A run is read again with other settings, beside what it was, which stays as it is."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cells import PAPER, calibration_file
from command import tjscan
from written import content

from tjscan.recording.parts import recording_files

SECTIONS = 6
MOVED = 0.05
"""Millimetres that corners may move by where a section is read with other tolerances."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run, all faults on."""
    directory = tmp_path_factory.mktemp("runs") / "run"
    assert tjscan("scan", PAPER, "--out", directory, "--scan.sections", SECTIONS) == 0
    return directory


def files(directory: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in directory.iterdir()}


def corners(run: Path) -> np.ndarray:
    with (run / "sections.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    names = [f"p{i}{axis}_mm" for i in (2, 3, 4) for axis in "xyz"]
    return np.array([[float(row[name]) for name in names] for row in rows])


def test_the_same_settings_give_the_same_to_the_last_digit(run: Path, tmp_path: Path) -> None:
    before, out = files(run), tmp_path / "again"
    assert tjscan("reprocess", run, "--out", out) == 0
    assert (out / "report.html").is_file()
    assert files(run) == before
    for name in ("sections.csv", "groove.ply", "scan.mcap", "joint.toml"):
        assert content(out / name) == content(run / name)
    told = json.loads((out / "summary.json").read_text())
    assert told["detail"].endswith(f"{SECTIONS} of {SECTIONS} sections read again")
    assert told["complete"]


def test_other_settings_are_read_with_and_written_down(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    assert tjscan("reprocess", run, "--out", out, "--groove.noise-mm", "0.08") == 0
    assert "noise_mm = 0.08" in (out / "job.toml").read_text()
    assert np.abs(corners(out) - corners(run)).max() < MOVED
    assert tjscan("reprocess", out, "--out", tmp_path / "third", "--groove.noise-mm", "0.05") == 0
    assert content(tmp_path / "third" / "sections.csv") == content(run / "sections.csv")


def test_another_calibration_moves_what_was_found(run: Path, tmp_path: Path) -> None:
    file, out = calibration_file(tmp_path / "calibration.toml"), tmp_path / "again"
    text = file.read_text().replace("-114.845", "-113.845")
    file.write_text(text)
    assert tjscan("reprocess", run, "--out", out, "--calibration.file", file) == 0
    moved = np.linalg.norm((corners(out) - corners(run)).reshape(-1, 3), axis=1)
    np.testing.assert_allclose(moved, 1.0, atol=1e-3)


def test_a_cut_run_is_read_as_far_as_it_goes(run: Path, tmp_path: Path) -> None:
    cut, out = tmp_path / "cut", tmp_path / "again"
    cut.mkdir()
    for name, data in files(run).items():
        if name in ("job.toml", "joint.toml", "scan.mcap"):
            (cut / name).write_bytes(data[: int(0.6 * len(data))] if "mcap" in name else data)
    assert tjscan("reprocess", cut, "--out", out) == 0
    found = corners(out)
    assert 2 <= len(found) < SECTIONS
    np.testing.assert_array_equal(found, corners(run)[: len(found)])
    told = json.loads((out / "summary.json").read_text())
    assert told["stopped_because"] == "recording ends"
    assert not told["complete"]


def test_of_a_damaged_recording_what_is_left_is_read_and_the_rest_named(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoilt, out = tmp_path / "spoilt", tmp_path / "again"
    shutil.copytree(run, spoilt)
    data = (spoilt / "scan.mcap").read_bytes()
    renamed = data.replace(b"tjscan.ProfileView", b"tjscan.ProfileVieu", 2)
    (spoilt / "scan.mcap").write_bytes(renamed)
    assert tjscan("reprocess", spoilt, "--out", out) == 1  # no message is known any more
    assert not out.exists()
    place = data.index(b'{"view": {"index": 3')
    (spoilt / "scan.mcap").write_bytes(data[:place] + b"[" + data[place + 1 :])
    capsys.readouterr()
    assert tjscan("reprocess", spoilt, "--out", out) == 1
    assert "3 messages are missing" in " ".join(capsys.readouterr().err.split())
    left = [i for i in range(SECTIONS) if i != 3]
    np.testing.assert_allclose(corners(out), corners(run)[left], atol=MOVED)
    told = json.loads((out / "summary.json").read_text())
    assert told["detail"].endswith("its recording is damaged in 1 place")
    assert "messages are missing" in (out / "report.html").read_text()


def test_a_resumed_run_is_read_whole(run: Path, tmp_path: Path) -> None:
    short = tmp_path / "short"
    assert tjscan("scan", run / "job.toml", "--out", short, "--scan.sections", "4") == 0
    assert tjscan("scan", "--resume", short, "--scan.sections", SECTIONS) == 0
    assert tjscan("reprocess", short, "--out", tmp_path / "again") == 0
    assert len(recording_files(tmp_path / "again")) == 2
    np.testing.assert_array_equal(corners(tmp_path / "again"), corners(short))


def test_it_is_written_beside_the_run_where_nothing_else_is_said(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = set(run.parent.iterdir())
    assert tjscan("reprocess", run) == 0
    (made,) = set(run.parent.iterdir()) - before
    assert made.name.startswith("run-")
    assert (made / "sections.csv").exists()


def test_sections_that_are_not_found_any_more_are_named(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "again"
    assert tjscan("reprocess", run, "--out", out, "--groove.minimum-points", "700") == 1
    assert "700 are needed" in " ".join(capsys.readouterr().err.split())
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--scan.step-mm", "20"], "how the profiles were taken"),
        (["--simulation.seed", "2"], "how the profiles were taken"),
        (["--groove.noise-mm", "-1"], "greater than"),
    ],
)
def test_what_was_measured_cannot_be_changed(
    run: Path,
    tmp_path: Path,
    options: list[str],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert tjscan("reprocess", run, "--out", tmp_path / "again", *options) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "again").exists()


def test_it_is_never_written_into_the_run(run: Path) -> None:
    assert tjscan("reprocess", run, "--out", run / "again") == 2
    assert tjscan("reprocess", run, "--out", run) == 2
    assert not (run / "again").exists()


def test_without_a_run_there_is_nothing_to_read(tmp_path: Path) -> None:
    assert tjscan("reprocess", tmp_path) == 2
