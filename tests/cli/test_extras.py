"""Where a package of an extra is not installed, the command names the line to type."""

import sys
from pathlib import Path

import pytest
from command import tjscan
from cyclopts import App

from tjscan.cli import LOOPBACK_COMMANDS
from tjscan.core.display import to_data_frame
from tjscan.core.errors import ConfigurationError

ROOT = Path(__file__).parents[2]
RUN = ROOT / "tests" / "data" / "run-0.1.0"


@pytest.mark.parametrize(
    ("package", "extra", "command"),
    [
        ("shapely", "towing", ("tow", "run", ROOT / "examples" / "tow-yard.toml", "--dry-run")),
        ("weldx", "weldx", ("export", RUN, "--to", "weldx")),
    ],
)
def test_the_line_to_type_is_named(
    package: str,
    extra: str,
    command: tuple[object, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    # Another test may have imported the module that needs the package.
    monkeypatch.delitem(sys.modules, "tjscan.job.tow.floor", raising=False)
    assert tjscan(*command) == 2
    assert f"pip install 'tjscan[{extra}]'" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("command", LOOPBACK_COMMANDS)
def test_the_package_of_a_loopback_device_is_named(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tjscan.cli.app", App(name="tjscan"))
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: ())
    assert tjscan(command) == 2
    assert "pip install ./loopback" in " ".join(capsys.readouterr().err.split())


def test_a_table_of_pandas_names_it_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'tjscan\[pandas\]'"):
        to_data_frame({})
