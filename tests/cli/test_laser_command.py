"""``tjscan laser``: what it shows, what it writes, and what it needs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cells import PAPER
from command import tjscan
from laser_cell import loopback_laser, require_broadcasts, write_groove_profiles

from tjscan.cli.output.results import draw_profile
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.laser.profile import Profile
from tjscan.result.readings import ProfileReading
from tjscan_loopback.process import LaserLoopbackProcess

pytest.importorskip("viva_genicam")
require_broadcasts()

HALF_COUNT_MM = 0.0026


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_groove_profiles(tmp_path_factory.mktemp("profiles") / "groove.csv")


@pytest.fixture(scope="module")
def loopback(recording: Path) -> Iterator[LaserLoopbackProcess]:
    with loopback_laser(recording) as laser:
        yield laser


@pytest.fixture
def job(loopback: LaserLoopbackProcess, tmp_path: Path) -> Path:
    """No more than a laser, and the form of its groove."""
    file = tmp_path / "laser.toml"
    file.write_text(
        f'[laser]\ndriver = "genicam"\n[laser.genicam]\naddress = "{loopback.host}"\n'
        '[groove]\nmodel = "butt-v-sharp"\n',
        encoding="utf-8",
    )
    return file


def test_profiles_are_shown_with_what_is_read_and_written_as_they_came(
    job: Path, recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = tmp_path / "seen.csv"
    assert tjscan("laser", job, "--profiles", 4, "--write", written, "--json") == 0
    shown = capsys.readouterr()
    rows = [json.loads(line) for line in shown.out.splitlines()]
    assert [row["found"] for row in rows] == [True] * 4
    assert all(row["time_uncertainty_s"] > 0 for row in rows)
    assert "serial number 1" in shown.err
    assert "Coord3D_AC16, 640 points" in " ".join(shown.err.split())
    sent = list(read_profiles(recording, ProfileFormat()).profiles.values())
    seen = list(read_profiles(written, ProfileFormat()).profiles.values())
    assert len(seen) == 4
    for one, other in zip(sent, seen, strict=False):
        np.testing.assert_allclose(1e3 * other.z_s, 1e3 * one.z_s, atol=HALF_COUNT_MM)
    assert tjscan("laser", job, "--profiles", 1, "--write", written) == 2
    assert "exists" in capsys.readouterr().err


def test_without_a_terminal_each_profile_is_one_line(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("laser", job, "--profiles", 2) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["profile 1", "profile 2"]


def test_a_laser_that_fails_ends_it_with_the_code_of_devices(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("laser", job, "--laser.genicam.address", "127.0.0.98") == 4
    assert "no laser at 127.0.0.98" in capsys.readouterr().err


def test_a_recording_is_no_laser_to_look_through(capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--laser.driver", "replay", "--laser.recording", "runs/x")
    assert tjscan("laser", PAPER, *options) == 2
    assert "tjscan groove" in capsys.readouterr().err


def test_a_drawing_puts_the_sensor_above_and_marks_the_corners() -> None:
    x = np.linspace(-0.01, 0.01, 101)
    profile = Profile(x, 0.2 + np.abs(x))
    corners = np.array([[-0.01, 0, 0.21], [0.0, 0, 0.2], [0.01, 0, 0.21]])
    lines = draw_profile(ProfileReading("a", profile, corners), 41, 11)
    assert lines[0].strip() == "·2·"
    assert lines[10][0] == "1"
    assert lines[10][40] == "3"
    assert "z 200.0 (top) to 210.0 mm" in lines[11]
    nothing = Profile(np.full(5, np.nan), np.full(5, np.nan))
    assert draw_profile(ProfileReading("b", nothing, np.empty((0, 3))), 41, 11) == [
        "no point in range"
    ]
