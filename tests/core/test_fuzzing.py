"""Whatever a file holds, its reader answers or says what is wrong, and never much later."""

import os
import warnings
from contextlib import suppress
from pathlib import Path

import pytest
from _corpus import readers
from _fuzz import Reader, fuzz
from _hostile import read_hostile_files
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tjscan.comparison.clouds import read_shape_file
from tjscan.core.config import LONGEST_LINE_CHARACTERS, MOST_CONFIGURATION_BYTES, read_toml
from tjscan.core.errors import ConfigurationError, RecordingError, TjscanError
from tjscan.core.files import check_file_size, refuse_links_outside, write_files_atomically
from tjscan.joint.file import read_joint
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.scanning.recording import read_views

INPUTS = 25
"""Of each reader; `make soak` takes thousands."""

SLOWEST = 5.0
"""Seconds that one input may take: more is a hang."""

MOST_BYTES = 500_000_000
"""By which reading one input may let the process grow."""


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> list[Reader]:
    return list(readers(tmp_path_factory.mktemp("corpus")))


def test_spoiled_files_end_in_an_answer_or_in_an_error_of_the_tree(
    corpus: list[Reader], tmp_path: Path
) -> None:
    for i, reader in enumerate(corpus):
        folder = tmp_path / str(i)
        (folder / reader.file).parent.mkdir(parents=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of numbers that overflow on the way to a refusal
            tally = fuzz(reader, INPUTS, 0, folder)
        assert not tally.wrong, (reader.name, tally.wrong[0][1])
        assert tally.slowest < SLOWEST, reader.name
        # Of a study's rows those that are spoiled are left out: they are scanned again.
        assert tally.refused > 0 or reader.name == "rows"


def test_files_that_lie_end_in_an_answer_or_in_an_error_of_the_tree(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tally = read_hostile_files(tmp_path)
    assert not tally.wrong, tally.wrong[0][1]
    assert tally.slowest < SLOWEST
    assert tally.grown < MOST_BYTES


def test_whole_files_are_read(corpus: list[Reader], tmp_path: Path) -> None:
    for i, reader in enumerate(corpus):
        file = tmp_path / str(i) / reader.file
        file.parent.mkdir(parents=True)
        for seed in reader.seeds:
            file.write_bytes(seed)
            reader.read(file)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=400), ending=st.sampled_from(["toml", "csv", "ply", "mcap", "pcd"]))
def test_random_bytes_end_in_an_error_of_the_tree_or_in_none(
    tmp_path: Path, data: bytes, ending: str
) -> None:
    file = tmp_path / f"file.{ending}"
    file.write_bytes(data)
    for read in (
        read_joint,
        read_shape_file,
        lambda f: list(read_views(f)),
        lambda f: read_profiles(f, ProfileFormat("mm", 1.0)),
    ):
        with suppress(TjscanError):
            read(file)


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    """A pipe that nobody writes to: whoever opens it waits for ever."""
    file = tmp_path / "pipe"
    os.mkfifo(file)
    return file


def test_pipes_and_devices_are_refused_before_they_are_opened(pipe: Path) -> None:
    for file in (pipe, Path("/dev/zero")):
        for read in (read_toml, read_joint, lambda f: list(read_views(f))):
            with pytest.raises(ConfigurationError, match="is no file"):
                read(file)
        with pytest.raises(ConfigurationError, match="is no file"):
            read_profiles(file, ProfileFormat("mm", 1.0))


def test_a_file_of_great_size_is_refused_before_it_is_read(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    with file.open("wb") as stream:
        stream.truncate(10**13)  # takes no room on the disk
    with pytest.raises(ConfigurationError, match="far too large"):
        list(read_views(file))
    with pytest.raises(ConfigurationError, match="far too large"):
        check_file_size(file, MOST_CONFIGURATION_BYTES, "anything")
    with pytest.raises(ConfigurationError, match="far too large"):
        read_profiles(file, ProfileFormat("mm", 1.0))


@pytest.mark.parametrize(
    "text",
    [
        "a" + ".a" * LONGEST_LINE_CHARACTERS + " = 1",
        "a = " + "[" * 3000 + "]" * 3000,
        "a = " + "7" * 4500,
        "a = 1\u0000",
        'a = "\ud800"',
    ],
)
def test_toml_that_would_exhaust_its_parser_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "deep.toml"
    file.write_bytes(text.encode("utf-8", errors="surrogatepass"))
    with pytest.raises(ConfigurationError):
        read_toml(file)


def test_a_link_out_of_a_directory_is_refused_and_one_inside_is_not(tmp_path: Path) -> None:
    run, outside = tmp_path / "run", tmp_path / "outside"
    run.mkdir()
    outside.write_text("x", encoding="utf-8")
    (run / "own").write_text("x", encoding="utf-8")
    (run / "inner").symlink_to(run / "own")
    (run / "outer").symlink_to(outside)
    refuse_links_outside(run, "own", "inner", "none")
    with pytest.raises(ConfigurationError, match="leads out of"):
        refuse_links_outside(run, "outer")


def test_a_draft_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("before", encoding="utf-8")

    def write_in_vain() -> None:
        with write_files_atomically(tmp_path) as draft:
            (draft / "kept").write_text("half", encoding="utf-8")
            raise OSError(28, "No space left on device")

    with pytest.raises(RecordingError, match="No space left"):
        write_in_vain()
    assert [file.name for file in tmp_path.iterdir()] == ["kept"]
    assert (tmp_path / "kept").read_text(encoding="utf-8") == "before"


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with (
        pytest.raises(RecordingError, match="can't be written"),
        write_files_atomically(tmp_path / "file" / "in"),
    ):
        pass
