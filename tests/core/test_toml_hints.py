"""What is proposed instead of a mistake in a file is right: written so, the file is read."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import radians
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.config import read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.toml_hints import unit_hint
from tjscan.core.units import PoseSettings
from tjscan.robot.settings import ArmSimulationSettings, ClearanceMargins, SolidSettings
from tjscan.scanning.plan import ScanPlan


def refusal(model: type, table: Mapping[str, object]) -> str:
    with pytest.raises(ConfigurationError) as refused:
        validate_table(model, table)
    return str(refused.value)


@given(st.floats(5, 300))
def test_a_step_in_metres_is_named_and_what_is_proposed_is_taken(step_mm: float) -> None:
    told = refusal(ScanPlan, {"step_mm": step_mm / 1e3})
    found = re.search(r"looks like metres: write (\S+)$", told)
    assert found is not None, told
    meant = validate_table(ScanPlan, {"step_mm": float(found[1])})
    assert meant.step == pytest.approx(step_mm / 1e3, rel=1e-5)


@given(st.floats(5, 300))
def test_what_is_within_bounds_is_never_called_of_another_unit(step_mm: float) -> None:
    assert validate_table(ScanPlan, {"step_mm": step_mm}).step == pytest.approx(step_mm / 1e3)


@pytest.mark.parametrize("value", [-40.0, 1e9, 0.0])
def test_no_unit_is_guessed_where_none_would_do(value: float) -> None:
    assert "looks like" not in refusal(ScanPlan, {"step_mm": value})


def test_units_of_several_letters_are_none_of_their_last() -> None:
    assert unit_hint("torque_n_m", 84000.0, None, 1000.0) == ""
    assert unit_hint("gyro_mrad_s", 84000.0, None, 1000.0) == ""
    assert "grams per metre: write 1.0" in unit_hint("mass_kg_m", 1000.0, None, 100.0)


@pytest.mark.parametrize("value", [0.5, -0.5])
def test_small_pulls_are_none_of_another_unit(value: float) -> None:
    assert validate_table(ScanPlan, {"pull_angle_deg": value}).pull_angle == radians(value)


def test_rounding_of_a_home_at_zero_is_no_radian() -> None:
    home = (0.0, 1e-9, 0.0, 0.0, 0.0, 0.0)
    assert validate_table(ArmSimulationSettings, {"home_deg": list(home)}).home[0] == 0
    assert "write [57.869" in refusal(ArmSimulationSettings, {"home_deg": [1.01, *home[1:]]})


@pytest.mark.parametrize("value", [0.0, 0.4, 1.0, -1.0])
def test_no_offset_is_none_of_another_unit(value: float) -> None:
    assert validate_table(ScanPlan, {"view_offset_mm": value}).offset == pytest.approx(value / 1e3)


def test_right_angles_in_radians_are_named_and_small_tilts_are_not() -> None:
    place = {"position_mm": [500.0, 0.0, 0.0]}
    told = refusal(PoseSettings, place | {"euler_zyx_deg": [3.1416, 0.0, 0.0]})
    assert "write [180.0" in told
    validate_table(PoseSettings, place | {"euler_zyx_deg": [1.2, -0.7, 0.3]})
    validate_table(PoseSettings, place | {"euler_zyx_deg": [1.5708, 90.0, 0.0]})
    # Small poses in which one number looks like a right angle, or is as round as any angle.
    validate_table(PoseSettings, place | {"euler_zyx_deg": [3.14159, -0.4, 1.2]})
    validate_table(PoseSettings, place | {"euler_zyx_deg": [0.0, 1.57, 0.0]})
    validate_table(PoseSettings, place | {"euler_zyx_deg": [3.14, 0.0, 0.0]})


def test_thin_solids_and_small_margins_are_none_of_another_unit() -> None:
    sheet = {"name": "sheet", "kind": "box", "position_mm": [0, 0, 0], "size_mm": [900, 900, 0.8]}
    wire = {"name": "wire", "kind": "cylinder", "radius_mm": 0.6, "length_mm": 40}
    for solid in (sheet, sheet | wire | {"size_mm": None}):
        stated = {key: value for key, value in solid.items() if value is not None}
        validate_table(SolidSettings, stated)
    assert "metres: write 96" in refusal(SolidSettings, sheet | {"size_mm": [0.096, 0.06, 0.085]})
    assert validate_table(ClearanceMargins, {"margin_mm": 0.2})
    assert "metres: write 10" in refusal(ClearanceMargins, {"margin_mm": 0.01})


@pytest.mark.parametrize(
    ("wrong", "meant", "hint"),
    [
        ("a = 40,5", "a = 40.5", "write"),
        ("a = True", "a = true", "write true"),
        ("a: 40", "a = 40", "write ="),
        ("a = 40 mm # of it", "a = 40", "the number alone, 40"),
        ("a = simulated", 'a = "simulated"', 'in quotes: "simulated"'),
        ("a = “one”", 'a = "one"', "plain ones"),
        (r'a = "C:\Users"', 'a = "C:/Users"', "write / in paths"),
        ("a = 1\na = 2", "a = 1", "delete one"),
    ],
)
def test_a_line_that_is_no_toml_is_shown_with_what_is_meant(
    wrong: str, meant: str, hint: str, tmp_path: Path
) -> None:
    file = tmp_path / "job.toml"
    file.write_text(f"# A job.\n{wrong}\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=f"(?i){re.escape(hint)}"):
        read_toml(file)
    file.write_text(meant, encoding="utf-8")
    read_toml(file)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_an_encoding_is_named_with_what_to_save(encoding: str, tmp_path: Path) -> None:
    file = tmp_path / "job.toml"
    file.write_bytes('# Führung\na = "ü"\n'.encode(encoding))
    with pytest.raises(ConfigurationError, match="UTF-8"):
        read_toml(file)


@pytest.mark.parametrize(
    ("found", "hint"),
    [
        ([-60, 3, 949, 6, 360, 1], r"\[-60\.3, 949\.6, 360\.1\]"),
        ([400, 0, 300, 180, 0, 0], r"\[400\.0, 300\.180, 0\.0\]; or .* a key each"),
        ([400.5, 0, 300, 180, 0, 0], r"\(found .*\); a position and a rotation have a key each"),
        ([1, 2, 3, 4, 5], "decimal commas"),
        ([1.5, 2.5, 3.5, 0.1, 0.2, 0.3], "a key each"),
        ([0.5, 0.5, 0.5, 0.5], "quaternion"),
    ],
)
def test_lists_of_another_length_are_told_apart(found: list[float], hint: str) -> None:
    assert re.search(hint, refusal(PoseSettings, {"position_mm": found}))
