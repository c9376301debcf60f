"""The shell offers the keys of jobs as options, and the words that they may have."""

import shutil
import subprocess
from inspect import signature
from pathlib import Path

import pytest
from cells import PAPER
from command import tjscan

from tjscan.cli import COMMAND_GROUPS, app
from tjscan.cli.options import completion
from tjscan.cli.options.completion import JOB_KIND_OF_COMMAND, options_of_job
from tjscan.core.errors import ConfigurationError
from tjscan.job.files import read_scan_job


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("completion")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(folder))
        # Two of the commands: a script of all takes seconds to make.
        two = {path: JOB_KIND_OF_COMMAND[path] for path in (("scan",), ("crawl", "run"))}
        patch.setattr(completion, "JOB_KIND_OF_COMMAND", two)
        script = folder / "tjscan.bash"
        assert tjscan("--install-completion", "--shell", "bash", "--output", script) == 0
    return script


def offered(script: Path, *words: str) -> list[str]:
    """What bash offers for the last of the words."""
    if (bash := shutil.which("bash")) is None:
        pytest.skip("there is no bash here")
    line = " ".join(f"'{word}'" for word in words)
    ask = (
        f"source {script}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _tjscan; "
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    told = subprocess.run([bash, "-c", ask], capture_output=True, text=True, check=True)
    return told.stdout.split()


def test_keys_of_jobs_are_offered_with_the_words_that_they_may_have(script: Path) -> None:
    steps = offered(script, "tjscan", "scan", "paper.toml", "--scan.s")
    assert {"--scan.step-mm", "--scan.sections", "--scan.standoff-mm"} <= set(steps)
    assert "--torch.speed-mm-s" in offered(script, "tjscan", "crawl", "run", "--torch.")
    assert "smooth" in offered(script, "tjscan", "scan", "--scan.prediction-case", "sm")
    assert "--dry-run" in offered(script, "tjscan", "scan", "paper.toml", "--dry")


def test_options_that_are_offered_are_keys_of_the_job() -> None:
    for option, _ in list(options_of_job("scan"))[::9]:
        key = option.removeprefix("--").replace("-", "_")
        with pytest.raises(ConfigurationError) as refused:
            read_scan_job(PAPER, {key: ["no key takes this"]})
        assert "unknown key" not in refused.value.message, option


def test_all_commands_that_take_keys_are_known_and_left_as_they_were(script: Path) -> None:
    # Of the package tjscan-loopback, and a group of commands that is one itself.
    taking: set[tuple[str, ...]] = {("laser-loopback",), ("weld",)}
    for group, _, names in COMMAND_GROUPS:
        for name in names:
            function = group[name].default_command
            if function is not None and "overrides" in signature(function).parameters:
                taking.add((name,) if group is app else (group.name[0], name))
    assert taking == set(JOB_KIND_OF_COMMAND)
    assert getattr(app["scan"].default_command, "__name__", "") == "scan"
