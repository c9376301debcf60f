"""A weld is looked at, planned again, stopped and gone on with; nothing of it claims to be real."""

import json
import shutil
from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass, fields, replace
from functools import partial
from math import radians
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import pytest
from command import tjscan
from grooves import Groove, Noise, draw

from tjscan.cli.output.weld import print_weld_log
from tjscan.core.errors import ConfigurationError, PowerLinkLost, WeldStopped
from tjscan.core.frames import Array, pose
from tjscan.core.sourced import ABSENT_NUMBER, NumberSource, SourcedNumber
from tjscan.groove.filled import KnownFlanks
from tjscan.job.weld import read_weld_job
from tjscan.planning.path import GrooveStations
from tjscan.planning.wps import read_wps
from tjscan.power.height import FASTEST_HEIGHT_CHANGE, LONGEST_PERIOD, ArcHeightSettings
from tjscan.power.sequence import ArcFault, ArcLimits
from tjscan.power.simulated import PowerSimulationSettings, SimulatedPowerSource
from tjscan.power.source import PowerSample
from tjscan.recording.journal import RunEvent
from tjscan.recording.parts import recording_files
from tjscan.runs.live.weld import read_weld_show
from tjscan.runs.weld.arc import ArcWelder, SimulatedClock, _Moment, left_to_weld
from tjscan.runs.weld.beads import WeldPass
from tjscan.runs.weld.journal import (
    ARC_BEGUN_EVENT,
    HEIGHT_EVENT,
    ArcMessage,
    ArcStretchMessage,
    LookMessage,
    PlannedBeadMessage,
    WeldRecording,
    name_of_bead,
    read_weld,
)
from tjscan.runs.weld.look import (
    FlanksAlongGroove,
    interpolate_poses,
    place_in_sections,
    read_steel,
    surface_of_profiles,
)
from tjscan.runs.weld.report import _weld_findings
from tjscan.runs.weld.results import (
    SIMULATED_WELD_NOTE,
    WELD_LOG_FILE,
    RecordedWeld,
    read_recorded_weld,
    weld_log,
)
from tjscan.runs.weld.run import LookSchedule, Weld, WeldContext, resume_weld, run_weld
from tjscan.welding.look import SurfaceLook
from tjscan.welding.replan import GroovePart, NextBead
from tjscan.welding.target import WeldTarget

ROOT: Final = Path(__file__).parents[2]
JOB: Final = ROOT / "examples" / "weld.toml"
REAL_HOSTS: Final = ("192.168.0.50", "welder", "128.0.0.1")
SHORT: Final = {"scan.length_mm": 80.0, "weld.station_step_mm": 4.0}


def numbers_without_source(entry: Any) -> Iterable[str]:
    if isinstance(entry, list):
        for one in entry:
            yield from numbers_without_source(one)
    elif isinstance(entry, dict):
        sourced = entry.get("source") in set(NumberSource)
        for key, value in entry.items():
            if not (sourced and key == "value"):
                yield from numbers_without_source(value)
    elif isinstance(entry, int | float):
        yield str(entry)


def arc(begin: float, end: float) -> ArcMessage:
    none = np.empty(0)
    return ArcMessage(0, begin, end, 1.0, "", True, none, none, none, none)


def test_what_is_left_of_a_bead_overlaps_what_is_welded_and_no_more() -> None:
    assert left_to_weld((0.0, 0.2), [], 0.01) == (0.0, 0.2)
    assert left_to_weld((0.0, 0.2), [arc(0.0, 0.0)], 0.01) == (0.0, 0.2)
    assert left_to_weld((0.0, 0.2), [arc(0.0, 0.08)], 0.01) == pytest.approx((0.07, 0.2))
    again = [arc(0.0, 0.08), arc(0.07, 0.15)]
    assert left_to_weld((0.0, 0.2), again, 0.01) == pytest.approx((0.14, 0.2))
    assert left_to_weld((0.0, 0.2), [*again, arc(0.14, 0.2)], 0.01) is None
    assert left_to_weld((0.0, 0.2), [arc(0.002, 0.2)], 0.01) is None, "a second ignition"
    assert left_to_weld((0.3, 0.5), [arc(0.0, 0.2)], 0.01) == (0.3, 0.5), "another stretch"


def bent_stations() -> GrooveStations:
    s = np.linspace(0.0, 0.2, 101)
    angle, radius = s / 0.3, 0.3
    outward = np.column_stack((np.cos(angle), np.sin(angle), 0 * s))
    tangent = np.column_stack((-np.sin(angle), np.cos(angle), 0 * s))
    up = np.tile((0.0, 0.0, 1.0), (len(s), 1))
    corners = np.tile([[-0.003, -0.02], [0.003, -0.02], [0.02, 0.0], [-0.02, 0.0]], (len(s), 1, 1))
    return GrooveStations(s, radius * outward, outward, up, corners, tangent)


def surface_height(u: Array) -> Array:
    return np.asarray(np.maximum(np.abs(u) - 0.003, 0.0) * (0.02 / 0.017) - 0.02)


def bent_points(stations: GrooveStations, s: float, u: Array) -> Array:
    angle = s / 0.3
    out = np.array((np.cos(angle), np.sin(angle), 0.0))
    return np.asarray((0.3 + u)[:, None] * out + surface_height(u)[:, None] * (0.0, 0.0, 1.0))


def test_points_are_placed_along_a_bent_groove() -> None:
    stations, u = bent_stations(), np.linspace(-0.02, 0.02, 41)
    s, places = place_in_sections(stations, bent_points(stations, 0.0513, u))
    assert s == pytest.approx(0.0513, abs=2e-5)
    assert places[:, 0] == pytest.approx(u, abs=2e-6)  # sagitta of two millimetres
    assert places[:, 1] == pytest.approx(surface_height(u), abs=1e-9)
    before, _ = place_in_sections(stations, bent_points(stations, -0.01, u))
    assert np.isnan(before).all()


def straight_flanks() -> tuple[FlanksAlongGroove, KnownFlanks]:
    """Of a groove along y, and what is known of it in each plane across."""
    groove = Groove()
    wall, _, _, leg = groove.directions
    p2, p3, p4 = groove.corners
    g = p2 + wall * np.linalg.solve(np.column_stack((wall, -leg)), p4 - p2)[0]
    s = np.linspace(0.0, 0.2, 11)
    corners = np.zeros((11, 4, 3))
    corners[:, :, [0, 2]] = p3, p4, g, p2
    corners[:, :, 1] = s[:, None]
    known = KnownFlanks(groove.corners, wall, leg, np.zeros(2))
    return FlanksAlongGroove(s, corners, s[[0, -1]], np.zeros((2, 2))), known


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_flanks_are_carried_into_the_plane_of_a_profile(way: float) -> None:
    flanks, known = straight_flanks()
    turned = replace(flanks, corners=flanks.corners * (1.0, way, 1.0))
    found = turned.known_in(pose(np.eye(3), np.array((0.0, 0.0513 * way, 0.0))))
    assert found.corners == pytest.approx(known.corners, abs=1e-12)
    assert found.wall == pytest.approx(known.wall, abs=1e-12)
    assert found.leg == pytest.approx(known.leg, abs=1e-12)


def test_steel_of_a_profile_lies_where_the_sensor_was() -> None:
    flanks, _ = straight_flanks()
    profile, at = draw(Groove(), Noise(sigma=0.03e-3)), np.array((0.0, 0.0513, 0.0))
    points, sigmas = read_steel(profile, flanks, pose(np.eye(3), at))
    assert points[:, 1] == pytest.approx(0.0513)
    assert len(points) == len(sigmas) > 0.9 * profile.valid.sum()
    off = np.abs(points[:, None, [0, 2]] - profile.points[profile.valid]).max(axis=2)
    assert off.min(axis=1).max() < 1e-12


def test_no_steel_is_seen_where_another_groove_is() -> None:
    flanks, _ = straight_flanks()
    points, sigmas = read_steel(draw(Groove(), Noise()), flanks, pose(np.eye(3), (0.008, 0.05, 0)))
    assert points.shape == (0, 3)
    assert len(sigmas) == 0


def test_look_gives_the_surface_though_a_profile_is_misled() -> None:
    stations, fine = bent_stations(), np.linspace(-0.025, 0.025, 301)
    profiles = []
    for k, at in enumerate(np.arange(0.0, 0.2, 1e-3)):
        points = bent_points(stations, at, fine)
        if k % 5 == 3:
            points[100:160] += (0.0, 0.0, 0.003)
        profiles.append((points, np.full(len(fine), 0.03e-3)))
    u, toes = np.linspace(-0.022, 0.022, 177), np.tile((-0.02, 0.02), (101, 1))
    refused = np.empty((0, 3)), np.empty(0)
    hidden = [one if not 80 <= k < 104 else refused for k, one in enumerate(profiles)]
    for taken in (profiles, hidden):
        found = surface_of_profiles(stations, taken, u, toes, 4e-3)
        rows = found.read & (stations.s > 0.006) & (stations.s < 0.19)
        off = np.abs(found.w - surface_height(u))[rows]
        assert np.percentile(off, 99) < 0.1e-3
        between = np.abs(u) < 0.019
        assert found.sigma[rows][:, between].min() >= 0.03e-3 * (1 - 1e-9)
        assert np.median(found.sigma[rows][:, between]) == pytest.approx(0.03e-3)
    unread = stations.s[~found.read]
    assert 0.08 < unread.min() < 0.088
    assert 0.096 < unread[unread < 0.19].max() < 0.104


def test_way_of_a_look_has_the_scan_s_poses_in_it() -> None:
    poses = [np.eye(4) for _ in range(3)]
    for k, one in enumerate(poses):
        one[0, 3] = 0.04 * k
    way = list(interpolate_poses(poses, 4e-3))
    x = np.array([one[0, 3] for one in way])
    assert x == pytest.approx(np.linspace(0.0, 0.08, 21))


@dataclass(frozen=True, eq=False)
class StoppedContext(WeldContext):
    """The operator stops after some cycles of arcs and looks."""

    counter: Any = None

    @property
    def must_stop(self) -> bool:
        return bool(next(self.counter) == 9000)


@pytest.fixture(scope="module")
def welded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short weld that was stopped in its second bead and gone on with."""
    from itertools import count

    directory = tmp_path_factory.mktemp("weld") / "run"
    job = read_weld_job(JOB, dict(SHORT))
    with pytest.raises(WeldStopped, match="by the operator") as caught:
        run_weld(StoppedContext(job, JOB, counter=count()), directory, arc=True)
    assert caught.value.fault == ArcFault.STOPPED
    file = directory / "job.toml"
    resume_weld(WeldContext(read_weld_job(file), file), arc=True, looks=LookSchedule.LAYER)
    return directory


def test_stopped_weld_goes_on_with_an_overlap_and_welds_nothing_twice(welded: Path) -> None:
    found = read_recorded_weld(welded)
    stopped = [one for one in found.arcs if one.fault]
    assert len(stopped) == 1
    assert 0.0 < stopped[0].end < found.beads[0].s[-1]
    for bead in found.beads:
        arcs = found.arcs_of(bead)
        # Stretches that were not read part a bead.
        read = np.flatnonzero(bead.weldable > 0)
        spans = np.split(bead.s[read], np.flatnonzero(np.diff(read) > 1) + 1)
        length = sum(float(np.ptp(span)) for span in spans)
        welded_length = sum(one.end - one.begin for one in arcs)
        overlaps = 0.01 * (len(arcs) - len(spans))
        assert welded_length == pytest.approx(length + overlaps, abs=1e-9)
    assert len(found.beads) > 8


def test_a_weld_is_shown_again_with_the_surface_of_every_look(welded: Path) -> None:
    show, entries = read_weld_show(welded)
    shown = [step.profile for step in map(show.step_of_entry, entries) if step.profile]
    assert len(shown) == len(read_recorded_weld(welded).looks)
    assert all(len(curve.across) == len(curve.up) > 10 for curve in shown)


def test_looks_find_what_goes_otherwise_than_set(welded: Path) -> None:
    looks = [one for one in read_recorded_weld(welded).looks if isinstance(one, LookMessage)]
    assert looks[0].beads == 0
    assert looks[-1].beads == len(read_recorded_weld(welded).beads)
    assert looks[-1].shrinkage == pytest.approx(1.2, abs=0.12)


def test_every_number_of_the_log_has_a_source(welded: Path) -> None:
    log = json.loads((welded / WELD_LOG_FILE).read_text())
    assert list(numbers_without_source(log)) == []
    assert log["note"] == SIMULATED_WELD_NOTE
    assert log["interpass_temperature"] == {"value": None, "unit": "C", "source": "absent"}
    rows = [row for bead in log["beads"] for row in bead["stretches"]]
    assert {row["current"]["source"] for row in rows} == {"simulated"}
    assert "measured" not in json.dumps(log)
    assert {row["current"]["value"] for row in rows} & {0.0, None} == set()
    assert {"job.toml", "wps.toml", "weld.mcap", "weld-2.mcap"} <= set(log["sha256"])


def test_report_says_that_it_was_simulated(welded: Path) -> None:
    assert tjscan("report", welded) == 0
    page = (welded / "report.html").read_text()
    assert SIMULATED_WELD_NOTE in page
    assert "no crack" in page
    assert "Finished surface: up to" in page
    assert "Wide pools" not in page


def test_beads_on_a_horizontal_leg_are_held_and_stacked_from_it_up(welded: Path) -> None:
    """Gravity lies 60° aside in the sections: wide pools would run down onto the leg."""
    job = welded / "job.toml"
    weld = Weld.of_scan(WeldContext(read_weld_job(job), job), welded)
    tilt = weld.world.state.tilt
    assert (tilt < -radians(50)).all()
    for message in read_weld(welded):
        weld.replay(message)
    order, planner = weld.order, weld.planner
    beads = read_recorded_weld(welded).beads
    assert planner is not None
    # Gravity that pulls all of a few beads aside is hardly told from the wire's offset.
    offset = planner.learner.offset
    assert abs(offset.value - 0.5e-3) < 2 * offset.sigma < 0.7e-3
    model = planner.model
    width = np.array([model.bead_width(one.heat_input, one.weave).mean() for one in beads])
    assert (width < 1.1 * model.widest_on_slope(tilt).min()).all()
    last = [bead for bead in beads if bead.layer == len(order.counts) - 1]
    places = [float(bead.aim[:, 0].mean()) for bead in last]
    assert places == sorted(places, reverse=True)  # the leg is on the right
    inner = slice(5, -5)
    target = WeldTarget.over(planner.belief, order.cap_height)
    off = np.where(target.between, planner.belief.w - target.top, np.nan)[inner]
    assert np.sqrt(np.nanmean(off**2)) < 1.3e-3  # with looks at layers alone


def test_pools_that_the_procedure_keeps_too_wide_for_the_slope_are_told(welded: Path) -> None:
    job = welded / "job.toml"
    context = WeldContext(read_weld_job(job), job)
    wide = context.wps.model_copy(
        update={
            "bead": replace(context.wps.bead, fill_area=(38e-6, 48e-6), cap_area=(38e-6, 48e-6))
        }
    )
    context.__dict__["wps"] = wide
    assert Weld.of_scan(context, welded).order.too_wide > 1e-3


def test_a_weld_whose_looks_state_one_sigma_a_station_is_still_read(
    welded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Earlier versions recorded so."""
    run = shutil.copytree(welded, tmp_path / "run")
    messages, files = list(read_weld(welded)), recording_files(run, "weld")
    for file in files:
        file.unlink()
    with WeldRecording(files[0]) as recording:
        for one in messages:
            if isinstance(one, LookMessage):
                one = replace(one, sigma=np.median(one.seen.sigma, axis=1))
            recording.record(one)
    looks = (read_recorded_weld(one).looks for one in (run, welded))
    for now, before in zip(*looks, strict=True):
        assert now.seen.sigma.shape == before.seen.sigma.shape
        assert (now.seen.sigma == np.median(before.seen.sigma, axis=1)[:, None]).all()
    limits = ROOT / "examples" / "iso5817-example.toml"
    assert tjscan("inspect", run, "--limits", limits, "--thickness-mm", 25, "--json") in (0, 3)
    assert json.loads(capsys.readouterr().out)["rows"]
    assert tjscan("report", run) == 0


def test_last_look_is_held_against_limits_and_complies_with_nothing(
    welded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    limits = ROOT / "examples" / "iso5817-example.toml"
    code = tjscan("inspect", welded, "--limits", limits, "--thickness-mm", 25, "--json")
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert SIMULATED_WELD_NOTE in found["note"]
    assert "no crack" in found["not_seen"]
    assert {row["imperfection"] for row in found["rows"]} >= {"excess", "sag", "undercut"}
    beyond = any(row["state"] == "beyond" for row in found["rows"])
    assert code == (3 if beyond else 0)
    assert not list(numbers_without_source(found))
    assert {row["value"]["source"] for row in found["rows"]} == {"simulated"}
    assert "compl" not in said.out + said.err


def test_no_arc_burns_without_being_asked_for(tmp_path: Path) -> None:
    out = tmp_path / "run"
    keys = [word for key, value in SHORT.items() for word in (f"--{key}", value)]
    assert tjscan("weld", JOB, "--out", out, *keys) == 0
    found = read_recorded_weld(out)
    assert found.arcs == ()
    assert found.stretches == ()
    assert len(found.beads) > 8


def test_what_can_not_be_welded_is_refused_before_anything_moves(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="simulated arm alone"):
        read_weld_job(JOB, {"arm.driver": "ur", "arm.ur.host": "127.0.0.2"})
    with pytest.raises(ConfigurationError, match="direction"):
        read_weld_job(JOB, {"weld.gravity": [0.0, 0.0, 0.0]})
    for power in ({"power.driver": "modbus", "power.modbus.host": host} for host in REAL_HOSTS):
        with pytest.raises(ConfigurationError, match="a real arc would burn in one spot"):
            read_weld_job(JOB, power)
    with pytest.raises(ConfigurationError, match="a real arc would burn in one spot"):
        read_weld_job(JOB, {"power.driver": "none"})
    for host in ("127.0.0.9", "::1", "localhost"):
        read_weld_job(JOB, {"power.driver": "modbus", "power.modbus.host": host})
    assert tjscan("weld", JOB, "--out", tmp_path / "a", "--weld.wps", "gone.toml") == 2
    assert not (tmp_path / "a").exists()
    assert tjscan("weld", tmp_path, "--resume") == 2


class FailingJournal:
    """Keeps what it is given, and fails once."""

    def __init__(self, fails: Callable[[object], bool]) -> None:
        self.fails, self.kept = fails, list[object]()

    def record(self, message: object) -> None:
        if self.fails(message):
            self.fails = lambda message: False
            raise OSError("disk full")
        self.kept.append(message)


def bead_along(s: Array) -> NextBead:
    one, none = np.ones_like(s), np.zeros_like(s)
    pair = np.zeros((len(s), 2))
    return NextBead(0, 0, s, pair, pair, one, one, 5e-3 * one, 0.15 * one, none, one, none)


@pytest.mark.parametrize(
    ("fails", "fault"),
    [
        (lambda one: isinstance(one, RunEvent) and one.name == "crater", "disk full"),
        (lambda one: isinstance(one, ArcStretchMessage), ""),
    ],
)
def test_arc_is_out_and_recorded_whatever_fails(
    fails: Callable[[object], bool], fault: str
) -> None:
    clock, journal = SimulatedClock(), FailingJournal(fails)
    with SimulatedPowerSource(PowerSimulationSettings(), lambda: clock.now) as source:
        wps = read_wps(ROOT / "examples" / "wps.toml")
        welder = ArcWelder(source, ArcLimits(), wps, clock, journal, lambda: False, True)
        with pytest.raises(OSError, match="disk full"):
            welder.weld(bead_along(np.array((0.0, 0.03))), 0.0, 0.03)
        assert not source.state().flow
    arcs = [one for one in journal.kept if isinstance(one, ArcMessage)]
    assert [one.fault for one in arcs] == [fault]
    assert arcs[0].end == pytest.approx(0.03, abs=1e-4)
    assert isinstance(journal.kept[0], RunEvent)
    assert journal.kept[0].name == ARC_BEGUN_EVENT


class SilentSource(SimulatedPowerSource):
    """Answers until current flows; then each exchange ends after its timeout."""

    timeout: Callable[[float], None]

    def state(self) -> PowerSample:
        sample = super().state()
        if sample.flow:
            self.timeout(0.06)
            raise PowerLinkLost("no answer")
        return sample


def test_dead_link_is_named_a_second_after_the_arc_was_put_out() -> None:
    """However long each exchange takes that is not answered."""
    clock, journal = SimulatedClock(), FailingJournal(lambda message: False)
    with SilentSource(PowerSimulationSettings(), lambda: clock.now) as source:
        source.timeout, source.quench = clock.wait, lambda: None  # type: ignore[method-assign]
        wps = read_wps(ROOT / "examples" / "wps.toml")
        welder = ArcWelder(source, ArcLimits(), wps, clock, journal, lambda: False, True)
        _, stopped = welder.weld(bead_along(np.array((0.0, 0.03))), 0.0, 0.03)
    assert stopped is not None
    assert stopped.fault == ArcFault.LINK_LOST
    assert clock.now < 1.1 + ArcLimits().preflow + PowerSimulationSettings().ignition + 0.1


def weld_without_looks(**context: Any) -> Weld:
    """A weld whose recording can be replayed; it has no groove."""
    of_groove: dict[str, Any] = {
        one.name: None
        for one in fields(Weld)
        if one.init and one.default is MISSING and one.default_factory is MISSING
    }
    of_groove |= {
        "context": WeldContext(read_weld_job(JOB), JOB, **context),
        "stations": bent_stations(),
        "passes": tuple(WeldPass(k, "", 0.0, 0.2) for k in range(3)),
        "arms": {"": SimpleNamespace(part=GroovePart.all_of(bent_stations().s))},
    }
    return Weld(**of_groove)


class CountingPlanner:
    """Counts the beads that are laid, and plans the next."""

    def __init__(self) -> None:
        self.done, self.laid = 0, list[Any]()

    def next_bead(self, part: GroovePart) -> NextBead:
        return replace(bead_along(part.s), number=self.done)

    def for_arc(self, bead: NextBead, begin: float, end: float) -> NextBead:
        return bead

    def area_of_arc(self, s: Array, *others: Any) -> Array:
        return np.ones_like(s)

    def after_bead(self, bead: NextBead, *laid: Any) -> None:
        assert bead.number == self.done
        self.laid.append(laid[0])
        self.done += 1

    def take_look(self, *seen: Any) -> None:
        pass

    def begin_at(self, *seen: Any) -> None:
        pass


def planned(number: int, weldable: float = 1.0, *, dry: bool = False) -> PlannedBeadMessage:
    bead = replace(bead_along(bent_stations().s), number=number)
    values = {one.name: getattr(bead, one.name) for one in fields(NextBead)}
    return PlannedBeadMessage(**values, weldable=np.full(len(bead.s), weldable), dry=dry)


def test_a_look_stands_beside_the_pass_that_it_follows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    order = [(0, "A"), (0, "B"), (1, "B"), (2, "B"), (2, "A"), (1, "A")]  # two beads in a layer
    beads = [replace(planned(number), station=station) for number, station in order]
    row, learnt = np.zeros(2), (1.0, 0.0, 1.0)
    looks = [LookMessage(k, 0.0, row, row, row, row, 1e-3 * k, 1e-4, *learnt) for k in range(1, 7)]
    monkeypatch.setattr("tjscan.runs.weld.results.read_weld", lambda directory: beads + looks)
    print_weld_log(tmp_path, json=False)
    shown = capsys.readouterr().err
    for k, (number, station) in enumerate(order, start=1):
        name = name_of_bead(number, station).removeprefix("bead ")
        assert f"{k}.00 ± 0.10" in next(one for one in shown.splitlines() if name in one)


def replayed(*messages: object) -> Weld:
    weld = weld_without_looks()
    planner: Any = CountingPlanner()
    weld.planner = planner
    state = SimpleNamespace(tilt=np.zeros(101))
    weld.world = SimpleNamespace(weld=lambda trace: None, state=state)  # type: ignore[assignment]
    weld._readable[""] = np.ones(101, dtype=bool)
    for message in messages:
        weld.replay(message)
    weld.end_replay()
    return weld


def test_dry_run_over_a_half_welded_bead_welds_nothing() -> None:
    dry = [planned(number, dry=True) for number in range(3)]
    weld = replayed(planned(0), arc(0.0, 0.04), *dry)
    assert weld.done == 0
    assert weld._bead is not None
    assert list(weld.stretches_left(weld._bead)) == [pytest.approx((0.03, 0.2))]


def test_bead_on_which_nothing_could_be_welded_counts_after_a_resume() -> None:
    weld = replayed(planned(0, 0.0), planned(1), arc(0.0, 0.04))
    assert weld.done == 1
    assert replayed(planned(0), planned(0)).done == 0


def test_stretch_too_short_for_an_arc_is_not_weldable() -> None:
    weld, s = replayed(), bent_stations().s
    read = (s > 0.08) | (s < 0.01)
    u = np.linspace(-0.02, 0.02, 5)
    weld.toes_u = np.tile((-0.01, 0.01), (len(s), 1))
    weld._take_look(SurfaceLook(u, np.zeros((len(s), 5)), np.zeros((len(s), 5)), read), "")
    assert (weld._readable[""] == (s > 0.08)).all()


def test_operator_stops_a_dry_run() -> None:
    weld = replayed()
    weld.context.stop.ends_after_section = True
    with pytest.raises(WeldStopped, match="by the operator"):
        weld.plan_all(FailingJournal(lambda message: False))


def test_heat_input_without_voltage_is_believed_and_time_is_the_samples() -> None:
    samples = [
        PowerSample(
            time=0.02 * k,
            flow=True,
            source=NumberSource.MEASURED,
            current=SourcedNumber(250.0, NumberSource.MEASURED),
        )
        for k in range(3)
    ]
    seen = [_Moment(1e-3 * k, 5e-3, 0.15, 0.0, one) for k, one in enumerate(samples, 1)]
    none: Any = None
    wps = read_wps(ROOT / "examples" / "wps.toml")
    welder = ArcWelder(none, ArcLimits(), wps, none, none, none, simulated=False)
    message = welder._message(bead_along(np.array((0.0, 0.03))), 0.0, 0.003, seen, "")
    assert message.seconds == pytest.approx(0.04)
    (row,) = welder._stretches(message, seen)
    assert row.heat_input.source is NumberSource.BELIEVED
    assert row.current.source is NumberSource.MEASURED


def test_second_ignition_needs_room_and_names_its_gap() -> None:
    weld, journal = replayed(), FailingJournal(lambda message: False)
    no_ignition = WeldStopped(ArcFault.NO_IGNITION, "none")

    class Welder:
        def __init__(self) -> None:
            self.journal, self.begins = journal, list[float]()

        def weld(self, bead: Any, begin: float, end: float) -> tuple[ArcMessage, Any]:
            self.begins.append(begin)
            return arc(begin, begin), no_ignition if len(self.begins) == 1 else None

    bead, short, long = bead_along(bent_stations().s), Welder(), Welder()
    welders: Any = (short, long)
    with pytest.raises(WeldStopped, match="none"):
        weld._weld_stretch(welders[0], bead, 0.1, 0.1015)
    weld._weld_stretch(welders[1], bead, 0.1, 0.2)
    assert short.begins == [0.1]
    assert long.begins == pytest.approx([0.1, 0.102])
    assert [one.name for one in journal.kept if isinstance(one, RunEvent)] == ["gap"]
    with pytest.raises(ConfigurationError, match="overlap"):
        read_weld_job(JOB, {"weld.overlap_mm": 1.0})


def test_gap_before_a_second_ignition_does_not_count_as_welded() -> None:
    ends = np.array((0.002, 0.2))
    along: Any = dict.fromkeys(("s", "speed", "feed", "heat_input"), ends)
    second = replace(arc(0.002, 0.2), **along)
    weld = replayed(planned(0), arc(0.0, 0.0), second, planned(1))
    planner: Any = weld.planner
    s = bent_stations().s
    assert ((planner.laid[0] > 0) == (s > 0.001)).all()


def test_operator_stops_the_wait_between_two_beads() -> None:
    weld, journal, source = replayed(), FailingJournal(lambda message: False), None
    waits: list[float] = []

    def wait(seconds: float) -> None:
        waits.append(seconds)
        weld.context.stop.ends_after_section = len(waits) == 3

    clock: Any = SimpleNamespace(wait=wait)
    weld.clock, weld._readable[""] = clock, np.zeros(101, dtype=bool)
    with pytest.raises(WeldStopped, match="between two beads") as caught:
        weld.weld_all(source, LookSchedule.NONE, journal)  # type: ignore[arg-type]
    assert caught.value.fault == ArcFault.STOPPED
    assert weld.context.wps.sequence.interpass_wait > 10
    assert waits == [1.0] * 3
    assert weld.done == 1


def test_arc_without_an_end_is_asked_about_before_the_weld_goes_on() -> None:
    begun = RunEvent(ARC_BEGUN_EVENT, "bead 1 from 0.0 mm on")
    weld = weld_without_looks(ask=lambda question: "bead 1 from 0.0 mm" not in question)
    weld.replay(begun)
    with pytest.raises(WeldStopped, match="no one knows how far it burned: bead 1"):
        weld.end_replay()
    weld.replay(arc(0.0, 0.04))
    weld.end_replay()


def test_current_leads_a_torch_that_is_too_high_down_and_says_where_it_may_not() -> None:
    """A torch that gets 2 mm too high: the current falls unless its height follows that."""
    drops, names = [], []
    for height in (None, ArcHeightSettings(most=3e-3), ArcHeightSettings(most=1e-3)):
        clock, journal = SimulatedClock(), FailingJournal(lambda message: False)
        over = [0.0]

        def raise_torch(s: float, raised: float, over: list[float] = over) -> None:
            over[0] = raised + 2e-3 * s / 0.06

        settings = PowerSimulationSettings(current_noise=0.0)
        now, higher = partial(getattr, clock, "now"), partial(over.__getitem__, 0)
        with SimulatedPowerSource(settings, now, higher) as source:
            wps = read_wps(ROOT / "examples" / "wps.toml")
            welder = ArcWelder(
                source, ArcLimits(), wps, clock, journal, lambda: False, True, height, raise_torch
            )
            assert welder.weld(bead_along(np.array((0.0, 0.06))), 0.0, 0.06)[1] is None
        rows = [one for one in journal.kept if isinstance(one, ArcStretchMessage)]
        currents = [one.current.value or 0.0 for one in rows]
        drops.append(currents[0] - currents[-1])
        names.append(
            [one.name for one in journal.kept if isinstance(one, RunEvent)].count("height")
        )
    assert drops[0] > 8
    assert drops[1] < 0.3 * drops[0]
    assert 0.3 * drops[0] < drops[2] < drops[0]
    assert names == [0, 0, 1]


class SourceWithGaps(SimulatedPowerSource):
    """A source that gives no current from time to time."""

    def state(self) -> PowerSample:
        seen = super().state()
        return replace(seen, current=ABSENT_NUMBER) if seen.time % 2.0 > 1.5 else seen


def test_torch_stays_at_its_height_where_a_source_gives_no_current() -> None:
    clock, journal, raised = SimulatedClock(), FailingJournal(lambda message: False), [0.0]
    height = ArcHeightSettings(most=1e-3)
    too_high = 1.5e-3

    def over() -> float:
        return raised[-1] + (too_high if clock.now > 2.0 else 0.0)

    def raise_torch(s: float, by: float) -> None:
        raised.append(by)

    with SourceWithGaps(PowerSimulationSettings(), lambda: clock.now, over) as source:
        wps = read_wps(ROOT / "examples" / "wps.toml")
        welder = ArcWelder(
            source, ArcLimits(), wps, clock, journal, lambda: False, True, height, raise_torch
        )
        assert welder.weld(bead_along(np.array((0.0, 0.06))), 0.0, 0.06)[1] is None
    assert min(raised) == pytest.approx(-1e-3)
    assert np.abs(np.diff(raised[2:])).max() <= 1.001 * FASTEST_HEIGHT_CHANGE * LONGEST_PERIOD
    told = [
        one.detail for one in journal.kept if isinstance(one, RunEvent) and one.name == "height"
    ]
    assert len(told) == 1
    assert told[0].startswith("bead 1 at ")
    event = RunEvent(HEIGHT_EVENT, told[0])
    recorded = RecordedWeld((), (), (), (), (event,))
    assert told[0] in weld_log(ROOT, recorded)["height_at_bound"]
    assert any(told[0] in one for one in _weld_findings(recorded))
