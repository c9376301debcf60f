"""The WPS file: the user's windows, every key with its unit, nothing by default."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from tomli_w import dumps

from tjscan.core.errors import ConfigurationError
from tjscan.planning.wps import read_wps

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "wps.toml"


def written(tmp_path: Path, key: str, value: object) -> Path:
    """The example with one key replaced; None takes it out."""
    data = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    *tables, last = key.split(".")
    table = data
    for name in tables:
        table = table[name]
    if value is None:
        del table[last]
    else:
        table[last] = value
    file = tmp_path / "wps.toml"
    file.write_text(dumps(data), encoding="utf-8")
    return file


def test_the_example_says_that_it_is_made_up_and_is_in_si_units_inside() -> None:
    assert "MADE-UP" in EXAMPLE.read_text(encoding="utf-8").splitlines()[0]
    wps = read_wps(EXAMPLE)
    assert wps.arc.wire_feed == pytest.approx((0.1, 1 / 6))
    assert wps.arc.travel_speed == pytest.approx((4e-3, 7e-3))
    assert wps.bead.fill_area == pytest.approx((15e-6, 45e-6))


def test_a_bead_is_what_the_wire_brings_in() -> None:
    """1.2 mm wire at 9 m/min, 95 %, 300 mm/min: 32.2 mm², and 28 V, 250 A give 1.12 kJ/mm."""
    wps = read_wps(EXAMPLE)
    rate = float(wps.deposition_rate(np.array(9 / 60)))
    assert 1e6 * rate / 5e-3 == pytest.approx(32.2, abs=0.05)
    # Between the rows of 8 and 10 m/min: 250 A and 27.75 V.
    heat = float(wps.heat_input(np.array(9 / 60), np.array(5e-3)))
    assert heat == pytest.approx(0.8 * 250 * 27.75 / 5e-3)


SOLID = {
    "name": "nozzle",
    "kind": "capsule",
    "radius_mm": 8.0,
    "length_mm": 60.0,
    "position_mm": [0.0, 0.0, 290.0],
}


def test_tacks_of_which_nothing_would_be_skipped_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path, "root.tacks", "skip")
    assert read_wps(file).root.tacks == "skip"
    text = file.read_text(encoding="utf-8").replace(
        "tack_length_mm = 40.0", "tack_length_mm = 30.0"
    )
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"twice sequence\.overlap_mm, 30,"):
        read_wps(file)


def test_the_power_source_must_reach_what_an_open_root_is_welded_with(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"end to end of root\.wire_feed"):
        read_wps(written(tmp_path, "root.wire_feed_m_min", [4.0, 8.0]))


def test_a_detail_with_an_empty_window_is_refused(tmp_path: Path) -> None:
    detail = {
        "name": "side",
        "dihedral_deg": [130.0, 50.0],
        "groove_angle_deg": [40.0, 60.0],
        "root_opening_mm": [2.0, 6.0],
        "size_mm": [10.0, 60.0],
    }
    with pytest.raises(ConfigurationError, match="empty window"):
        read_wps(written(tmp_path, "detail", [detail]))


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("arc.travel_speed_mm_min", [420.0, 240.0], "empty window"),
        ("bead.layer_height_mm", [3.0, 3.0], "empty window"),
        ("bead.root_area_mm2", [-1.0, 3.0], "greater than 0"),
        ("arc.power", [[6.0, 190.0, 24.0], [6.0, 200.0, 25.0]], "must grow"),
        ("arc.power", [[7.0, 190.0, 24.0], [10.0, 200.0, 25.0]], "from end to end"),
        ("wire.deposition_efficiency", 95.0, "less than or equal to 1"),
        ("wire.diametre_mm", 1.2, "did you mean: diameter_mm"),
        ("arc.thermal_efficiency", None, "required"),
        ("bead.weave_limit_mm", None, "required"),
        ("torch.solid", [], "at least 1"),
        ("torch.solid", 2 * [SOLID], "a name of its own"),
        ("sequence.positions", ["PZ"], "none of"),
        ("wire.density_kg_m3", 7.85, "greater"),
        ("sequence.interpass_temperature_C", 2500.0, "less"),
        ("sequence.ends", "round", "none of"),
        ("root.opening_mm", [6.0, 2.0], "empty window"),
        ("root.tacks", "leave", "none of"),
    ],
)
def test_a_wps_that_can_t_be_is_refused_with_its_key(
    key: str, value: object, says: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match=says) as error:
        read_wps(written(tmp_path, key, value))
    assert error.value.file is not None
    assert error.value.key is not None
    assert error.value.key.startswith(key if "grow" in says or value is None else key.split(".")[0])


def test_windows_that_no_wire_feed_and_speed_of_the_file_reach_are_refused(tmp_path: Path) -> None:
    for key, value in (("arc", [500.0, 2000.0]), ("root", [0.001, 0.002])):
        with pytest.raises(ConfigurationError, match=f"{key}.heat_input_kJ_mm allows .* unit"):
            read_wps(written(tmp_path, f"{key}.heat_input_kJ_mm", value))
    slow = [{"name": "PF", "wire_feed_m_min": [2.0, 3.0]}]
    with pytest.raises(ConfigurationError, match="of PF lies outside"):
        read_wps(written(tmp_path, "position", slow))
