"""Every command in the documents: run on a small job, or parsed where it can't be run here."""

import re
import shlex
import shutil
import subprocess
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from command import tjscan
from documented import DOCUMENTS, ROOT, commands_of, fenced_blocks, without_blocks

import tjscan as api
from tjscan.cli import _load_commands, add_commands_of_packages, app
from tjscan.cli.options.shared import parse_overrides
from tjscan.job.crawl.job import read_crawl_job
from tjscan.job.files import (
    has_recorded_profiles,
    read_acceptance_job,
    read_calibration_job,
    read_laser_job,
    read_recorded_job,
    read_scan_job,
)
from tjscan.job.tow.job import read_tow_job
from tjscan.job.weld import read_weld_job
from tjscan.runs.chain import read_chain_file
from tjscan.runs.tasks import study_backend_of_task
from tjscan.study.file import read_study_file

add_commands_of_packages()  # as the program does for one that it does not know

RUN: Final = {
    r"tjscan init \w+": (),
    r"tjscan schema": (),
    r"tjscan scan paper.toml": ("--scan.sections", "6"),
    r"tjscan scan (?!paper.toml|--resume)(?!.*(--live|driver|calibration.file))": ("--dry-run",),
    r"tjscan doctor": (),
    r"tjscan teach .*--lead-mm": (),
    r"tjscan groove (?!first.csv)": (),
    r"tjscan reprocess": (),
    r"tjscan joint": (),
    r"tjscan compare": (),
    r"tjscan report": (),
    r"tjscan export": (),
    r"tjscan plan": (),
    r"tjscan crawl size": (),
    r"tjscan study examples/(paper|crawl|tow)-study.toml(?!.*--scheduler)": ("--dry-run",),
}
"""Commands that are run, and the options that make them small."""

PARSED: Final = {
    r"tjscan scan --resume": "tests/runs/test_resume.py interrupts scans and goes on with them",
    r"tjscan scan .*--live": "serves a page until it is closed",
    r"tjscan scan .*driver (replay|ur|kuka|abb|fanuc)": "a controller or a run is behind it",
    r"tjscan scan .*calibration.file": "tests/calibration/test_calibrate_command.py makes the file",
    r"tjscan teach (?!.*--lead-mm)": "no hand leads a simulated arm",
    r"tjscan groove first.csv": "the file comes from a real laser",
    r"tjscan accept": "takes a while; tests/runs/accept/test_acceptance.py runs a short one",
    r"tjscan calibrate": "takes minutes; tests/calibration/test_calibrate_command.py runs it",
    r"tjscan place": "takes half a minute; tests/runs/place/test_place.py runs it",
    r"tjscan stitch": "takes minutes; tests/runs/test_stitch_command.py runs it",
    r"tjscan chain": "takes minutes; tests/runs/test_chain.py runs it",
    r"tjscan laser ": "needs a laser; tests/loopback/laser/test_laser_loopback.py has one",
    r"tjscan (ur|kuka|abb|fanuc|laser|vehicle|power)-loopback": "serves until it is interrupted",
    r"tjscan view": "serves a page until it is closed",
    r"tjscan study .*--(scheduler|resume)": "wants a cluster, or a study that was interrupted",
    r"tjscan study examples/joints-study.toml --dry-run": "makes a hundred joints to check them",
    r"tjscan crawl (run|calibrate)": "takes minutes; tests/runs/test_crawl.py runs short ones",
    r"tjscan crawl register": "takes minutes; tests/crawler/test_torch_axes.py runs a short one",
    r"tjscan crawl (replay|compare)": "tests/runs/test_crawl_replay.py has the crawls for it",
    r"tjscan weld": "takes minutes; tests/runs/test_weld.py welds a short groove",
    r"tjscan tow": "takes minutes; tests/runs/test_tow.py runs a short one",
    r"tjscan --install-completion": "would change the shell of whoever runs the tests",
}
"""Commands that are only parsed, their keys checked by the settings that take them, and why."""

FOREIGN: Final = {
    r"make ": "its target must exist: make --dry-run",
    r"pip install": "its extras and its pins must exist",
    r"pytest ": "its paths must exist",
    r"dask ": "parsed by its own parser",
    r"openssl ": "run, where there is one",
    r"mosquitto ": "serves until it is stopped, and has no way to parse alone",
    r"(export|for|done)\b": "the shell's own words: bash reads the block",
}
"""Commands of other programs, and what is checked of them."""


def read_job_of_calibration(file: Path, keys: dict[str, Any]) -> object:
    """The job of a cell to calibrate, or of recorded profiles; these alone have a table [noise]."""
    if any(key.startswith("noise.") for key in keys):
        file = file.with_name("calibrate-recorded.toml")
    read = read_recorded_job if has_recorded_profiles(file) else read_calibration_job
    return read(file, keys)


LOADERS: Final[dict[str, tuple[Callable[[Path, Any], object], str]]] = {
    "scan": (read_scan_job, "paper"),
    "teach": (read_scan_job, "paper"),
    "laser-loopback": (read_scan_job, "paper"),
    "laser": (read_laser_job, "paper"),
    "accept": (read_acceptance_job, "accept"),
    "calibrate": (read_job_of_calibration, "calibrate"),
    "crawl run": (read_crawl_job, "crawl"),
    "crawl calibrate": (read_crawl_job, "crawl"),
    "crawl register": (read_crawl_job, "crawl"),
    "crawl replay": (read_crawl_job, "crawl"),
    "weld": (read_weld_job, "weld"),
    "tow run": (read_tow_job, "tow-simulation"),
    "tow replay": (read_tow_job, "tow-simulation"),
    "study": (lambda file, _: read_study_file(file, study_backend_of_task), "paper-study"),
    "chain": (lambda file, _: read_chain_file(file), "paper-chain"),
}
"""What reads the file of a command that is only parsed, and the example that stands for JOB."""

COMMANDS: Final = {document: commands_of(document) for document in DOCUMENTS}
ALL: Final = sorted({command for commands in COMMANDS.values() for command in commands})
TUTORIAL: Final = COMMANDS[ROOT / "docs" / "tutorial.md"]


def matching(table: dict[str, Any], commands: Sequence[str] = ALL) -> list[str]:
    """The commands that match a row of a table."""
    return [one for one in commands if any(re.match(row, one) for row in table)]


def one_of_the_tutorial(command: str) -> str:
    """A command with the names that the tutorial has for its run and its files."""
    return re.sub(r"cad/|examples/", "", command.replace("runs/paper-DATE", "runs/first"))


def exit_code(command: str, small: Sequence[str] = ()) -> int:
    """Exit code of a command of the documents, run in this process."""
    _, *words = shlex.split(command.partition(" '>' ")[0])
    return tjscan(*words, *(word for word in small if word not in words))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the tutorial was followed, with files of the names that documents give."""
    folder = tmp_path_factory.mktemp("documented")
    for name in ("examples", "cad"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("build"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for command in matching(RUN, TUTORIAL):
            (small,) = (options for row, options in RUN.items() if re.match(row, command))
            assert exit_code(command, small) == 0, command
        shutil.copy("paper.toml", "JOB.toml")
        Path("runs/paper-DATE").symlink_to("first")
        assert tjscan("joint", "cad/tjoint-600x457.toml", "--out", folder) == 0
    (folder / "tjoint-600x457.stl").rename(folder / "part.stl")
    np.savetxt(folder / "scan.xyz", 1e3 * api.Scan.read(folder / "runs" / "first").cloud)
    profile = api.Recording(folder / "runs" / "first").profiles[0]
    np.savetxt(folder / "profiles.csv", 1e3 * profile.points_s[:, ::2], header="x,z", delimiter=",")
    return folder


@pytest.mark.parametrize("command", ALL)
def test_it_is_known_how_each_command_is_tried(command: str) -> None:
    rows = [row for table in (RUN, PARSED, FOREIGN) for row in table if re.match(row, command)]
    assert len(rows) == 1, f"{command!r} needs one row in RUN, PARSED or FOREIGN, and has {rows}"


def test_a_test_that_a_reason_names_is_there() -> None:
    named = re.findall(r"tests/\S+\.py", " ".join(PARSED.values()))
    assert all((ROOT / file).is_file() for file in named)


@pytest.mark.parametrize("row", [*RUN, *PARSED, *FOREIGN])
def test_no_row_is_left_of_a_command_that_went(row: str) -> None:
    assert matching({row: None})


@pytest.mark.parametrize(
    "command", [one for one in matching(RUN) if one_of_the_tutorial(one) not in TUTORIAL]
)
def test_a_command_runs(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    (small,) = (options for row, options in RUN.items() if re.match(row, command))
    assert exit_code(command, small) == 0


@pytest.mark.parametrize("command", matching(PARSED))
def test_a_command_is_parsed_and_its_keys_are_known(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    _, *words = shlex.split(command)
    _load_commands(words)
    _, bound, *_ = app.parse_args(words, exit_on_error=False, print_error=False)
    called = " ".join(app.parse_commands(words)[0])
    keys = parse_overrides(bound.arguments.get("overrides", ()))
    examples = [Path(word) for word in words if word.startswith(("examples/", "cad/"))]
    assert all(file.is_file() for file in examples)
    assert called in LOADERS or not keys
    if called in LOADERS:
        read, example = LOADERS[called]
        read(next(iter(examples), Path("examples") / f"{example}.toml"), keys)


@pytest.mark.parametrize("command", matching(FOREIGN))
def test_a_command_of_another_program_names_what_there_is(command: str, tmp_path: Path) -> None:
    program, *words = shlex.split(command)
    if program == "make":
        subprocess.run(["make", "--dry-run", *words], cwd=ROOT, capture_output=True, check=True)
    elif program == "pip":
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        asked = {name for extras in re.findall(r"\[(.*?)\]", command) for name in extras.split(",")}
        assert asked <= project["optional-dependencies"].keys()
        assert "-c" not in words or (ROOT / words[words.index("-c") + 1]).is_file()
    elif program == "pytest":
        assert all((ROOT / word).exists() for word in words if "/" in word)
    elif program == "dask":
        module = pytest.importorskip(f"distributed.cli.dask_{words[0]}")
        module.main.make_context(command, words[1:])
    elif program == "openssl" and shutil.which("openssl"):
        subprocess.run([program, *words], cwd=tmp_path, capture_output=True, check=True)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.name)
def test_a_sentence_names_targets_that_there_are(document: Path) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (targets,) = re.findall(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert {*re.findall(r"`make (\w+)", without_blocks(document))} <= {*targets.split()}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.name)
def test_a_shell_reads_every_block(document: Path) -> None:
    blocks = [block.text for block in fenced_blocks(document) if block.language == "sh"]
    if blocks:
        text = "\n".join(blocks)
        subprocess.run(["bash", "-n"], input=text, text=True, capture_output=True, check=True)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.name)
def test_a_sentence_names_commands_and_options_that_there_are(document: Path) -> None:
    for mention in re.findall(r"`tjscan\s([^`]+)`", without_blocks(document)):
        flags = {*app.help_flags, *app.version_flags}
        words = [word for word in shlex.split(mention) if word not in flags]
        if not words:
            continue
        called, (*groups, named), _ = app.parse_commands(words)
        assert groups, mention
        known = {*called}
        if named.default_command is not None:
            known |= {name for one in named.assemble_argument_collection() for name in one.names}
        asked = {word.partition("=")[0] for word in words if word.startswith("--")}
        assert {word for word in asked if "." not in word} <= known, mention
