"""``tjscan groove`` on the files that people have."""

import json
from pathlib import Path

import numpy as np
import pytest
from command import tjscan
from grooves import MM, Groove, Noise, draw, seen

from tjscan.groove.settings import GrooveSettings
from tjscan.result.readings import fitted_side_polylines

NOISE = Noise(sigma=0.03 * MM)


def heights(folder: Path, *, sign: int, header: bool = True) -> Path:
    """Three profiles, heights in hundredths of a millimetre from mid-range, 0.1 mm apart."""
    x = np.arange(-450, 451) * 0.1 * MM
    rows = [",".join(str(i) for i in range(len(x)))] if header else []
    for seed in range(3):
        shot = draw(Groove(), NOISE, seed)
        order = np.argsort(shot.x_s)
        good = order[np.isfinite(shot.x_s[order])]
        z = np.interp(x, shot.x_s[good], shot.z_s[good])
        rows.append(",".join(f"{v:.0f}" for v in sign * 1e5 * (z - 0.24)))
    file = folder / "heights.csv"
    file.write_text("# from the shop\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return file


OPTIONS = ("--units", "mm", "--pitch", "0.1")


def test_heights_about_mid_range_are_read_and_said_to_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = heights(tmp_path, sign=1)
    assert tjscan("groove", file, *OPTIONS, "--z-scale", "0.01") == 0
    printed = capsys.readouterr()
    assert [line[:7].strip() for line in printed.out.splitlines()] == [
        "profile",
        "row 1",
        "row 2",
        "row 3",
    ]
    assert "--z-offset" in printed.err
    assert tjscan("groove", file, *OPTIONS, "--z-scale", "0.01", "--z-offset", "240") == 0
    assert "--z-offset" not in capsys.readouterr().err


def test_heights_of_the_wrong_sign_are_found_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = heights(tmp_path, sign=-1)
    assert tjscan("groove", file, *OPTIONS, "--z-scale", "0.01") == 1
    assert "--z-scale the other sign" in capsys.readouterr().err
    assert tjscan("groove", file, *OPTIONS, "--z-scale", "-0.01") == 0


def test_a_scale_of_the_wrong_size_is_found_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("groove", heights(tmp_path, sign=1), *OPTIONS) == 2
    assert "--z-scale" in capsys.readouterr().err


def test_a_folder_is_read_file_by_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    heights(tmp_path, sign=1)
    assert tjscan("groove", tmp_path, *OPTIONS, "--z-scale", "0.01") == 0
    assert "heights.csv row 2" in capsys.readouterr().out


def test_a_picture_shows_the_fitted_sides_on_their_points() -> None:
    seen = draw(Groove(), NOISE, 1)
    sides = fitted_side_polylines(seen, GrooveSettings())
    assert len(sides) == 4
    points = seen.points_s[:, [0, 2]]
    for side in sides:
        # Every drawn point has a measured one near: columns are at most half a millimetre apart.
        off = np.linalg.norm(side[:, None] - points, axis=2).min(axis=1)
        assert np.median(off) < 0.5 * MM


def test_the_corners_of_a_butt_joint_have_standard_deviations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = np.array([(-30, 230), (-8, 230), (-1, 242), (1, 242), (8, 230), (30, 230)]) * MM
    profile = seen([points], NOISE)
    file = tmp_path / "profile.csv"
    rows = 1e3 * np.column_stack((profile.x_s, profile.z_s))
    np.savetxt(file, rows, delimiter=",", header="x_mm,z_mm", comments="")
    assert tjscan("groove", file, "--model", "butt-v", "--json") == 0
    (reading,) = json.loads(capsys.readouterr().out)["readings"]
    assert reading["model"] == "butt-v"
    off = np.array(reading["points_mm"]).ravel() - 1e3 * points[4:0:-1].ravel()
    sigmas = np.array(reading["corner_sigma_mm"])
    assert (np.abs(off) < 4 * sigmas).all()
    assert (sigmas < 0.3).all()
    assert tjscan("groove", file, "--model", "butt-v") == 0
    assert capsys.readouterr().out.count("±") == 4
