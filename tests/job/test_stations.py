"""What a job with stations means: places, frames, and what only a simulated world knows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import CLOCKWISE, EXAMPLES, FAULTLESS, PAPER, Notes
from command import tjscan
from station_jobs import WHOLE, data_of, moved, paper_at_a_station, pose_of, written

from tjscan.cli.options.shared import parse_overrides
from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core import config
from tjscan.core.config import read_toml
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose_from_euler_zyx,
    rotation_angle_between,
    transform_points,
)
from tjscan.job.cell import clear_path_planner_of_job
from tjscan.job.files import ScanJob, read_calibration_job, read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.runs.scan.run import ScanContext, result_frame_of_job, scan_in_cell
from tjscan.scanning.journal import ScanResult, plan_is_fulfilled

SAME = 1e-12
"""Metres: nothing is computed otherwise."""

ROUNDED = 2e-6
"""Metres: rays are cast in single precision, so a base told otherwise moves them that much."""

ELSEWHERE = pose_from_euler_zyx((4.0, -2.5, 0.7), (2.1, 0.3, -0.2))


def scan(file: Path, overrides: dict[str, Any], station: str | None = None) -> ScanResult:
    job = read_scan_job(file, overrides).job_at_station(station)
    return scan_in_cell(ScanContext(job, file).make_cell(), job, Notes())


def corners(result: ScanResult) -> Array:
    return np.array([section.points_b for section in result.sections])


def test_a_station_at_the_origin_of_w_scans_what_a_job_without_stations_scans(
    tmp_path: Path,
) -> None:
    short = {"scan.sections": 5}
    file = written(tmp_path, paper_at_a_station(np.eye(4)))
    np.testing.assert_allclose(corners(scan(file, short)), corners(scan(PAPER, short)), atol=SAME)


def test_what_is_measured_in_b_does_not_depend_on_where_w_is(tmp_path: Path) -> None:
    short = {**FAULTLESS, "scan.sections": 5}
    here = corners(scan(WHOLE, short, "right"))
    file = written(tmp_path, moved(data_of(WHOLE), ELSEWHERE))
    np.testing.assert_allclose(corners(scan(file, short, "right")), here, atol=ROUNDED)


def test_solids_about_the_workpiece_stand_where_the_base_is_believed_to_be(
    tmp_path: Path,
) -> None:
    job = read_scan_job(WHOLE).job_at_station("left")
    data = data_of(WHOLE)
    T_b_w = inverse_pose(pose_of(data["station"][0]))
    for solid in data["clearance"]["solid"]:
        if solid.pop("frame", "b") == "w":
            solid |= {**solid, **_table(T_b_w @ pose_of(solid))}
    in_b = read_scan_job(written(tmp_path, data)).job_at_station("left")
    for q in np.random.default_rng(3).uniform(-2.0, 2.0, (5, 6)):
        told, same = (clear_path_planner_of_job(one).nearest_bodies(q) for one in (job, in_b))
        assert told is not None
        assert same is not None
        assert told[0] == same[0]
        assert told[1] == pytest.approx(same[1], abs=1e-6)


def _table(T: Array) -> dict[str, Any]:
    from station_jobs import table_of

    return table_of(T)


def test_the_laser_sees_from_where_the_base_truly_stands() -> None:
    result = scan(WHOLE, {"scan.sections": 5}, "left")
    job = read_scan_job(WHOLE).job_at_station("left")
    joint = ScanContext(job, WHOLE).joint
    assert job.joint is not None
    assert joint is not None
    edges = feature_edges(joint)
    T_j_w = inverse_pose(job.joint.T_w_j)
    truly, believed = (
        corner_to_edge_distances(transform_points(T_j_w @ T_w_b, corners(result)), edges).mean()
        for T_w_b in (job.T_w_b_true, job.T_w_b)
    )
    assert truly < 0.1e-3
    assert believed > 1e-3


def test_results_of_a_station_are_told_in_b(tmp_path: Path) -> None:
    assert result_frame_of_job(read_scan_job(PAPER)).letter == "j"
    assert result_frame_of_job(read_scan_job(WHOLE)).letter == "b"


class TestWholeJoint:
    """The example with both its stations."""

    def test_its_bases_are_wrong_by_millimetres_and_a_degree_or_two(self) -> None:
        for job in read_scan_job(WHOLE).jobs_at_stations:
            off = inverse_pose(job.T_w_b) @ job.T_w_b_true
            assert 5e-3 < np.linalg.norm(off[:3, 3]) < 10e-3
            assert np.radians(1) < rotation_angle_between(np.eye(4), off) < np.radians(2)

    def test_it_goes_all_round_and_overlaps_at_both_crowns(self) -> None:
        seen = []
        for job in read_scan_job(WHOLE).jobs_at_stations:
            assert job.joint is not None
            result = scan(WHOLE, {}, job.station[0].name)
            assert plan_is_fulfilled(result.stop, job.scan), result.detail
            T_j_b = inverse_pose(job.joint.T_w_j) @ job.T_w_b_true
            origins = transform_points(T_j_b, [section.T_b_g[:3, 3] for section in result.sections])
            azimuth = np.degrees(np.unwrap(np.arctan2(origins[:, 1], origins[:, 0])))
            seen.append((azimuth[0] % 360, azimuth[-1] - azimuth[0]))
        (first, long), (second, longer) = sorted(seen, key=lambda arc: arc[0], reverse=True)
        # From 340° over the crown at 360° to beyond the crown at 180°, and on from before it.
        assert first + long > second + 360 + 20
        assert second + longer > first + 20
        assert second < 180 - 10
        assert first < 360 - 10


@pytest.mark.parametrize("key", ["station.right.length_mm", "station.1.length_mm"])
def test_keys_of_a_station_are_replaced_by_its_name_or_number(key: str) -> None:
    job = read_scan_job(WHOLE, {key: 500.0})
    assert job.job_at_station("right").scan.length == 0.5
    assert job.job_at_station("left").scan.length == 0.87


def test_a_station_called_with_a_dash_is_named_by_an_option(tmp_path: Path) -> None:
    file = written(tmp_path, paper_at_a_station(np.eye(4), "Left-1"))
    overrides = parse_overrides(["--station.left-1.position-mm", "[1, 2, 3]"])
    assert read_scan_job(file, overrides).station[0].position == (1e-3, 2e-3, 3e-3)


def test_what_a_station_says_for_itself_comes_before_what_all_do() -> None:
    job = read_scan_job(
        WHOLE, {"station.right.direction": "clockwise", "station.right.sections": 7}
    )
    left, right = job.jobs_at_stations
    assert (left.scan.direction, left.scan.sections) == ("counterclockwise", None)
    assert (right.scan.direction, right.scan.sections) == ("clockwise", 7)
    assert right.station_names == ("right",)
    assert right.job_at_station("right") == right.job_at_station() == right


def test_a_simulated_world_draws_other_numbers_at_each_station() -> None:
    left, right = (job.simulation for job in read_scan_job(WHOLE).jobs_at_stations)
    assert left is not None
    assert right is not None
    assert left.seed != right.seed
    assert left.arm != right.arm


def test_a_job_at_no_station_is_refused_with_their_names() -> None:
    with pytest.raises(ConfigurationError, match="left, right"):
        read_scan_job(WHOLE).start_poses  # noqa: B018
    with pytest.raises(ConfigurationError, match="did you mean: left"):
        read_scan_job(WHOLE).job_at_station("lefft")
    with pytest.raises(ConfigurationError, match="it has none"):
        read_scan_job(PAPER).job_at_station("left")


def _doubled(data: dict[str, Any]) -> None:
    data["station"][1]["name"] = "LEFT"


def _path(data: dict[str, Any]) -> None:
    data["station"][1]["name"] = "../right"


def _unknown(data: dict[str, Any]) -> None:
    data["simulation"]["station"][1]["name"] = "rihgt"


def _both(data: dict[str, Any]) -> None:
    data["scan"]["first"] = data["station"][0]["first"]


def _neither(data: dict[str, Any]) -> None:
    del data["station"], data["simulation"]["station"]


def _poseless(data: dict[str, Any]) -> None:
    del data["station"][1]["second"]


def _framed_tool(data: dict[str, Any]) -> None:
    data["clearance"]["tool"][0]["frame"] = "w"


@pytest.mark.parametrize(
    ("spoil", "key", "hint"),
    [
        (_doubled, "station.1.name", "two stations are called 'LEFT'"),
        (_path, "station.1.name", "pattern"),
        (_unknown, "simulation.station.1.name", "did you mean: right?"),
        (_both, "scan.first", "move it to [station.first]"),
        (_neither, "scan.first", "[[station]]"),
        (_poseless, "station.1.second", "required"),
        (_framed_tool, "clearance.tool.0.frame", "unknown key"),
    ],
)
def test_what_is_wrong_with_stations_is_named_with_its_key_and_file(
    tmp_path: Path, spoil: Any, key: str, hint: str
) -> None:
    data = data_of(WHOLE)
    spoil(data)
    file = written(tmp_path, data)
    with pytest.raises(ConfigurationError) as caught:
        read_scan_job(file)
    assert (caught.value.file, caught.value.key) == (file, key)
    assert hint in str(caught.value)


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("station.middle.length_mm", "there are: left, right"),
        ("station.2.length_mm", "there are: left, right"),
        ("station.length_mm", "station.NAME.length_mm"),
    ],
)
def test_an_option_for_a_station_that_is_none_is_refused(key: str, hint: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        read_scan_job(WHOLE, {key: 500.0})
    assert (caught.value.file, caught.value.key) == (WHOLE, key)
    assert hint in str(caught.value)


@pytest.mark.parametrize("file", [WHOLE, CLOCKWISE, EXAMPLES / "ur10e.toml"])
def test_a_job_at_a_station_survives_being_written(file: Path, tmp_path: Path) -> None:
    import tomli_w

    for job in read_scan_job(file).jobs_at_stations:
        copy = tmp_path / "copy.toml"
        text = tomli_w.dumps(config.table_to_dict(job))
        copy.write_text(text, encoding="utf-8")
        again = read_scan_job(copy)
        assert isinstance(again, ScanJob)
        assert again == job == again.job_at_station()


def test_a_real_arm_stands_at_one_station() -> None:
    real = {"arm.driver": "ur", "arm.ur.host": "127.0.0.9"}
    with pytest.raises(ConfigurationError, match="--station"):
        read_scan_job(WHOLE, real).jobs_at_stations  # noqa: B018
    assert len(read_scan_job(WHOLE, real).job_at_station("left").jobs_at_stations) == 1


def test_the_doctor_looks_at_every_station(capsys: pytest.CaptureFixture[str]) -> None:
    assert tjscan("doctor", WHOLE) == 0
    told = capsys.readouterr().out
    assert "left: second pose" in told
    assert "right: second pose" in told
    assert tjscan("doctor", WHOLE, "--station", "right") == 0
    assert "left" not in capsys.readouterr().out
    assert tjscan("doctor", WHOLE, "--station", "up") == 2


def test_a_calibration_is_made_at_one_station(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = data_of(WHOLE)
    data["board"] = read_toml(EXAMPLES / "calibrate.toml")["board"]
    file, out = written(tmp_path, data), tmp_path / "out"
    assert tjscan("calibrate", file, "--unattended", "--out", out) == 2
    assert "choose one with --station: left, right" in " ".join(capsys.readouterr().err.split())
    assert not out.exists()
    job = read_calibration_job(file).job_at_station("right")
    assert job.station_names == ("right",)
    np.testing.assert_allclose(
        job.T_w_b, read_scan_job(WHOLE).job_at_station("right").T_w_b, atol=SAME
    )


def test_the_arm_and_the_laser_are_the_same_ones_at_every_station() -> None:
    job = read_scan_job(WHOLE, {"simulation.arm.errors.offset_deg": 0.01})
    seeds = set()
    for one in job.jobs_at_stations:
        world = one.simulation
        assert world is not None
        assert world.arm is not None
        assert world.arm.errors is not None
        assert (world.arm.errors.seed, world.laser.linearity_seed) == (1, 1)
        seeds.add(world.seed)
    assert len(seeds) == 2
