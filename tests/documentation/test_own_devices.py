"""The driver that the documents show is a driver: a job names it, and profiles come."""

import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from cells import PAPER
from command import tjscan
from documented import ROOT, fenced_blocks

from tjscan.laser.drivers import LASER_DRIVERS


def connected(host: str, exposure_us: float) -> SimpleNamespace:
    """A maker's library that gives a plate at 240 mm, with one column missing."""
    x = np.linspace(-20.0, 20.0, 200)
    rows = np.column_stack([x, np.where(np.arange(200) == 7, 0.0, 240.0)])
    assert host == "192.168.1.20"
    assert exposure_us == pytest.approx(250.0)
    return SimpleNamespace(trigger=lambda timeout_s: rows, close=lambda: None)


def test_the_driver_of_the_documents_takes_profiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = ROOT / "docs" / "own-devices.md"
    blocks = (block.text for block in fenced_blocks(page) if block.language != "sh")
    driver, package, job, _towing_vehicle = blocks
    name, place = re.findall(r'(\w+) = "(\w+:\w+)"', package)[0]
    (tmp_path / f"{place.partition(':')[0]}.py").write_text(driver, encoding="utf-8")
    text = re.sub(r"(?ms)^\[laser\].*?(?=^\[)", job + "\n", PAPER.read_text(encoding="utf-8"))
    (tmp_path / "job.toml").write_text(text, encoding="utf-8")
    library = ModuleType("acme")
    vars(library)["connect"] = connected
    monkeypatch.setitem(sys.modules, "acme", library)
    monkeypatch.syspath_prepend(tmp_path)
    added = EntryPoint(name, place, "tjscan.laser")
    monkeypatch.setitem(vars(LASER_DRIVERS), "_entries", {**LASER_DRIVERS._entries, name: added})
    written = tmp_path / "profiles.csv"
    assert tjscan("laser", tmp_path / "job.toml", "--profiles", "2", "--write", written) == 0
    rows = np.genfromtxt(written, delimiter=",", skip_header=1)
    assert np.isnan(rows[:, -1]).sum() == 2
    np.testing.assert_allclose(rows[~np.isnan(rows[:, -1]), -1], 240.0)
