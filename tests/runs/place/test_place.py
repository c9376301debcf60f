"""Places of an arm's base about a joint: arcs that are reached, and a job that scans all of it."""

import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from command import tjscan
from hypothesis import assume, given
from hypothesis import strategies as st

from tjscan.core.errors import GrooveNotFound, StartSeesNoGroove, StitchingRefused
from tjscan.core.frames import inverse_pose, pose, rot_y, rot_z
from tjscan.job.cell import Cell
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.joint.file import read_joint
from tjscan.recording.journal import Journal
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import Cylinder
from tjscan.runs.place.job import _Search
from tjscan.runs.place.search import (
    ReachedArc,
    fewest_stations,
    longest_run,
    reached_arcs,
)
from tjscan.runs.scan.rehearsal import is_simulated
from tjscan.scanning.journal import RetryCounts, ScanResult, StopReason
from tjscan.stitching.stations import Station, StitchSettings

CAD = Path(__file__).parents[3] / "cad"
EXAMPLE = CAD.parent / "examples" / "ur10e.toml"
AZIMUTHS, OVERLAP = 24, 3


def arc(first: int, count: int) -> ReachedArc:
    return ReachedArc((0.0, 0.0, 0.0), np.eye(4), first, count, np.zeros((count, 6)))


@given(st.lists(st.booleans(), min_size=1, max_size=40))
def test_the_longest_run_on_a_ring(holds: list[bool]) -> None:
    first, count = longest_run(np.array(holds))
    n = len(holds)
    assert all(holds[(first + k) % n] for k in range(count))
    runs = [next((k for k in range(n) if not holds[(start + k) % n]), n) for start in range(n)]
    assert count == max(runs)


@given(
    st.lists(
        st.tuples(st.integers(0, AZIMUTHS - 1), st.integers(1, AZIMUTHS)), min_size=1, max_size=8
    )
)
def test_few_arcs_cover_all_round_with_overlaps(drawn: list[tuple[int, int]]) -> None:
    chosen = fewest_stations([arc(*one) for one in drawn], AZIMUTHS, OVERLAP, most=4)
    assume(chosen)
    times = np.zeros(AZIMUTHS, dtype=int)
    for one in chosen:
        times[np.arange(one.first, one.first + one.count) % AZIMUTHS] += 1
    assert times.min() >= 1
    joints = [(a, b) for a, b in zip(chosen, (*chosen[1:], chosen[0]), strict=True)]
    for a, b in joints:
        ahead = (b.first - a.first - 1) % AZIMUTHS + 1
        assert a.count - ahead >= OVERLAP or len(chosen) == 1


def test_three_thirds_need_all_three_and_two_halves_are_fewer() -> None:
    thirds = [arc(first, 11) for first in (0, 8, 16)]
    assert len(fewest_stations(thirds, AZIMUTHS, OVERLAP, most=4)) == 3
    assert len(fewest_stations([*thirds, arc(2, 15), arc(14, 15)], AZIMUTHS, OVERLAP, 4)) == 2
    assert fewest_stations(thirds[:2], AZIMUTHS, OVERLAP, most=4) == ()
    assert fewest_stations(thirds, AZIMUTHS, OVERLAP, most=2) == ()
    assert fewest_stations([arc(first, 13) for first in (0, 8, 16)], AZIMUTHS, OVERLAP, 2) == ()


@pytest.mark.parametrize("model", ["ur10e", "kr5_arc", "irb1600_10_145", "m10ia"])
def test_joint_angles_of_an_arc_put_the_flange_there_without_a_jump(model: str) -> None:
    arm = Kinematics.load(model)
    middle = pose(rot_y(np.pi / 2), (0.7, 0.1, 0.5))
    turns = 2 * np.pi * np.arange(36) / 36
    T_w_f = np.array(
        [middle @ pose(rot_z(a), (0.2 * np.cos(a), 0.2 * np.sin(a), 0)) for a in turns]
    )
    T_w_b = pose(rot_z(0.3), (0.05, 0.0, 0.1))
    arcs = reached_arcs(arm, T_w_f, T_w_b)
    assert max(one.count for one in arcs) > 12
    for one in arcs:
        assert (arm.joint_limit_excess(one.q) <= 0).all()
        assert np.abs(np.diff(one.q, axis=0)).max(initial=0.0) < np.radians(30)
        for k, q in enumerate(one.q):
            wanted = inverse_pose(T_w_b) @ T_w_f[(one.first + k) % 36]
            np.testing.assert_allclose(arm.forward(q), wanted, atol=1e-6)


@pytest.mark.parametrize("model", ["ur10e", "kr5_arc", "m10ia"])
def test_an_arm_stands_on_its_mount_wherever_its_controllers_base_frame_is(model: str) -> None:
    job, joint = (
        read_scan_job(EXAMPLE, {"arm.model": model}),
        read_joint(CAD / "tjoint-406x324.toml"),
    )
    searched = _Search(job, joint, job.scan, np.eye(4), tilt=0.0)
    foot = 0.8
    T_w_b = pose(p=(3.0, 0.0, foot)) @ searched.kinematics.T_root_b
    frame, mount = searched.solids(T_w_b)["mount"]
    assert frame == "b"
    assert isinstance(mount.shape, Cylinder)
    x, y, z = (T_w_b @ mount.T)[:3, 3]
    assert (x, y) == pytest.approx((3.0, 0.0), abs=1e-12)
    assert z + mount.shape.length / 2 == pytest.approx(foot, abs=0.04)
    assert z - mount.shape.length / 2 == pytest.approx(0.0, abs=0.04)


def test_a_joint_of_ones_own_becomes_a_job_that_scans_it_all_round(tmp_path: Path) -> None:
    joint = tmp_path / "own.toml"
    text = (CAD / "tjoint-406x324.toml").read_text(encoding="utf-8")
    joint.write_text(text.replace("angle_deg = 90.0", "angle_deg = 75.0"), encoding="utf-8")
    job = tmp_path / "job.toml"
    assert tjscan("place", joint, "ur10e", "--tilt-deg", "45", "--out", job, pictures=True) == 0
    assert job.with_suffix(".png").stat().st_size > 10_000
    table = tomllib.loads(job.read_text(encoding="utf-8"))
    assert table["joint"]["file"] == "own.toml"
    length = sum(one["length_mm"] + table["scan"]["step_mm"] for one in table["station"])
    assert length > np.pi * 323.9 * 1.1  # all round, and the overlaps
    assert tjscan("place", joint, "ur10e", "--out", job, pictures=True) == 2  # nothing overwritten


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (("--out", "job.png"), "ends with .toml"),
        (("--tilt-deg", "nan"), "between -180 and 180"),
    ],
)
def test_an_odd_name_or_tilt_is_refused_before_the_search(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], wrong: tuple[str, str], why: str
) -> None:
    joint = CAD / "tjoint-406x324.toml"
    given = {"--out": str(tmp_path / "job.toml"), wrong[0]: wrong[1]}
    words = [word for pair in given.items() for word in pair]
    assert tjscan("place", joint, "ur10e", *words, pictures=True) == 2
    assert why in capsys.readouterr().err


@pytest.fixture
def real_cell(tmp_path: Path) -> Path:
    """A job with a real arm."""
    assert tjscan("init", "ur10e", "--out", tmp_path / "cell", pictures=True) == 0
    job = tmp_path / "cell" / "ur10e.toml"
    text = job.read_text(encoding="utf-8")
    job.write_text(text.replace('driver = "simulated"', 'driver = "ur"', 1), encoding="utf-8")
    return job


def test_a_place_from_which_a_scan_ends_early_is_given_up_and_nothing_real_moves(
    tmp_path: Path,
    real_cell: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "elsewhere" / "job.toml"
    words = ("--template", real_cell, "--tilt-deg", "45", "--out", out)
    tried = list[ScanJob]()

    def scan(cell: Cell, job: ScanJob, journal: Journal) -> ScanResult:
        assert is_simulated(job)
        tried.append(job)
        if len(tried) == 1:
            raise StartSeesNoGroove("first", GrooveNotFound("too few points", "nothing is there"))
        stop = StopReason.UNREACHABLE if len(tried) == 2 else StopReason.LENGTH
        return ScanResult((), (), stop, "", RetryCounts.of_events(()))

    def fit(stations: Sequence[Station], settings: StitchSettings) -> None:
        if len(tried) == 3:
            raise StitchingRefused("joint not found", "seen over too little of its circumference")

    def fit_none(stations: Sequence[Station], settings: StitchSettings) -> None:
        raise StitchingRefused("joint not found", "seen over too little of its circumference")

    def search(self: _Search) -> list[ReachedArc]:
        found.append(arcs(self))
        return found[0]

    found, arcs = list[list[ReachedArc]](), _Search.arcs
    monkeypatch.setattr("tjscan.runs.place.job._Search.arcs", search)
    monkeypatch.setattr("tjscan.runs.place.job.scan_in_cell", scan)
    monkeypatch.setattr("tjscan.runs.place.job.fit_tubes_to_stations", fit)
    joint = CAD / "tjoint-406x324.toml"
    assert tjscan("place", joint, "ur10e", *words, pictures=True) == 0
    placed = {station.position for station in read_scan_job(out).station}
    stations = [job.station[0].position for job in tried]
    assert placed == set(stations[3:])
    assert not placed & set(stations[:3])
    monkeypatch.setattr("tjscan.runs.place.job._Search.arcs", lambda self: found[0])
    monkeypatch.setattr("tjscan.runs.place.job._Search.longest_unhindered", 120, raising=False)
    tried[:] = []
    monkeypatch.setattr("tjscan.runs.place.job.fit_tubes_to_stations", fit_none)
    other = tmp_path / "other.toml"
    assert tjscan("place", joint, "ur10e", *words[:-1], other, pictures=True) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "places were given up, the last because" in told
    assert "seen over too little" in told


def test_an_arm_that_is_too_small_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "job.toml"
    joint = CAD / "tjoint-600x457.toml"
    assert tjscan("place", joint, "ur5e", "--out", out, pictures=True) == 1
    assert "reach the groove all round" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_start_poses_that_see_no_groove_are_no_sound_job(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("init", "ur10e", "--out", tmp_path, pictures=True) == 0
    job = tmp_path / "ur10e.toml"
    assert tjscan("scan", job, "--dry-run", pictures=True) == 0
    capsys.readouterr()
    moved = "--joint.position-mm=[522, 903, -428]"
    assert tjscan("scan", job, "--dry-run", moved, pictures=True) == 4
    assert "at the first taught pose" in capsys.readouterr().err


def test_on_a_carrier_bases_are_where_its_axes_bring_them(tmp_path: Path) -> None:
    joint, job = CAD / "tjoint-406x324.toml", tmp_path / "job.toml"
    carrier = EXAMPLE.with_name("carrier-turn-table.toml")
    words = ("--carrier", carrier, "--out", job)
    assert tjscan("place", joint, "ur10e", *words, pictures=True) == 0
    read = read_scan_job(job)
    assert read.carrier is not None
    assert read.carrier.home is not None
    assert [table.first is None for table in read.station] == [
        False,
        *[True] * (len(read.station) - 1),
    ]
    for table in read.station:
        read.carrier.kinematics.check_values(read.carrier.values_si(table.carrier or ()))
    assert len(read.station) == 2  # as few as there can be: no base reaches all round
