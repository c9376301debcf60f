"""Profiles written one way are the same profiles read another way; what is bad is named."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.laser.files.format import METRES_PER_UNIT, ProfileFormat
from tjscan.laser.files.read import flip_heights, read_profiles

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


@pytest.mark.parametrize("unit", METRES_PER_UNIT)
@pytest.mark.parametrize("missing", ["nan", "", "NaN", "inf"])
def test_columns_with_their_unit(tmp_path: Path, unit: str, missing: str) -> None:
    scale = 1e-3 / METRES_PER_UNIT[unit]
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


def test_a_recording_is_refused_with_how_its_profiles_are_read(tmp_path: Path) -> None:
    (tmp_path / "scan.mcap").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(ConfigurationError, match=r"is a recording.*tjscan reprocess") as refusal:
        read_profiles(tmp_path / "scan.mcap", ProfileFormat())
    assert str(tmp_path) in str(refusal.value)


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


@pytest.mark.parametrize(
    ("mark", "comma"),
    [
        *((mark, False) for mark in (";", "\t", ", ", " ; ", " ")),
        *((mark, True) for mark in (";", "\t", " ; ", " ")),
    ],
)
def test_separators_comments_and_decimal_commas_make_no_difference(
    tmp_path: Path, mark: str, comma: bool
) -> None:
    lines = ["# made by hand", f"x_mm{mark}z_mm"]
    for x, z in zip(X_MM.tolist(), Z_MM.tolist(), strict=True):
        cells = ["nan" if np.isnan(x) else repr(x), "nan" if np.isnan(z) else repr(z)]
        line = mark.join(cells)
        lines += [line.replace(".", ",") if comma else line, "", "  # between"]
    file = write(tmp_path, "\n".join(lines) + "\n", "profile.txt")
    (profile,) = read_profiles(file, ProfileFormat()).profiles.values()
    assert_expected(profile.x_s, profile.z_s)


MATRIX = ProfileFormat(unit="mm", pitch=2.0)
HEIGHTS = "200,201.5,,203.25,204"


@pytest.mark.parametrize("header", ["0,1,2,3,4", "1,2,3,4,5", "# a comment\n0,1,2,3,4"])
def test_a_line_of_column_numbers_is_no_profile(tmp_path: Path, header: str) -> None:
    table = read_profiles(write(tmp_path, f"{header}\n{HEIGHTS}\n{HEIGHTS}\n"), MATRIX)
    assert list(table.profiles) == ["row 1", "row 2"]
    for profile in table.profiles.values():
        assert_expected(profile.x_s, profile.z_s)


def test_a_column_of_row_numbers_is_no_height(tmp_path: Path) -> None:
    table = read_profiles(write(tmp_path, f",0,1,2,3,4\n0,{HEIGHTS}\n1,{HEIGHTS}\n"), MATRIX)
    assert list(table.profiles) == ["row 1", "row 2"]
    assert_expected(table.profiles["row 2"].x_s, table.profiles["row 2"].z_s)


def test_zero_is_no_point_among_distances(tmp_path: Path) -> None:
    table = read_profiles(write(tmp_path, "200,201.5,0,203.25,204\n"), MATRIX)
    assert_expected(table.profiles["row 1"].x_s, table.profiles["row 1"].z_s)
    assert table.notes == []


def test_zero_is_a_height_among_heights_of_either_sign(tmp_path: Path) -> None:
    file = write(tmp_path, "-2,-1,0,1,2\n")
    table = read_profiles(file, MATRIX)
    z = table.profiles["row 1"].z_s
    assert np.isfinite(z).all()
    assert (z > 0).all()
    np.testing.assert_allclose(np.diff(z), 1e-3)
    assert any("--invalid 0" in note for note in table.notes)
    assert any("--z-offset" in note for note in table.notes)
    stated = read_profiles(file, ProfileFormat(unit="mm", pitch=2.0, invalid=(0.0,)))
    assert np.isnan(stated.profiles["row 1"].z_s[2])


@pytest.mark.parametrize(
    ("form", "text"),
    [
        (ProfileFormat(unit="mm", pitch=2.0, z_offset=200.0), "0,1.5,nan,3.25,4"),
        (ProfileFormat(unit="mm", pitch=2.0, z_offset=240.0, z_scale=-1.0), "40,38.5,,36.75,36"),
        (ProfileFormat(unit="mm", pitch=2.0, z_scale=0.01), "20000,20150,0,20325,20400"),
        (ProfileFormat(unit="um", pitch=2000.0, z_offset=2e5), "0,1500,,3250,4000"),
    ],
)
def test_heights_have_a_sign_a_scale_and_an_offset(
    tmp_path: Path, form: ProfileFormat, text: str
) -> None:
    table = read_profiles(write(tmp_path, f"{text}\n"), form)
    assert_expected(table.profiles["row 1"].x_s, table.profiles["row 1"].z_s)
    assert not any("--z-offset" in note for note in table.notes)


def test_points_without_an_x_lie_a_pitch_apart(tmp_path: Path) -> None:
    text = "z_mm\n200\n201.5\nnan\n203.25\n204\n"
    table = read_profiles(write(tmp_path, text), ProfileFormat(unit="mm", pitch=2.0))
    (profile,) = table.profiles.values()
    assert_expected(profile.x_s, profile.z_s)


def test_arrays_are_read_like_tables(tmp_path: Path) -> None:
    file = tmp_path / "profiles.npy"
    np.save(file, np.array([Z_MM, Z_MM]))
    assert list(read_profiles(file, MATRIX).profiles) == ["row 1", "row 2"]
    for array in (Z_MM, np.array([Z_MM]), np.column_stack((X_MM, Z_MM))):
        np.save(file, array)
        (profile,) = read_profiles(file, MATRIX).profiles.values()
        assert_expected(profile.x_s, profile.z_s)
    np.save(file, np.stack([np.column_stack((X_MM, Z_MM))] * 3))
    assert len(read_profiles(file, MATRIX).profiles) == 3
    np.save(file, np.array(["a"]))
    with pytest.raises(ConfigurationError, match="no array of numbers"):
        read_profiles(file, MATRIX)
    np.save(file, np.array([{}]), allow_pickle=True)
    with pytest.raises(ConfigurationError, match="no array of numbers"):
        read_profiles(file, MATRIX)


def test_a_folder_holds_the_profiles_of_its_files(tmp_path: Path) -> None:
    write(tmp_path, f"{HEIGHTS}\n{HEIGHTS}\n", "b.csv")
    np.save(tmp_path / "a.npy", Z_MM)
    write(tmp_path, "no table", "broken.csv")
    write(tmp_path, "for the reader", "README")
    table = read_profiles(tmp_path, MATRIX)
    assert list(table.profiles) == ["a.npy", "b.csv row 1", "b.csv row 2"]
    assert [bad.split(":")[0] for bad in table.bad] == ["broken.csv"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigurationError, match="holds no profile"):
        read_profiles(tmp_path / "empty", MATRIX)


GOCATOR = """Info
CSV Version,Sensor Count
1.0,1

DeviceInfo
ID,Model
0,2350

{section}
Frame Count,Column Count,X Offset,Y Offset,Z Offset
2,5,0,0,0

Frame,Source,Time,Encoder,Z Encoder,Inputs,Exposure,Y,Axis,{header}
{rows}
End
"""


def test_a_gocators_even_profiles_are_read(tmp_path: Path) -> None:
    heights = ",".join("" if np.isnan(z) else repr(240 - z) for z in Z_MM.tolist())
    rows = [f"{k},0,1,2,3,0,100,0,{axis},{heights}" for k in (7, 8) for axis in "ZI"]
    text = GOCATOR.format(section="Profile", header="-4,-2,0,2,4", rows="\n".join(rows))
    table = read_profiles(write(tmp_path, text), ProfileFormat())
    assert list(table.profiles) == ["frame 7", "frame 8"]
    assert table.bad == []
    for profile in table.profiles.values():
        assert_expected(profile.x_s, profile.z_s)


def test_a_gocators_raw_profiles_are_read(tmp_path: Path) -> None:
    x = ",".join("" if np.isnan(v) else repr(v) for v in X_MM.tolist())
    heights = ",".join("" if np.isnan(z) else repr(240 - z) for z in Z_MM.tolist())
    rows = "\n".join(f"3,0,1,2,3,0,100,0,{axis},{row}" for axis, row in (("X", x), ("Z", heights)))
    text = GOCATOR.format(section="RawProfile", header="0,1,2,3,4", rows=rows)
    table = read_profiles(write(tmp_path, text), ProfileFormat())
    (profile,) = table.profiles.values()
    assert_expected(profile.x_s, profile.z_s)


def test_a_mistaken_scale_is_caught(tmp_path: Path) -> None:
    row = ",".join(str(2000 + 10 * i) for i in range(60))
    with pytest.raises(ConfigurationError, match="--z-scale"):
        read_profiles(write(tmp_path, f"{row}\n"), ProfileFormat(unit="mm", pitch=0.1))
    fine = ProfileFormat(unit="mm", pitch=0.1, z_scale=0.01)
    assert read_profiles(write(tmp_path, f"{row}\n"), fine).profiles


def test_turned_upside_down_twice_a_profile_is_itself(tmp_path: Path) -> None:
    (profile,) = read_profiles(write(tmp_path, f"{HEIGHTS}\n"), MATRIX).profiles.values()
    turned = flip_heights(profile)
    assert np.nanargmax(turned.z_s) == np.nanargmin(profile.z_s)
    np.testing.assert_allclose(flip_heights(turned).z_s, profile.z_s, atol=ROUNDING)


def test_two_columns_without_names_are_points(tmp_path: Path) -> None:
    points = np.column_stack((np.linspace(-30, 30, 50), np.linspace(220, 250, 50)))
    np.savetxt(tmp_path / "points.txt", points)
    table = read_profiles(tmp_path / "points.txt", ProfileFormat("mm"))
    (profile,) = table.profiles.values()
    np.testing.assert_allclose(1e3 * profile.points_s[:, [0, 2]], points)


@pytest.mark.parametrize("code", [-9999, 32767])
def test_a_number_that_must_mean_no_point_is_found_out(tmp_path: Path, code: int) -> None:
    heights = np.tile(np.linspace(220, 250, 50), (3, 1))
    heights[:, 10:15] = code
    np.savetxt(tmp_path / "rows.csv", heights, delimiter=",")
    with pytest.raises(ConfigurationError, match=f"--invalid {code}"):
        read_profiles(tmp_path / "rows.csv", ProfileFormat("mm", pitch=0.2))
    table = read_profiles(tmp_path / "rows.csv", ProfileFormat("mm", 0.2, (code,)))
    assert [len(profile.points_s) for profile in table.profiles.values()] == [45] * 3


NPY_HEAD = b"\x93NUMPY\x01\x00"


def npy(header: str) -> bytes:
    return NPY_HEAD + len(header).to_bytes(2, "little") + header.encode()


@pytest.mark.parametrize(
    "data",
    [
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }\n"),
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': ((((((, }\n"),
        npy("{'descr': '|O', 'fortran_order': False, 'shape': (3,), }\n") + b"cos\nsystem\n.",
        NPY_HEAD[:6] + b"\x02\x00\xff\xff\xff\xff" + b"{" * 900,
        b"PK\x03\x04" + bytes(60),
        b"\x80\x04\x95.",
    ],
)
def test_an_array_that_holds_less_than_its_header_says_or_other_things_is_refused(
    tmp_path: Path, data: bytes
) -> None:
    file = tmp_path / "heights.npy"
    file.write_bytes(data)
    with pytest.raises(ConfigurationError, match="is no array of numbers"):
        read_profiles(file, ProfileFormat("mm", 0.5))


@pytest.mark.parametrize("text", ["x_mm,z_mm\n1," + "3" * 200_000, "1 " * 600_000])
def test_a_field_or_a_line_of_great_length_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "profile.csv"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match="is no table of numbers"):
        read_profiles(file, ProfileFormat("mm", 0.5))


V_MM = np.column_stack((np.linspace(-30, 30, 121), 230 + 8 * np.abs(np.sin(np.arange(121) / 19))))
"""Points x, z of a profile."""


def written(values: Array, header: str = "") -> str:
    rows = [header] if header else []
    return "\n".join([*rows, *(",".join(f"{v:.9g}" for v in row) for row in values)]) + "\n"


@pytest.mark.parametrize("unit", METRES_PER_UNIT)
@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("x,z", (0, 1)),
        ("", (0, 1)),
        ("", (1, 0)),
        ("# z,x", (1, 0)),
        ("range,position", (1, 0)),
        ("# position, range", (0, 1)),
        ("y,x", (0, 1)),
    ],
)
def test_unit_and_axes_that_are_not_stated_are_assumed_and_said(
    tmp_path: Path, unit: str, header: str, columns: tuple[int, int]
) -> None:
    numbers = V_MM[:, columns] * 1e-3 / METRES_PER_UNIT[unit] + 1e-7
    table = read_profiles(write(tmp_path, written(numbers, header)), ProfileFormat())
    (profile,) = table.profiles.values()
    np.testing.assert_allclose(1e3 * profile.points_s[:, [0, 2]], V_MM, atol=1e-3)
    assert any(f"{unit} is assumed" in note for note in table.notes)


@pytest.mark.parametrize("scale", [6e-5, 0.05, 2.0, 50.3, 40_000.0])
def test_no_unit_is_assumed_that_would_be_wrong(tmp_path: Path, scale: float) -> None:
    """Widths between those of two units; whole numbers, which may count anything."""
    numbers = V_MM * scale
    numbers = np.round(numbers) if scale == 2.0 else numbers
    with pytest.raises(ConfigurationError, match=r"profiles\.csv.*--units"):
        read_profiles(write(tmp_path, written(numbers, "x,z")), ProfileFormat())


def test_two_columns_that_step_one_way_are_not_told_apart(tmp_path: Path) -> None:
    text = written(np.column_stack((V_MM[:, 0], 230 + 0.3 * V_MM[:, 0])), "left,right")
    with pytest.raises(ConfigurationError, match="x_mm and z_mm"):
        read_profiles(write(tmp_path, text), ProfileFormat())


@pytest.mark.parametrize("suffix", ["csv", "npy"])
def test_a_first_row_of_even_steps_is_where_the_columns_are(tmp_path: Path, suffix: str) -> None:
    rows = np.vstack((V_MM[:, 0], V_MM[:, 1], V_MM[::-1, 1]))
    file = tmp_path / f"rows.{suffix}"
    np.save(file, rows) if suffix == "npy" else file.write_text(written(rows))
    table = read_profiles(file, ProfileFormat())
    assert list(table.profiles) == ["row 2", "row 3"]
    np.testing.assert_allclose(1e3 * table.profiles["row 2"].points_s[:, [0, 2]], V_MM, atol=1e-6)
    heights = write(tmp_path, written(rows[1:]), "heights.csv")
    with pytest.raises(ConfigurationError, match="--pitch"):
        read_profiles(heights, ProfileFormat())


@pytest.mark.parametrize("suffix", ["ply", "npy", "csv"])
def test_profiles_one_behind_the_other_are_told_apart_by_y(tmp_path: Path, suffix: str) -> None:
    points = np.vstack([np.insert(V_MM, 1, y, axis=1) for y in (-2.5, 0.0, 7.0)])
    file = tmp_path / f"points.{suffix}"
    if suffix == "npy":
        np.save(file, points)
    elif suffix == "csv":
        file.write_text(written(points, "x,y,z"))
    else:
        trimesh.PointCloud(points).export(file)
    table = read_profiles(file, ProfileFormat())
    assert list(table.profiles) == ["y -2.5", "y 0", "y 7"]
    for profile in table.profiles.values():
        np.testing.assert_allclose(1e3 * profile.points_s[:, [0, 2]], V_MM, atol=1e-4)
    np.save(tmp_path / "cloud.npy", points + np.random.default_rng(0).normal(size=points.shape))
    with pytest.raises(ConfigurationError, match="planes of one y"):
        read_profiles(tmp_path / "cloud.npy", ProfileFormat())


def test_files_of_a_folder_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (10, 9, 1):
        write(tmp_path, f"{HEIGHTS}\n", f"scan_{number}.csv")
    names = [name.split()[0] for name in read_profiles(tmp_path, MATRIX).profiles]
    assert names == ["scan_1.csv", "scan_9.csv", "scan_10.csv"]
