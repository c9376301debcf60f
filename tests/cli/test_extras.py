"""Where a package of an extra is not installed, the command names the line to type."""

import sys
from pathlib import Path

import pytest
from command import tjscan

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
    assert tjscan(*command) == 2
    assert f"pip install 'tjscan[{extra}]'" in " ".join(capsys.readouterr().err.split())
