"""Example files for a new user: whole, sound, and never over somebody's own."""

from pathlib import Path

import pytest
from command import tjscan

from tjscan.job.examples import examples, files_of_example


@pytest.mark.parametrize("name", examples())
def test_an_example_brings_every_file_that_it_names(name: str) -> None:
    texts = files_of_example(name)
    assert f"{name}.toml" in texts
    assert not any("../cad/" in text or "examples/" in text for text in texts.values())


def test_what_was_written_is_a_job_that_the_program_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("init", "paper", "--out", tmp_path / "new") == 0
    told = capsys.readouterr().err
    assert "tjscan scan" in told
    job = tmp_path / "new" / "paper.toml"
    first, *_ = job.read_text(encoding="utf-8").splitlines()
    schema = first.removeprefix("#:schema ")
    assert (job.parent / schema).is_file()
    assert tjscan("scan", job, "--dry-run") == 0


def test_what_is_there_is_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "tjoint-600x457.toml"
    own.write_text("# mine", encoding="utf-8")
    assert tjscan("init", "paper", "--out", tmp_path) == 2
    assert "there already" in " ".join(capsys.readouterr().err.split())
    assert [file.name for file in tmp_path.iterdir()] == [own.name]
    assert own.read_text(encoding="utf-8") == "# mine"


def test_an_unknown_example_is_named_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert tjscan("init", "papr") == 2
    assert "did you mean: paper?" in capsys.readouterr().err
    assert tjscan("init", "nothing-like-any") == 2
    assert capsys.readouterr().err.count("whole-joint") == 1


def test_examples_share_files_in_one_folder(tmp_path: Path) -> None:
    assert tjscan("init", "paper", "--out", tmp_path) == 0
    before = {file: file.stat().st_mtime_ns for file in tmp_path.iterdir()}
    assert tjscan("init", "whole-joint", "--out", tmp_path) == 0
    assert {file: file.stat().st_mtime_ns for file in before} == before
    assert tjscan("scan", tmp_path / "whole-joint.toml", "--dry-run") == 0
    assert tjscan("init", "whole-joint", "--out", tmp_path) == 2
