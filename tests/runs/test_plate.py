"""Beads on a plate, from a file: `tjscan weld calibrate` gives the model that laid them."""

import json
from pathlib import Path

import numpy as np
import pytest
from command import tjscan

from tjscan.core.errors import ConfigurationError
from tjscan.runs.weld.plate import PLATE_COLUMNS, fit_plate
from tjscan.welding.bead import BeadModel, lay_beads

BEADS = ((0.0, 9.0, 500.0, 0.8), (45.0, 9.0, 330.0, 1.3), (90.0, 9.0, 170.0, 0.7))
"""Aim, mm; wire feed, m/min; travel speed, mm/min; heat input, kJ/mm."""


def write_plate(folder: Path, offset: float = 0.3e-3) -> Path:
    """The file of three beads and their scan, of a deposition efficiency of 0.9."""
    u = np.tile(np.arange(-25e-3, 115e-3, 0.3e-3), (6, 1))
    w, row, text = 0 * u, np.ones(6), 'scan = "scan.csv"\n\n[wire]\ndiameter_mm = 1.2\n'
    text += "density_kg_m3 = 7850\ndeposition_efficiency = 0.95\n"
    for aim, feed, speed, heat in BEADS:
        area = 0.9 * 0.25 * np.pi * 1.2**2 * feed * 1e3 / speed * 1e-6
        w = lay_beads(
            BeadModel(), u, w, centre=(1e-3 * aim + offset) * row,
            width=BeadModel().bead_width(1e6 * heat * row), area=area * row, tilt=0 * row,
        ).w  # fmt: skip
        text += f"\n[[bead]]\naim_mm = {aim}\nwire_feed_m_min = {feed}\n"
        text += f"travel_speed_mm_min = {speed}\nheat_input_kJ_mm = {heat}\n"
    lines = [
        f"{k},{1e3 * x:.4f},{1e3 * z:.4f}"
        for k, (across, up) in enumerate(zip(u, w, strict=True))
        for x, z in zip(across, up, strict=True)
    ]
    (folder / "scan.csv").write_text("\n".join((",".join(PLATE_COLUMNS), *lines)))
    file = folder / "plate.toml"
    file.write_text(text)
    return file


def test_beads_give_back_efficiency_offset_and_width(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("weld", "calibrate", write_plate(tmp_path), "--json") == 0
    said = capsys.readouterr()
    assert "[weld.bead]" in said.err
    fit = json.loads(said.out)
    assert fit["efficiency"] == pytest.approx(0.9, rel=0.01)
    assert fit["offset"] == pytest.approx(0.3e-3, abs=0.05e-3)
    assert fit["model"]["width_factor"] == pytest.approx(10e-3, rel=0.02)


def test_table_that_is_none_is_refused(tmp_path: Path) -> None:
    file = write_plate(tmp_path)
    for text, message in (("a,b\n1,2\n", "needs the columns"), ("x\ny", "no table of numbers")):
        (tmp_path / "scan.csv").write_text(text)
        with pytest.raises(ConfigurationError, match=message):
            fit_plate(file)
