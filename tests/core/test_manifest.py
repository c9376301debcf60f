"""A run directory's files are as they were written, or are named."""

import subprocess
from pathlib import Path

import pytest

from tjscan.core.errors import RecordingError
from tjscan.core.files import write_files_atomically
from tjscan.core.manifest import MANIFEST_FILE, check_files_unaltered, files_altered_since_written

NAMES = ("job.toml", "sections.csv")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A directory made in two goes, the second of which replaces a file."""
    run = tmp_path / "run"
    for names in (NAMES, NAMES[1:]):
        with write_files_atomically(run, listed=True) as draft:
            for name in names:
                (draft / name).write_text(f"{name} of {len(names)}\n")
    return run


def test_what_is_as_it_was_written_passes(run: Path) -> None:
    check_files_unaltered(*(run / name for name in (*NAMES, "not there")))


def test_every_flipped_bit_is_found(run: Path) -> None:
    for name in NAMES:
        data = (run / name).read_bytes()
        for bit in range(8 * len(data)):
            spoilt = bytearray(data)
            spoilt[bit // 8] ^= 1 << bit % 8
            (run / name).write_bytes(spoilt)
            assert files_altered_since_written(*(run / each for each in NAMES)) == [run / name]
        (run / name).write_bytes(data)


def test_a_list_that_is_damaged_or_cut_off_vouches_for_nothing(run: Path) -> None:
    data = (run / MANIFEST_FILE).read_bytes()
    for end in range(len(data) - 1):
        (run / MANIFEST_FILE).write_bytes(data[:end])
        assert files_altered_since_written(*(run / name for name in NAMES))
    for place in range(len(data)):
        spoilt = bytearray(data)
        spoilt[place] ^= 4
        (run / MANIFEST_FILE).write_bytes(spoilt)
        assert files_altered_since_written(*(run / name for name in NAMES))


def test_the_error_names_the_files_and_what_to_do(run: Path) -> None:
    (run / "job.toml").write_text("edited")
    with pytest.raises(RecordingError, match=r"job\.toml: not as SHA256SUMS .*a copy; without"):
        check_files_unaltered(*(run / name for name in NAMES))


@pytest.mark.parametrize("recording", ["scan.mcap", "left/scan.mcap"])
def test_only_of_a_scan_results_are_written_anew(run: Path, recording: str) -> None:
    (run / "job.toml").write_text("edited")
    (run / recording).parent.mkdir(exist_ok=True)
    (run / recording).touch()
    with pytest.raises(RecordingError, match=r"a copy, or .*tjscan reprocess"):
        check_files_unaltered(*(run / name for name in NAMES))


def test_sha256sum_reads_the_list(run: Path) -> None:
    subprocess.run(["sha256sum", "--strict", "-c", MANIFEST_FILE], cwd=run, check=True)


def test_only_a_directory_that_began_with_a_list_has_one(tmp_path: Path) -> None:
    (tmp_path / "older.csv").write_text("1\n")
    with write_files_atomically(tmp_path, listed=True) as draft:
        (draft / "new.csv").write_text("2\n")
    assert not (tmp_path / MANIFEST_FILE).exists()
    check_files_unaltered(tmp_path / "older.csv", tmp_path / "new.csv")
