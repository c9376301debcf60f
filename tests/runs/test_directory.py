"""What a run directory may hold, and what may be made of it."""

from pathlib import Path

import pytest

from tjscan.core.errors import ConfigurationError
from tjscan.runs.directory import check_replay


def test_a_replay_changes_what_was_made_of_a_run_and_not_how_it_was_done(tmp_path: Path) -> None:
    check_replay(tmp_path / "run", tmp_path / "out", ("weights.bending",), ("weights.",), "tow")
    with pytest.raises(ConfigurationError, match="how the tow was done") as caught:
        check_replay(tmp_path / "run", tmp_path / "out", ("seam.speed",), ("weights.",), "tow")
    assert caught.value.key == "seam.speed"


def test_a_replay_lies_beside_its_run(tmp_path: Path) -> None:
    for out in (tmp_path, tmp_path / "deeper", tmp_path / "a" / ".."):
        with pytest.raises(ConfigurationError, match="stays as it is"):
            check_replay(tmp_path, out, (), (), "crawl")
