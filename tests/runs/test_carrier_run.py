"""A carrier goes from station to station by itself: laws of the run."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import Notes
from command import tjscan
from station_jobs import WHOLE, data_of, table_of, written

from tjscan.api import scan
from tjscan.calibration.wizard.operator import Question
from tjscan.carrier.simulated import SimulatedCarrier
from tjscan.core.config import read_toml
from tjscan.core.errors import CarrierFault, ConfigurationError, ScanInterrupted
from tjscan.core.frames import Array, inverse_pose, transform_points, unit_vector
from tjscan.job.carrier import CarrierSweep
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import Journal
from tjscan.result.summary import read_stitching_report
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.scan.run import ScanContext, run_scan
from tjscan.runs.stations.carriage import Carriage
from tjscan.runs.stations.run import StationScan, resume_stations, run_stations
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.stopping import StopRequest

HOME = [36.0, 195.0, 25.0, -45.0, -99.0, 34.0]


def turn_table(stop: float = -62.0, overlap: float = 120.0, **keys: Any) -> dict[str, Any]:
    """The example of two stations, the joint on a turn-table before the left one's arm."""
    data = data_of(WHOLE)
    left, right = data["station"]
    left = {key: left[key] for key in ("name", "first", "second")}
    truly = data["simulation"].pop("station")[0]
    where = {key: truly[key] for key in ("position_mm", "euler_zyx_deg")}
    axis = {
        "name": "turn",
        "kind": "rotary",
        "direction": [0.0, 0.0, 1.0],
        "point_mm": [0.0, 0.0, 0.0],
        "limits_deg": [-190.0, 190.0],
    }
    data["carrier"] = {
        "driver": "simulated",
        "carries": "joint",
        **where,
        "sigma_mm": 0.0,
        "sigma_deg": 0.0,
        "home_deg": HOME,
        "axis": [axis],
    } | keys
    over = {"name": right["name"], "carrier": [stop], "overlap_mm": overlap}
    data["station"] = [left | {"carrier": [0.0]}, over]
    return data


def job_of(folder: Path, data: dict[str, Any], **keys: Any) -> ScanContext:
    """What a file with these tables asks for, with keys replaced."""
    file = written(folder, data)
    return ScanContext(read_scan_job(file, keys), file)


class Refusing:
    """No person is asked."""

    def confirm(self, question: Question) -> bool:
        raise AssertionError(question.text)


@contextmanager
def unwatched(name: str, plan: ScanPlan) -> Iterator[Journal]:
    yield Notes()


def again(directory: Path) -> ScanContext:
    """The run of a directory, to go on with."""
    file = directory / "job.toml"
    return ScanContext(read_scan_job(file), file)


ALIKE = 2e-5
"""Metres: both draw the same noise."""

QUICK = {"scan.length_mm": 400.0, "station.right.length_mm": 150.0}
"""Enough for start poses of the next station."""


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[StationScan, ...]]:
    """Both stations, a part of the groove from each."""
    folder = tmp_path_factory.mktemp("carried")
    context = job_of(folder, turn_table(), **QUICK)
    return folder / "run", run_stations(context, folder / "run", Refusing(), unwatched)


def test_the_carrier_moves_and_every_station_is_scanned(
    quick: tuple[Path, tuple[StationScan, ...]],
) -> None:
    _, scans = quick
    assert [scan.name for scan in scans] == ["left", "right"]
    assert all(scan.is_complete for scan in scans)


def test_the_recording_says_where_the_carrier_was(
    quick: tuple[Path, tuple[StationScan, ...]],
) -> None:
    directory, _ = quick
    for name, where in (("left", "turn 0 deg"), ("right", "turn -62 deg")):
        events = read_recorded_scan(directory / name).events
        assert [e.detail for e in events if e.name == "carrier"] == [f"at {where}"]


def test_later_stations_start_where_the_one_before_saw_the_groove(
    quick: tuple[Path, tuple[StationScan, ...]],
) -> None:
    directory, _ = quick
    left, right = (read_scan_job(directory / name / "job.toml") for name in ("left", "right"))
    T = inverse_pose(left.T_w_b) @ right.T_w_b
    sections = read_recorded_scan(directory / "left").sections.values()
    poses = [section.view.T_b_f for section in sections]
    off = [np.abs(T @ right.start_poses[0].T - pose).max() for pose in poses]
    i = int(np.argmin(off))
    assert off[i] < 1e-5
    np.testing.assert_allclose(T @ right.start_poses[1].T, poses[i + 1], atol=1e-5)
    way = np.diff([pose[:3, 3] for pose in poses[i:]], axis=0)
    assert 0.06 < np.linalg.norm(way, axis=1).sum() < 0.4  # the flange goes round farther out


def test_a_run_cut_off_in_a_move_of_the_carrier_goes_on(
    quick: tuple[Path, tuple[StationScan, ...]], tmp_path: Path
) -> None:
    run = Path(shutil.copytree(quick[0], tmp_path / "run"))
    shutil.rmtree(run / "right")
    before = (run / "left" / "scan.mcap").read_bytes()
    scans = resume_stations(again(run), {}, Refusing(), unwatched)
    assert all(scan.is_complete for scan in scans)
    assert (run / "left" / "scan.mcap").read_bytes() == before


@pytest.mark.parametrize(
    "ask", [StopRequest.request_stop_now, StopRequest.request_stop_after_section]
)
def test_a_stop_amid_a_move_lets_no_other_begin_and_the_run_goes_on_later(
    ask: Callable[[StopRequest], None],
    quick: tuple[Path, tuple[StationScan, ...]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Path(shutil.copytree(quick[0], tmp_path / "run"))
    shutil.rmtree(run / "right")
    context, begun, move = again(run), list[Array](), SimulatedCarrier.move_to

    def asked_on_the_way(self: SimulatedCarrier, values: Array) -> Array:
        ask(context.stop)  # Ctrl-C, twice or once, while it moves
        begun.append(values)
        return move(self, values)

    monkeypatch.setattr(SimulatedCarrier, "move_to", asked_on_the_way)
    with pytest.raises(ScanInterrupted):
        resume_stations(context, {}, Refusing(), unwatched)
    assert len(begun) == 1
    assert not (run / "right").exists()
    monkeypatch.undo()
    assert all(s.is_complete for s in resume_stations(again(run), {}, Refusing(), unwatched))


def test_an_axis_the_wrong_way_round_is_named_before_the_first_large_move(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    data = turn_table(simulated={"reversed": ["turn"]})
    file = written(tmp_path, data)
    assert tjscan("scan", file, "--out", out, "--scan.length-mm", "400") == 4
    told = " ".join(capsys.readouterr().err.split())
    assert "axis 'turn' of the carrier: its direction is reversed" in told
    assert "direction = [0.0, 0.0, -1.0]" in told
    assert not (out / "right").exists()


def test_the_first_move_is_looked_at_whichever_station_it_leads_to(
    quick: tuple[Path, tuple[StationScan, ...]], tmp_path: Path
) -> None:
    run = Path(shutil.copytree(quick[0], tmp_path / "run"))
    shutil.rmtree(run / "right")
    data = read_toml(run / "job.toml")
    data["carrier"]["simulated"] = {"reversed": ["turn"]}
    mid = data["station"][1] | {"name": "mid", "carrier": [0.0], "length_mm": 60.0}
    data["station"].insert(1, mid)
    written(run, data)
    with pytest.raises(CarrierFault, match="'turn' of the carrier: its direction is reversed"):
        resume_stations(again(run), {}, Refusing(), unwatched)
    assert (run / "mid" / "summary.json").is_file()
    assert not (run / "right").exists()


@pytest.mark.parametrize(("name", "at_deg"), [("left", 5.0), ("right", 0.0)])
def test_a_carrier_moves_nowhere_while_nothing_was_scanned(
    name: str,
    at_deg: float,
    quick: tuple[Path, tuple[StationScan, ...]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Path(shutil.copytree(quick[0], tmp_path / "run"))
    data = read_toml(run / "job.toml")
    taught = read_toml(run / "right" / "job.toml")["station"][0]
    data["station"][1] |= {key: taught[key] for key in ("first", "second")}
    for one in ("left", "right"):
        shutil.rmtree(run / one)
    written(run, data)
    monkeypatch.setattr(SimulatedCarrier, "state", lambda self: np.radians([at_deg]))
    monkeypatch.delattr(SimulatedCarrier, "move_to")
    with pytest.raises(CarrierFault, match=f"turn {at_deg:g} deg, and station {name} is at .*: br"):
        resume_stations(again(run), {}, Refusing(), unwatched, name)


def test_an_axis_nearly_along_the_groove_is_not_accused(tmp_path: Path) -> None:
    data = turn_table(20.0)
    axis = {"name": "x", "kind": "linear", "limits_mm": [-50.0, 50.0]}
    axis["direction"] = [-0.21, -0.97, -0.12]
    data["carrier"] |= {"carries": "arm", "axis": [axis]}
    lengths = {"scan.length_mm": 40.0, "station.right.length_mm": 50.0}
    context = job_of(tmp_path, data, **lengths)
    scans = run_stations(context, tmp_path / "run", Refusing(), unwatched)
    assert all(scan.is_complete for scan in scans)


def test_a_groove_that_is_not_seen_accuses_no_axis(
    quick: tuple[Path, tuple[StationScan, ...]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Path(shutil.copytree(quick[0], tmp_path / "run"))
    shutil.rmtree(run / "right")
    monkeypatch.setattr(Carriage, "_look", lambda *given: np.inf)
    with pytest.raises(CarrierFault, match=r"the groove was not seen after .* deg of it") as caught:
        resume_stations(again(run), {}, Refusing(), unwatched)
    assert "reversed" not in str(caught.value)


@pytest.mark.parametrize(
    ("spoil", "key", "why"),
    [
        (lambda d: d["carrier"].pop("home_deg"), "carrier.home_deg", "required"),
        (lambda d: d["station"][1].pop("carrier"), "station.1", "position_mm"),
        (lambda d: d["station"][1].update(carrier=[200.0]), "station.1.carrier", "axis turn"),
        (lambda d: d["station"][1].update(carrier=[0.0, 1.0]), "station.1.carrier", "2 values"),
        (lambda d: d.pop("carrier"), "station.0.carrier", r"no \[carrier\] table"),
        (lambda d: d["station"][0].pop("first"), "station.0.first", "required"),
        (lambda d: d["carrier"]["axis"][0].pop("limits_deg"), "carrier.axis.0", "limits_deg"),
        (lambda d: d["carrier"].update(driver="acme"), "carrier.driver", "no carrier 'acme'"),
        (
            lambda d: d["carrier"].update(simulated={"reversed": ["trun"]}),
            "carrier",
            "simulated.reversed: no axis is called 'trun'",
        ),
    ],
)
def test_what_is_wrong_with_a_carrier_is_named(
    tmp_path: Path, spoil: Any, key: str, why: str
) -> None:
    data = turn_table()
    spoil(data)
    with pytest.raises(ConfigurationError, match=why) as caught:
        read_scan_job(written(tmp_path, data))
    assert str(caught.value.key).startswith(key)


def test_a_way_on_which_the_arm_would_touch_is_not_gone(tmp_path: Path) -> None:
    data, arm = turn_table(), Kinematics.load("ur10e")
    start, goal = np.zeros(1), np.array([np.pi])
    job = job_of(tmp_path, data).job.job_at_station("left")
    CarrierSweep(job, arm, np.radians(HOME)).check_line(start, goal)
    post = {"name": "post", "frame": "w", "kind": "box", "size_mm": [300.0, 300.0, 2000.0]}
    data["clearance"]["solid"].append(post | {"position_mm": [700.0, 0.0, 1000.0]})
    job = job_of(tmp_path, data).job.job_at_station("left")
    with pytest.raises(CarrierFault, match=r"would come within .* of post"):
        CarrierSweep(job, arm, np.radians(HOME)).clear_way(start, goal)


def test_what_goes_with_the_base_is_kept_clear_too(tmp_path: Path) -> None:
    data = turn_table()
    data["clearance"]["solid"][-1] |= {"position_mm": [0.0, 300.0, 500.0], "length_mm": 900.0}
    job = job_of(tmp_path, data).job.job_at_station("left")
    with pytest.raises(CarrierFault, match="outrigger would come within"):
        CarrierSweep(job, Kinematics.load("ur10e"), np.radians(HOME)).clear_way(
            np.zeros(1), np.array([np.pi])
        )


def test_what_begins_near_a_plate_does_not_pass_through_it(tmp_path: Path) -> None:
    data = turn_table()
    axis = {"name": "x", "kind": "linear", "direction": [1.0, 0, 0], "limits_mm": [-5000, 5000]}
    data["carrier"] |= {"carries": "arm", "position_mm": [0.0, 0, 5000], "axis": [axis]}
    data["carrier"]["euler_zyx_deg"] = [0.0, 0.0, 0.0]
    data["station"][1]["carrier"] = [0.0]
    boxes = (
        ("carriage", "b", [200.0, 200.0, 200.0], [0.0, 0.0, -1500.0]),
        ("plate", "w", [20.0, 400.0, 400.0], [115.0, 0.0, 3500.0]),  # 5 mm before it
    )
    data["clearance"]["solid"] = [
        {"name": name, "frame": frame, "kind": "box", "size_mm": size, "position_mm": place}
        for name, frame, size, place in boxes
    ]
    job = job_of(tmp_path, data).job.job_at_station("left")
    sweep = CarrierSweep(job, Kinematics.load("ur10e"), np.radians(HOME))
    with pytest.raises(CarrierFault, match="plate"):
        sweep.check_line(np.array([0.0]), np.array([2.0]))


@pytest.mark.parametrize("order", [1, -1])
def test_a_boom_does_not_swing_through_a_plate(tmp_path: Path, order: int) -> None:
    data = turn_table()
    turn = data["carrier"]["axis"][0] | {"point_mm": [0.0, 0.0, 0.0]}
    lift = {"name": "z", "kind": "linear", "direction": [0.0, 0.0, 1.0], "limits_mm": [0.0, 1.0]}
    data["carrier"] |= {"carries": "arm", "position_mm": [0.0, 0.0, 5000.0]}
    data["carrier"]["axis"] = [turn, lift][::order]
    for station in data["station"]:
        station["carrier"] = [0.0, 0.0]
    data["carrier"]["euler_zyx_deg"] = [0.0, 0.0, 0.0]
    boxes = (
        ("boom's end", "b", [20.0, 20.0, 20.0], [20000.0, 0.0, 0.0]),
        ("plate", "w", [400.0, 4.0, 400.0], [20000.0, 600.0, 5000.0]),
    )
    data["clearance"]["solid"] = [
        {"name": name, "frame": frame, "kind": "box", "size_mm": size, "position_mm": place}
        for name, frame, size, place in boxes
    ]
    job = job_of(tmp_path, data).job.job_at_station("left")
    sweep = CarrierSweep(job, Kinematics.load("ur10e"), np.radians(HOME))
    with pytest.raises(CarrierFault, match=r"boom's end would come within .* of plate"):
        sweep.check_line(np.zeros(2), np.array([1.0, 0.0][::order]))


def test_a_look_that_a_reversed_axis_would_lead_into_something_is_not_made(
    quick: tuple[Path, tuple[StationScan, ...]], tmp_path: Path
) -> None:
    run = Path(shutil.copytree(quick[0], tmp_path / "run"))
    shutil.rmtree(run / "right")
    data = read_toml(run / "job.toml")
    T_w_b = read_scan_job(run / "left" / "job.toml").T_w_b
    outrigger = data["clearance"]["solid"][-1]
    # The table is to turn to negative angles; if it went the other way, the arm would come here.
    there = unit_vector(np.cross(T_w_b[:3, 3], (0.0, 0.0, 1.0)))
    gap = outrigger["radius_mm"] + data["clearance"]["margin_mm"] + 2.0
    place = 1e3 * transform_points(T_w_b, 1e-3 * np.array(outrigger["position_mm"]))
    post = {"name": "post", "frame": "w", "kind": "capsule", "radius_mm": 10.0, "length_mm": 10.0}
    post["position_mm"] = (place + (gap + 10.0) * there).tolist()
    data["clearance"]["solid"].append(post)
    written(run, data)
    said = r"look at axis 'turn' \(and .* way\): .* outrigger would come within .* of post"
    with pytest.raises(CarrierFault, match=said):
        resume_stations(again(run), {}, Refusing(), unwatched)
    assert not (run / "right").exists()


def test_an_exact_carrier_scans_as_a_base_that_stands_there(
    quick: tuple[Path, tuple[StationScan, ...]], tmp_path: Path
) -> None:
    directory, _ = quick
    job, carried = directory / "right" / "job.toml", read_recorded_scan(directory / "right")
    data, T_w_b = read_toml(job), read_scan_job(job).T_w_b
    del data["carrier"], data["station"][0]["carrier"], data["station"][0]["overlap_mm"]
    data["station"][0] |= table_of(T_w_b)
    data["simulation"]["arm"]["home_deg"] = HOME
    data["joint"]["file"] = str(directory / "right" / data["joint"]["file"])
    context = ScanContext(read_scan_job(written(tmp_path, data)), tmp_path / "job.toml")
    run_scan(context, tmp_path / "run")
    rigid = read_recorded_scan(tmp_path / "run")
    assert len(rigid.sections) == len(carried.sections)
    for one, other in zip(rigid.sections.values(), carried.sections.values(), strict=True):
        across = np.eye(3) - np.outer(one.T_b_g[:3, 0], one.T_b_g[:3, 0])
        off = (one.points_b - other.points_b)[1:4] @ across
        assert np.linalg.norm(off, axis=1).max() < ALIKE


def test_postures_are_checked_before_anything_moves(tmp_path: Path) -> None:
    data = turn_table(home_deg=HOME[:3])
    with pytest.raises(ConfigurationError, match="6 joint angles"):
        run_stations(job_of(tmp_path, data), tmp_path / "run", Refusing(), unwatched)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("options", [(), ("--dry-run",)])
def test_one_station_is_not_scanned_while_the_carrier_is_elsewhere(
    options: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(SimulatedCarrier, "state", lambda self: np.radians([5.0]))
    file, out = written(tmp_path, turn_table()), tmp_path / "run"
    assert tjscan("scan", file, "--station", "left", "--out", out, *options) == 4
    told = " ".join(capsys.readouterr().err.split())
    assert "the carrier is at turn 5 deg, and station left is at turn 0 deg" in told
    assert not out.exists()
    if not options:
        with pytest.raises(CarrierFault, match="bring it there first"):
            scan(file, station="left", directory=out)
        assert not out.exists()


def test_results_are_written_wherever_the_carrier_is(
    quick: tuple[Path, tuple[StationScan, ...]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Path(shutil.copytree(quick[0], tmp_path / "run"))
    monkeypatch.setattr(SimulatedCarrier, "state", lambda self: np.radians([-62.0]))
    assert tjscan("scan", "--resume", run / "left") == 0
    assert tjscan("scan", "--resume", run / "left", "--scan.length-mm", "450") == 4


def test_a_whole_joint_goes_round_in_one_command(tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert tjscan("scan", written(tmp_path, turn_table(180.0, 180.0)), "--out", out) == 0
    report = read_stitching_report(out)
    assert report is not None
    assert report.covered_deg > 359
    exact = report.stations[1]
    assert exact.nominal_off_mm < 0.01  # as the carrier says
