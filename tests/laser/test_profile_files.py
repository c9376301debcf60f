"""Profiles written one way are the same profiles read another way; what is bad is named."""

from pathlib import Path

import numpy as np
import pytest

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.laser.files import UNITS, ProfileFormat, read_profiles

ROUNDING = 1e-12
"""Metres: a few roundings of decimal numbers."""

Z_MM = np.array([200.0, 201.5, np.nan, 203.25, 204.0])
X_MM = np.array([-4.0, -2.0, np.nan, 2.0, 4.0])


def write(folder: Path, text: str, name: str = "profiles.csv") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def assert_expected(x_s: Array, z_s: Array) -> None:
    np.testing.assert_allclose(x_s, 1e-3 * X_MM, atol=ROUNDING)
    np.testing.assert_allclose(z_s, 1e-3 * Z_MM, atol=ROUNDING)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("missing", ["nan", "", "NaN", "inf"])
def test_columns_with_their_unit(tmp_path: Path, unit: str, missing: str) -> None:
    scale = 1e-3 / UNITS[unit]
    rows = [
        f"{missing},{missing}" if np.isnan(z) else f"{x * scale!r},{z * scale!r}"
        for x, z in zip(X_MM.tolist(), Z_MM.tolist(), strict=True)
    ]
    text = "\n".join([f"x_{unit},z_{unit}", *rows])
    (profile,) = read_profiles(write(tmp_path, text), ProfileFormat()).profiles.values()
    assert_expected(profile.x_s, profile.z_s)


def test_a_matrix_holds_a_profile_per_row(tmp_path: Path) -> None:
    row = "200,201.5,-99,203.25,204"
    form = ProfileFormat(unit="mm", pitch=2.0, invalid=(-99.0,))
    table = read_profiles(write(tmp_path, f"{row}\n{row}\n"), form)
    assert list(table.profiles) == ["row 1", "row 2"]
    for profile in table.profiles.values():
        assert_expected(profile.x_s, profile.z_s)


def test_a_column_tells_profiles_apart_and_the_unit_may_be_an_option(tmp_path: Path) -> None:
    text = "frame,u_px,x,z\n3,0,1,200\n3,1,2,201\n7,0,5,300\n"
    table = read_profiles(write(tmp_path, text), ProfileFormat(unit="mm"))
    assert list(table.profiles) == ["frame 3", "frame 7"]
    assert table.profiles["frame 3"].x_s == pytest.approx([0.001, 0.002])


def test_a_ply_holds_one_profile(tmp_path: Path) -> None:
    points = "\n".join(f"{x} 0 {z}" for x, z in zip(X_MM[:2], Z_MM[:2], strict=True))
    header = "ply\nformat ascii 1.0\nelement vertex 2\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    file = write(tmp_path, header + points + "\n", "profile.ply")
    (profile,) = read_profiles(file, ProfileFormat(unit="mm")).profiles.values()
    assert profile.x_s == pytest.approx(1e-3 * X_MM[:2])
    assert profile.z_s == pytest.approx(1e-3 * Z_MM[:2])


def test_bad_rows_are_named_and_the_rest_goes_on(tmp_path: Path) -> None:
    text = "1,2,3\n1,x,3\n1,2\n\n4,5,6\n"
    form = ProfileFormat(unit="mm", pitch=1.0)
    table = read_profiles(write(tmp_path, text), form)
    assert list(table.profiles) == ["row 1", "row 5"]
    assert table.bad == ["row 2: 'x' is no number", "row 3: 2 columns, the first row has 3"]
    table = read_profiles(write(tmp_path, "x_mm,z_mm\n1,2\noops,3\n4,5\n"), ProfileFormat())
    assert len(table.profiles["profiles.csv"]) == 2
    assert table.bad == ["row 3: 'oops' is no number"]


@pytest.mark.parametrize(
    ("text", "form", "hint"),
    [
        ("", ProfileFormat(), "empty"),
        ("x,z\n1,2\n", ProfileFormat(), "--units"),
        ("1,2,3\n", ProfileFormat(unit="mm"), "--pitch"),
        ("1,2,3\n", ProfileFormat(unit="mm", pitch=-1.0), "--pitch"),
        ("x_mm,y_mm\n1,2\n", ProfileFormat(), "no column z"),
        ("1,2\n", ProfileFormat(unit="furlong"), "unknown unit"),
    ],
)
def test_what_a_file_lacks_is_asked_for(
    tmp_path: Path, text: str, form: ProfileFormat, hint: str
) -> None:
    with pytest.raises(ConfigurationError, match=hint):
        read_profiles(write(tmp_path, text), form)


@pytest.mark.parametrize("name", ["profile.csv", "profile.ply"])
def test_bytes_that_are_no_profile_are_refused(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.write_bytes(b"\xff\xfe\x00binary\x00")
    with pytest.raises(ConfigurationError, match=name):
        read_profiles(file, ProfileFormat(unit="mm"))
    with pytest.raises(ConfigurationError, match="no such file"):
        read_profiles(tmp_path / "none" / name, ProfileFormat(unit="mm"))


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("mm", 1e-3), ("um", 1.0)])
def test_a_mistaken_unit_is_caught(tmp_path: Path, unit: str, scale: float) -> None:
    rows = "\n".join(f"{x * scale},{(200 + x) * scale}" for x in range(-30, 31))
    with pytest.raises(ConfigurationError, match="is the unit right"):
        read_profiles(write(tmp_path, f"x_{unit},z_{unit}\n{rows}\n"), ProfileFormat())


def test_other_separators_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="separate columns by commas"):
        read_profiles(write(tmp_path, "x_mm;z_mm\n1;2\n"), ProfileFormat())
