"""Every calibration leaves a page and a picture: the numbers asked for, and what they rest on."""

import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from _targets import calibrate_on_plane
from calibration_stage import HAND, MM, NOISE, circle, raised, samples, shots, target
from command import blank_pictures, tjscan

from tjscan.calibration.file import (
    ArmKinematicsEntry,
    BallEntry,
    BasisEntry,
    CalibrationFile,
    UncertaintyAfterLinesEntry,
    read_calibration,
    rows_in_file_units,
    views_of_poses,
    write_calibration,
)
from tjscan.calibration.to_file import to_calibration_file
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import pose, rot_x, rot_y
from tjscan.core.manifest import files_altered_since_written
from tjscan.core.provenance import Provenance
from tjscan.report.write import write_run_report
from tjscan.runs.calibration.report import calibration_page

PROVENANCE = Provenance.for_file_written_now("calibrate.toml, SHA-256 0123456789abcdef", "f")


class Page(HTMLParser):
    """Words of a page, and its pictures."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.words = ""
        self.pictures: list[dict[str, str | None]] = []
        self.feed(page)
        self.words = " ".join(self.words.split())

    def handle_data(self, data: str) -> None:
        self.words += data

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "img":
            self.pictures.append(dict(attrs))


@pytest.fixture(scope="module")
def found() -> CalibrationFile:
    rng = np.random.default_rng(0)
    poses = circle(30)
    profiles = shots(poses, HAND, rng)
    profiles[4] = raised(profiles[4], 2 * MM)
    result = calibrate_on_plane(samples(poses, profiles), target(rng), NOISE)
    names = [residual.name for residual in result.residuals]
    basis = BasisEntry(
        target="board <touched>",
        poses_read_as=("poses.csv: KUKA A B C",),
        left_out=tuple(f"profile {k} is left out: no line seen" for k in range(20, 30)),
        caveats=result.caveats,
        views=views_of_poses(dict(zip(names, poses, strict=True)), result.T_f_s),
        shrinking=(
            UncertaintyAfterLinesEntry(lines=5, sigma_position_mm=0.3, sigma_rotation_deg=0.06),
            UncertaintyAfterLinesEntry(lines=12, sigma_position_mm=0.1, sigma_rotation_deg=0.02),
        ),
    )
    return to_calibration_file(
        result, NOISE, arm="ur10e 1", laser="2610-100 7", date=PROVENANCE.written, basis=basis
    )


@pytest.fixture
def keep(tmp_path: Path) -> Callable[[CalibrationFile], Path]:
    def keep(found: CalibrationFile) -> Path:
        write_calibration(tmp_path / "calibration.toml", found, PROVENANCE)
        return tmp_path

    return keep


def test_it_begins_with_the_pose_and_its_uncertainty_as_the_file_states_them(
    found: CalibrationFile, keep: Callable[[CalibrationFile], Path]
) -> None:
    with blank_pictures():
        page = Page(write_run_report(keep(found)).read_text(encoding="utf-8"))
    sigma = np.sqrt(np.diag(found.covariance))
    places = [page.words.index("Findings")]
    places.extend(
        page.words.index(f"{found.sensor_pose_rows[k][3]:.3f} ± {sigma[k]:.3f} mm")
        for k in range(3)
    )
    places.append(
        page.words.index(f"{found.sigma_position_mm:.3f} mm, {found.sigma_rotation_deg:.4f}°")
    )
    assert max(places[1:]) < places[0]
    for words in (
        "11 in use; left out: 1 as contradicting the others, 10 before that",
        "board <touched>; plane touched",
        f"{found.condition:.1f}; about 10",
        "KUKA A B C",
        "contradicting the others: line 5",
        "Profile 20 is left out: no line seen.",
        "6 more were left out",
    ):
        assert words in page.words
    assert len(page.pictures) == 3
    for picture in page.pictures:
        assert picture["alt"]
        assert str(picture["src"]).startswith("data:image/png")


def test_the_picture_stands_beside_it_and_both_are_in_the_list(
    found: CalibrationFile, tmp_path: Path
) -> None:
    with write_files_atomically(tmp_path, listed=True) as draft:
        (draft / "calibration.toml").touch()
    write_calibration(tmp_path / "calibration.toml", found, PROVENANCE)
    with blank_pictures():
        assert tjscan("report", tmp_path) == 0
    files = [tmp_path / name for name in ("calibration.png", "report.html", "calibration.toml")]
    assert files[0].read_bytes().startswith(b"\x89PNG")
    assert files_altered_since_written(*files) == []
    files[0].write_bytes(b"another")
    assert files_altered_since_written(*files) == files[:1]


def test_bars_are_the_residuals_with_what_is_stated(
    found: CalibrationFile, keep: Callable[[CalibrationFile], Path]
) -> None:
    charts = [chart for chart in calibration_page(keep(found)).charts if chart.mark == "bar"]
    used, left = charts
    assert used.nominal == 1
    np.testing.assert_array_equal(left.x, [5])
    np.testing.assert_array_equal(left.y, [found.residuals[4].misfit])
    assert len(used.x) == 11


def test_a_ball_and_an_arm_are_shown_with_what_was_stated(
    found: CalibrationFile, keep: Callable[[CalibrationFile], Path]
) -> None:
    arm = ArmKinematicsEntry(
        model="ur10e",
        deviations=(6 * (0.0,),) * 6,
        covariance=rows_in_file_units(np.eye(42), axes=2),
        left_as_stated=(
            "joint 1: length x not separable from where the ball is: left as the maker states",
        ),
        held_out_poses=12,
        held_out_before_mm=0.4,
        held_out_after_mm=0.1,
    )
    ball = BallEntry(stated_radius_mm=40.0, measured_radius_mm=39.974, sigma_radius_mm=0.054)
    more = found.model_copy(update={"kinematics": arm, "ball": ball})
    chapter = calibration_page(keep(more))
    assert "0.400 → 0.100 mm RMS" in [one.value for one in chapter.headline]
    facts = dict(chapter.facts)
    assert facts["radius of the ball"] == "measured 39.974 ± 0.054 mm, stated 40.000 mm"
    assert "joint 1: length x not separable from where the ball is" in facts["arm"]


def test_a_file_of_an_earlier_version_shows_what_it_holds(
    found: CalibrationFile, keep: Callable[[CalibrationFile], Path]
) -> None:
    directory = keep(found.model_copy(update={"basis": None}))
    assert read_calibration(directory / "calibration.toml").basis is None
    assert {chart.mark for chart in calibration_page(directory).charts} == {"bar"}


def test_an_unfinished_one_is_told_apart_from_a_scan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "measured.mcap").touch()
    assert tjscan("report", tmp_path) == 2
    assert f"tjscan calibrate --resume {tmp_path}" in " ".join(capsys.readouterr().err.split())


def test_a_job_that_only_took_a_calibration_gets_no_page_of_it(
    found: CalibrationFile, keep: Callable[[CalibrationFile], Path]
) -> None:
    directory = keep(found)
    shutil.copy(directory / "calibration.toml", directory / "job.toml")
    assert tjscan("report", directory) == 2
    assert not (directory / "report.html").exists()


@pytest.mark.parametrize("up", [False, True])
def test_tilts_count_from_the_vertical_whichever_way_z_points(up: bool) -> None:
    down = pose(rot_x(0 if up else np.pi))
    tilted = pose(rot_y(np.radians(20)) @ down[:3, :3])
    first, second = views_of_poses({"a": down, "b": tilted}, np.eye(4))
    assert first.tilt_deg == pytest.approx(0, abs=1e-9)
    assert second.tilt_deg == pytest.approx(20)
    assert abs(second.azimuth_deg) == pytest.approx(0 if up else 180, abs=1e-9)
    (fixed,) = views_of_poses({"a": tilted}, np.eye(4), sensor_is_fixed=True)
    assert fixed.tilt_deg == pytest.approx(20)
