"""A calibration that is planned only: what it promises, and what it finds wrong beforehand."""

import re
from pathlib import Path

import pytest
from command import tjscan

JOB = Path(__file__).parents[2] / "examples" / "calibrate.toml"


def test_lines_are_planned_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert tjscan("calibrate", JOB, "--dry-run", "--board.lines", 6) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "all 6 lines" in told
    found = re.search(r"uncertain to ([\d.]+) mm and ([\d.]+)°", told)
    assert found is not None
    position, rotation = map(float, found.groups())
    assert 0.05 < position < 1.0  # of lines with noise of 0.03 mm, some 0.1 m from the flange
    assert 0.01 < rotation < 0.2
    assert list(tmp_path.iterdir()) == []


def test_a_board_out_of_reach_is_found_before_anything_moves(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert tjscan("calibrate", JOB, "--dry-run", "--board.position-mm", "[3000, 0, 0]") == 1
    assert "can't get square over the board" in " ".join(capsys.readouterr().err.split())
