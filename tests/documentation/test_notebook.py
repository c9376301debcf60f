"""The notebook runs from its first cell to its last, and is kept without what it printed."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from documented import ROOT

NOTEBOOK = json.loads((ROOT / "examples" / "first-scan.ipynb").read_text(encoding="utf-8"))
CODE = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


@pytest.fixture
def no_window() -> Iterator[None]:
    """Figures without windows, closed at the end."""
    from matplotlib import pyplot

    before = pyplot.get_backend()
    pyplot.switch_backend("agg")
    yield
    pyplot.close("all")
    pyplot.switch_backend(before)


def test_it_is_kept_without_output() -> None:
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in CODE)


def test_it_runs(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    no_window: None,
) -> None:
    for folder in ("examples", "cad"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("build"))
    monkeypatch.chdir(tmp_path / "examples")
    names: dict[str, object] = {}
    for cell in CODE:
        exec("".join(cell["source"]), names)
    printed = capsys.readouterr().out
    assert "6 sections in frame j" in printed
    assert "within the tolerance" in printed
