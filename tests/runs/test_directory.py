"""What a run directory may hold, and what may be made of it."""

from pathlib import Path

import pytest
from command import tjscan

from tjscan.core.errors import ConfigurationError
from tjscan.runs.run import check_replay


def make_run(directory: Path, what: str) -> Path:
    """Make a directory with what tells the run of one kind from another's."""
    directory.mkdir()
    (directory / "job.toml").touch()
    (directory / f"{what}.mcap").touch()
    return directory


def test_a_replay_changes_what_was_made_of_a_run_and_not_how_it_was_done(tmp_path: Path) -> None:
    run, keys = make_run(tmp_path / "run", "tow"), ("method", "weights.")
    check_replay(run, tmp_path / "out", ("weights.bending",), keys, "tow")
    said = "how the tow was done.* may change: method, weights$"
    with pytest.raises(ConfigurationError, match=said) as caught:
        check_replay(run, tmp_path / "out", ("seam.speed",), keys, "tow")
    assert caught.value.key == "seam.speed"


def test_a_replay_lies_beside_its_run(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", "crawl")
    for out in (run, run / "deeper", run / "a" / ".."):
        with pytest.raises(ConfigurationError, match="stays as it is"):
            check_replay(run, out, (), (), "crawl")


@pytest.mark.parametrize(
    ("made", "words", "said"),
    [
        ("tow", ("crawl", "replay"), "holds no crawl: it holds a tow: tjscan tow replay takes it"),
        ("crawl", ("tow", "replay"), "holds no tow: it holds a crawl: tjscan crawl replay takes"),
        ("scan", ("tow", "replay"), "holds no tow: give the run directory of one"),
        ("scan", ("crawl", "replay"), "holds no crawl: give the run directory of one"),
        ("", ("tow", "replay"), "holds no tow: give the run directory of one"),
        ("", ("tow", "run", "--resume"), "holds no tow: give the run directory of one"),
    ],
)
def test_a_folder_without_such_a_run_is_refused_with_what_takes_it(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    made: str,
    words: tuple[str, ...],
    said: str,
) -> None:
    folder = make_run(tmp_path / "run", made) if made else tmp_path
    assert tjscan(*words, folder) == 2
    assert said in " ".join(capsys.readouterr().err.split())
