"""A crawl plans each pass from its way back, with the arc of a power source."""

from __future__ import annotations

import json
import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command import tjscan

from tjscan.core.errors import (
    ConfigurationError,
    CrawlStopped,
    GrooveNotFound,
    LookRefused,
    TjscanError,
)
from tjscan.crawler.control_cycle import ControlCycle, CrawlDevices
from tjscan.crawler.crawler import LONGEST_UNREAD_STRETCH
from tjscan.crawler.guards import Guards, ProximityFilter, ProximitySensorPlaces
from tjscan.crawler.joint_tracking.memory import RememberingTracker
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.crawler.joint_tracking.tracking import FARTHEST_SIGMAS
from tjscan.crawler.journal import CrawlCycle, PlannedPass, read_crawl
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.crawler.plan import PassSettings, with_rows
from tjscan.crawler.torch_axes import SimulatedTorchAxes
from tjscan.job.crawl.cell import SimulatedWeld, make_crawl_cell
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.job.crawl.weld import CrawlWeld
from tjscan.laser.section_laser import (
    SectionLaserModel,
    SectionLaserPose,
    simulate_section_profile,
)
from tjscan.planning.wps import read_wps
from tjscan.runs.crawl.replan import MOST_BEHIND, CrawlPassPlanner
from tjscan.runs.crawl.report import crawl_chapter
from tjscan.runs.crawl.results import read_recorded_crawl
from tjscan.runs.crawl.run import (
    CrawlContext,
    _read_again,
    calibrate_slip,
    look_at_finished_weld,
    resume_crawl,
    run_crawl,
)
from tjscan.vehicle.simulated_body import VEHICLE_STATE_PERIOD
from tjscan.vehicle.vehicle import AT_REST, VehicleState

ROOT = Path(__file__).parents[2]
WPS = ROOT / "examples" / "wps.toml"
JOB = """
[vehicle]
laser_to_torch_mm = 30
[alignment]
length_mm = 60
longest_mm = 100
offset_mm = 20
offset_sigma_mm = 20
in_view_s = 0.1
return_speed_mm_s = 40
speed_mm_s = 40
[guards]
torch_sigma_mm = 20
torch_off_mm = 20
[weld]
length_m = 0.03
run_up_mm = 30
wps = "wps.toml"
layers = [1, 1, 1]
[weld.arc]
preflow_s = 0.1
postflow_s = 0.1
crater_s = 0.1
[power]
driver = "simulated"
[[pass]]
feed_m_min = 9
[[pass]]
feed_m_min = 9
weave_mm = 1.5
weave_period_s = 1
[[pass]]
feed_m_min = 9
[simulation.vehicle]
start_mm = [-30.0, 0.1]
[simulation.joint]
width_mm = 20
depth_mm = 16
length_m = 0.2
[simulation.weld]
gain_percent = 3
shrinkage_percent = -95
"""


def write_job(folder: Path) -> Path:
    shutil.copyfile(WPS, folder / "wps.toml")
    file = folder / "crawl.toml"
    file.write_text(JOB)
    return file


@pytest.fixture
def job_file(tmp_path: Path) -> Path:
    return write_job(tmp_path)


class StoppedSecond:
    """A journal that interrupts the second pass."""

    def record(self, message: object) -> None:
        number, travel = getattr(message, "number", 0), getattr(message, "travel", 0.0)
        if number == 2 and getattr(message, "arc", False) and travel > 0.018:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def cut_short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A crawl that was stopped in its second pass."""
    file = write_job(tmp_path_factory.mktemp("replan"))
    out = file.parent / "run"
    with pytest.raises(KeyboardInterrupt):
        run_crawl(CrawlContext(read_crawl_job(file), file, StoppedSecond(), arc=True), out)
    return out


def test_a_pass_is_planned_from_the_way_back_and_struck_at_rest(cut_short: Path) -> None:
    found = read_recorded_crawl(cut_short)
    assert sorted(found.planned) == [1, 2]
    first, second = (found.planned[k] for k in (1, 2))
    assert first.gain == 1.0
    assert second.gain > 1.0  # 3 % more wire than was set
    assert second.unread == 0.0
    entries = list(read_crawl(cut_short))
    for k in (k for k, entry in enumerate(entries) if isinstance(entry, PlannedPass)):
        last = next(entry for entry in entries[k::-1] if isinstance(entry, CrawlCycle))
        assert last.commanded == AT_REST  # seconds without a cycle follow
    struck = [cycle for cycle in found.cycles if cycle.arc and cycle.number == 1]
    assert abs(struck[0].state.odometry.speed) < 0.5e-3
    assert abs(struck[-1].state.odometry.speed) < 1e-3
    log = json.loads((cut_short / "weld-log.json").read_text())["passes"]
    assert log[1]["look_before"]["deposition_gain"]["source"] == "believed"
    assert log[0]["arc"]["current"]["source"] == "simulated"
    set_speed = log[0]["length_mm"] * 1e-3 / log[0]["seconds"]  # neither gas nor crater counts
    assert set_speed == pytest.approx(float(first.speed.mean()), rel=0.02)
    names = [event.name for event in found.events]
    assert names.count("welding") == 2  # the crawl's phase, and not that of its arc
    assert "arc on" not in names
    assert 200 < log[0]["arc"]["current"]["value"] < 350


def test_an_interrupted_crawl_goes_on_in_the_same_metal_as_it_was_planned(
    cut_short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(cut_short, tmp_path / "run")
    file = tmp_path / "run" / "job.toml"
    before = read_recorded_crawl(file.parent)
    resume_crawl(CrawlContext(read_crawl_job(file), file, arc=True), overlap=5e-3)
    found = read_recorded_crawl(file.parent)
    assert [one.number for one in found.passes] == [1, 2, 3]
    assert [len(one.arcs) for one in found.passes] == [1, 2, 1]
    assert found.passes[1].is_whole(0.03)
    assert found.planned[2].speed == pytest.approx(before.planned[2].speed)
    assert found.planned[3].unread == 0.0
    assert found.planned[3].gain > 1.0
    assert sum("% of it at a limit of the WPS" in one for one in found.details_of("planned")) > 0
    (surface,) = found.details_of("finished surface")
    assert "below the line between its toes" in surface
    assert f"Finished surface: {surface}." in crawl_chapter(file.parent).findings
    log = json.loads((file.parent / "weld-log.json").read_text())["passes"]
    assert log[2]["look_before"]["at_a_limit_of_the_wps"]["value"] > 0
    planner, seen = look_at_finished_weld(file.parent)
    assert planner.done == 3
    assert seen.read.all()
    wire = 1.03 * 0.25 * np.pi * 1.2e-3**2 * 0.95
    here = [one.table.at(planner.belief.s[1:2]) for one in found.planned.values()]
    laid = wire * sum(float(one.feed[0] / one.speed[0]) for one in here)
    assert planner.belief.metal_area[1] == pytest.approx(laid, rel=0.08)  # ends, overlap apart
    limits = ROOT / "examples" / "iso5817-example.toml"
    assert tjscan("inspect", file.parent, "--limits", limits, "--thickness-mm", 16, "--json") == 3
    shown = json.loads(capsys.readouterr().out)
    sag = next(row for row in shown["rows"] if row["imperfection"] == "sag")
    assert sag["value"]["source"] == "simulated"
    assert sag["value"]["value"] > 1  # three beads do not fill it
    with pytest.raises(ConfigurationError, match="not all are welded"):
        look_at_finished_weld(cut_short)


def test_where_beads_end_a_replay_reads_as_little_as_the_crawl(
    cut_short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = cut_short / "job.toml"
    context, found = CrawlContext(read_crawl_job(file), file), read_recorded_crawl(cut_short)
    planner = CrawlPassPlanner(context.job, read_wps(WPS))
    monkeypatch.setattr(planner, "planner", SimpleNamespace(done=1))
    ahead, read = context.job.vehicle.laser_to_torch, set[bool]()
    for cycle, placement in _read_again(found, context.make_reader(), planner):
        if placement is not None:
            read.add(planner.at_bead_end(cycle.travel + ahead))
    assert read == {False}


def test_no_arc_without_its_option_and_no_look_without_its_way(job_file: Path) -> None:
    asked = CrawlContext(read_crawl_job(job_file), job_file)
    with pytest.raises(ConfigurationError, match="--arc"):
        run_crawl(asked, job_file.parent / "run")
    assert not (job_file.parent / "run").exists()
    for keys, named in (
        ({"weld.layers": [1, 1]}, "2 beads"),
        ({"weld.run_up_mm": 20}, "on the way back"),
        ({"power.driver": "none"}, "burn in one spot"),
        ({"pass": [{"feed_m_min": 9, "edge_gap_mm": 2}] * 3}, "weave as stated"),
        ({"method": "paper"}, "reads no edges"),
        ({"torch.driver": "none"}, "axes that move it"),
    ):
        with pytest.raises(TjscanError, match=named):
            read_crawl_job(job_file, keys)


def test_a_simulated_source_feeds_no_real_torch(job_file: Path) -> None:
    job = read_crawl_job(job_file).model_copy(update={"simulation": None})
    refused = [message for _, message in job.contradictions()]
    assert any(message.startswith("a simulated power source needs") for message in refused)


def test_the_simulated_current_falls_where_the_torch_is_raised(job_file: Path) -> None:
    cell = make_crawl_cell(read_crawl_job(job_file, {"weld.height": {}}))
    assert isinstance(cell.world, SimulatedWeld)
    assert isinstance(cell.torch, SimulatedTorchAxes)
    cell.world.welded.append([0.0, 0.0])
    planned = float(cell.world.pass_of_arc(0).table.at(np.array(0.0)).height)
    cell.torch.move(0.0, planned + 1e-3, 0.1)
    assert cell.world.torch_raised() == pytest.approx(1e-3)


def test_a_shuttle_strikes_no_arc_and_needs_none(
    job_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tjscan.runs.crawl.run.SHUTTLE_LENGTH", 0.04)
    monkeypatch.setattr("tjscan.runs.crawl.run.SHUTTLE_COUNT", 1)
    out = job_file.parent / "shuttle"
    calibrate_slip(CrawlContext(read_crawl_job(job_file), job_file), out)
    assert not any(cycle.arc for cycle in read_recorded_crawl(out).cycles)


def test_what_was_not_seen_is_not_planned(job_file: Path) -> None:
    job = read_crawl_job(job_file)
    planner = CrawlPassPlanner(job, read_wps(WPS))
    assert planner.unread_stretch() >= job.weld.length
    show(planner, job, np.arange(-0.035, -0.028, 1e-3))
    assert planner.unread_stretch() > LONGEST_UNREAD_STRETCH
    show(planner, job, np.arange(-0.036, 0.006, 1e-3))
    assert planner.unread_stretch() == 0.0


def test_the_plan_aims_at_what_is_missing(job_file: Path) -> None:
    """A groove that is deeper over half its length gets a slower first bead there."""
    job = read_crawl_job(job_file)
    told: list[PassSettings] = []
    planner = CrawlPassPlanner(job, read_wps(WPS), tell=told.append)
    show(planner, job, np.arange(-0.036, 0.006, 1e-3))
    planned = planner.plan_pass(1)
    assert told[0].table.speed == pytest.approx(planned.speed)
    low, high = read_wps(WPS).arc.travel_speed
    assert (planned.speed >= low - 1e-9).all()
    assert (planned.speed <= high + 1e-9).all()
    assert np.abs(planned.offset).max() < 2e-3
    assert planner.unread_stretch() >= job.weld.length  # the next pass needs a look of its own


def test_a_stretch_that_no_profile_shows_is_planned_as_its_neighbours(job_file: Path) -> None:
    job = read_crawl_job(job_file)
    planner = CrawlPassPlanner(job, read_wps(WPS))
    travels = np.arange(-0.036, 0.006, 1e-3)
    places = travels + job.vehicle.laser_to_torch
    show(planner, job, travels[(places < 0.008) | (places > 0.024)])
    assert 0 < planner.unread_stretch() < LONGEST_UNREAD_STRETCH
    planned = planner.plan_pass(1)
    assert planned.unread > 0
    np.testing.assert_allclose(planned.height, -0.016, atol=0.5e-3)


def test_a_pass_that_was_begun_unread_is_planned_again(job_file: Path) -> None:
    job = read_crawl_job(job_file)
    planner = CrawlPassPlanner(job, read_wps(WPS))
    show(planner, job, np.arange(-0.036, 0.006, 1e-3))
    state, torch = VehicleState(0.0, AT_REST), TorchEstimate(0.0, 0.0, 0.0)
    struck = CrawlCycle(Phase.WELDING, 1, 0.0, state, AT_REST, torch, 0.0, 0.0, arc=True)
    planner.replay([1], [(struck, None)])
    assert planner.planner is not None
    assert planner.unread_stretch() >= job.weld.length


@pytest.mark.parametrize(("begin", "refused"), [(0.010, False), (-0.010, True)])
def test_a_stretch_that_shows_plates_and_no_groove_is_not_read(
    job_file: Path, begin: float, refused: bool
) -> None:
    job = read_crawl_job(job_file)
    planner = CrawlPassPlanner(job, read_wps(WPS))
    show(planner, job, np.arange(-0.036, 0.006, 1e-3), hidden=(begin, 0.024))
    assert (planner.unread_stretch() > LONGEST_UNREAD_STRETCH) == refused
    if not refused:
        planned = planner.plan_pass(1)
        assert 0 < planned.unread < 1
        np.testing.assert_allclose(planned.height, -0.016, atol=0.5e-3)


def test_a_first_look_at_plates_alone_is_refused(job_file: Path) -> None:
    job = read_crawl_job(job_file)
    planner = CrawlPassPlanner(job, read_wps(WPS))
    show(planner, job, np.arange(-0.036, 0.006, 1e-3), hidden=(-1.0, 1.0))
    assert planner.unread_stretch() >= job.weld.length
    with pytest.raises(LookRefused, match="between its edges"):
        planner.plan_pass(1)


def show(
    planner: CrawlPassPlanner,
    job: CrawlJob,
    travels: np.ndarray,
    hidden: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Let a planner see the simulated joint from places of the torch.

    Between two places along the weld the laser shows its plates only.
    """
    cell = make_crawl_cell(job)
    assert cell.world is not None
    reader = CrawlContext(job, Path()).make_reader()
    with cell:
        for travel in travels.tolist():
            state: VehicleState = cell.vehicle.next_state()
            profile, torch = cell.laser.capture(), TorchEstimate(0.0, 0.0, 0.0)
            cycle = CrawlCycle(
                Phase.RETURN, 1, travel, state, AT_REST, torch, 0.0, 0.0, False, profile=profile
            )
            placement = reader.read(profile, travel)
            if hidden[0] < travel + job.vehicle.laser_to_torch < hidden[1]:
                across, _ = placement.joint_coordinates(profile.x_s, profile.z_s)
                z_s = np.where(np.abs(across) < 9.5e-3, np.nan, profile.z_s)
                cycle = replace(cycle, profile=replace(profile, z_s=z_s))
            planner.see(cycle, placement)


TEN_PASSES = {
    "weld.length_m": 0.04,
    "weld.layers": [1, 2, 3, 4],
    "pass": [{"feed_m_min": 9, "weave_mm": 1.5, "weave_period_s": 1}] * 10,
    "simulation.joint.width_mm": 26,
    "simulation.joint.depth_mm": 17,
    "simulation.joint.high_low_mm": 1,
    "simulation.weld.wander_mm": 0.3,
    "simulation.weld.shrinkage_percent": 20,
}


class LedWeld:
    """Laser and torch led along a joint without a vehicle: looks at the metal, and beads in it."""

    step = 0.8e-3

    def __init__(self, job: CrawlJob, seed: int, begin: float = -0.02) -> None:
        assert job.simulation is not None
        assert job.simulation.weld is not None
        self.job, self.rng = job, np.random.default_rng(seed)
        self.planner, self.reader = CrawlPassPlanner(job, read_wps(WPS)), RememberingTracker()
        self.metal = CrawlWeld(job.simulation.joint, job.simulation.weld, seed=seed)
        self.back = np.arange(0.06, begin, -self.step)
        self.read, self.looked = list[tuple[int, float, float, float, float]](), 0

    def look(self, number: int, phase: Phase) -> None:
        """Go back, or ahead of an arc, with the laser."""
        ahead, state = self.job.vehicle.laser_to_torch, self.metal.metal.state
        places = self.back[::-1] if phase is Phase.WELDING else self.back
        for at in places.tolist():
            if self.planner.at_bead_end(at):
                continue
            self.looked += 1
            off = 0.5e-3 * np.sin(at / 0.05 + 1.3 * number)
            section, pose = self.metal.outline(at), SectionLaserPose(offset=off)
            profile = simulate_section_profile(section, pose, SectionLaserModel(), self.rng)
            with suppress(GrooveNotFound):
                placement = self.reader.read(profile, at - ahead)
                # The left plate moves: the middle between the edges moves by half of it.
                error = placement.centre + off - float(np.interp(at, state.s, state.closed)) / 2
                way = 2 * number + (phase is Phase.RETURN)
                lone = placement.lone_sigma or placement.centre_sigma
                self.read.append((way, at, error, placement.centre_sigma, lone))
                rest, torch = VehicleState(0.0, AT_REST), TorchEstimate(0.0, 0.0, 0.0)
                cycle = CrawlCycle(
                    phase, number, at - ahead, rest, AT_REST, torch, 0, 0, False, profile=profile
                )
                self.planner.see(cycle, placement)

    def weld(self, number: int, behind: float = 0.0) -> PlannedPass:
        """Plan a pass, and weld it with the torch some metres behind where it should be."""
        planned = self.planner.plan_pass(number)
        table = with_rows(self.job.passes[number - 1], planned.table)
        self.look(number, Phase.WELDING)
        for at in np.arange(0.0, self.job.weld.length, 0.5e-3).tolist():
            aside = float(table.table.at(np.array(at)).offset)
            self.metal.burn(at / 6e-3, at - behind, aside)
        self.metal.end_arc(table)
        self.look(number, Phase.RETURN)
        return planned


@pytest.mark.parametrize("behind", [0.0, 5e-3, -3e-3])
def test_the_first_bead_shows_how_far_behind_the_torch_is(job_file: Path, behind: float) -> None:
    """Tracks slip between where the laser sees a place and where the torch comes to it.

    With the run-up as long as the laser is ahead, it sees nothing before the weld.
    """
    led = LedWeld(read_crawl_job(job_file, TEN_PASSES), seed=1, begin=0.0)
    led.look(0, Phase.BACKWARD_ALIGNMENT)
    led.weld(1, behind)
    assert led.weld(2, behind).behind == pytest.approx(behind, abs=1.2e-3)


def test_neither_spatter_nor_an_unread_profile_hides_where_the_first_bead_ends(
    job_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Spatter beyond the end counts as it is long; a profile more is looked at than is needed."""
    job = read_crawl_job(job_file, TEN_PASSES)
    planner = CrawlPassPlanner(job, read_wps(WPS))
    show(planner, job, np.arange(-0.036, 0.040, 1e-3))
    beyond = [at for at, _, _ in planner._seen if at > job.weld.length + MOST_BEHIND]
    assert len(beyond) > 3
    planner._bare = list(planner._seen)

    def metal(seen: object, x: np.ndarray) -> np.ndarray:
        bead = np.where(x < job.weld.length - 5e-3, 28e-6, 0.0)
        bead[np.abs(x - job.weld.length - 9e-3) < 1.6e-3] = 20e-6  # spatter
        return bead if seen is planner._seen else np.zeros(len(x))

    monkeypatch.setattr(planner, "_metal_along", metal)
    assert planner._distance_behind() == pytest.approx(5e-3, abs=1.2e-3)


def test_where_the_first_bead_ends_is_unknown_if_nothing_was_seen_beyond(job_file: Path) -> None:
    job = read_crawl_job(job_file, TEN_PASSES)
    planner = CrawlPassPlanner(job, read_wps(WPS))
    show(planner, job, np.arange(-0.036, -0.004, 1e-3))
    assert max(at for at, _, _ in planner._seen) < job.weld.length
    planner._bare = list(planner._seen)
    planner._toes_u = np.tile((-8e-3, 8e-3), (len(planner.s), 1))
    assert planner._distance_behind() is None


def test_a_bead_far_from_where_the_torch_should_be_ends_the_crawl(job_file: Path) -> None:
    led = LedWeld(read_crawl_job(job_file, TEN_PASSES), seed=1)
    led.look(0, Phase.BACKWARD_ALIGNMENT)
    led.weld(1, 18e-3)
    with pytest.raises(CrawlStopped, match="laser_to_torch_mm"):
        led.planner.plan_pass(2)


@pytest.mark.parametrize("seed", [8, 11])
def test_the_joint_is_read_through_ten_planned_passes(job_file: Path, seed: int) -> None:
    """Beads of the cap hide one edge, then the other; the laser goes along without a vehicle."""
    led = LedWeld(job := read_crawl_job(job_file, TEN_PASSES), seed)
    led.look(0, Phase.BACKWARD_ALIGNMENT)
    for number in range(1, 11):
        led.weld(number)
    step, read = led.step, led.read
    ways, at, errors, sigmas, lone = np.transpose(read)
    for way in range(2, 21):  # nothing is left to weld when it goes back from the last pass
        gaps = np.diff(np.sort(np.append(at[ways == way], (0.0, 0.04))))
        assert gaps.max() - step < job.guards.blind_travel  # its last step brings a reading
    assert np.sqrt(np.mean(errors**2)) < 0.04e-3
    assert len(read) > 0.92 * led.looked
    assert 0.5 < np.mean((errors / sigmas) ** 2) < 2
    # Where a bead ends, or hides most of one side, none is surely wrong: of 2,000 readings some are
    # three standard deviations off by chance, and one that is four off the tracker itself refuses.
    far = (np.abs(errors) > 0.2e-3) & (np.abs(errors) > FARTHEST_SIGMAS * lone)
    assert not far.any()


class MovedLook:
    """A look at a joint whose middle has moved, and a journal of what is read."""

    def __init__(self) -> None:
        self.read = list[float]()

    def record(self, message: object) -> None:
        self.read += [message.d] if isinstance(message, CrawlCycle) else []

    def see(self, cycle: CrawlCycle, placement: JointPlacement) -> None: ...

    def middle_moved(self, at: float) -> float:
        return 0.2e-3 if at > 0 else 0.0

    def at_bead_end(self, at: float) -> bool:
        return 0.01 < at < 0.02


def test_a_joint_is_steered_along_as_when_it_was_bare_and_not_read_where_beads_end(
    job_file: Path,
) -> None:
    job, look = read_crawl_job(job_file), MovedLook()
    planner = CrawlPassPlanner(job, read_wps(WPS))
    planner._closed += np.where(planner.s > 0.01, 0.4e-3, 0.0)
    assert planner.middle_moved(0.02) == pytest.approx(0.2e-3)
    assert planner.middle_moved(0.2) == planner.middle_moved(-0.2) == 0.0
    cell = make_crawl_cell(job)
    with cell:
        devices = CrawlDevices(cell.vehicle, cell.laser, cell.torch, RememberingTracker())
        method = CrawlContext(job, job_file).make_method()
        corners = ProximitySensorPlaces(job.vehicle.body_length, job.vehicle.body_width)
        guards = Guards(job.guards, ProximityFilter(job.proximity), corners)
        cycle = ControlCycle(devices, method, guards, look, look)
        cycle.run(AT_REST)
        cycle.travel = 0.015 - devices.laser_to_torch
        cycle.run(AT_REST)
        cycle.travel = -1.0
        cycle.run(AT_REST)
        cycle.travel = 0.015 - devices.laser_to_torch
        cycle.phase = Phase.WELDING  # at rest, as while an arc is struck
        for _ in range(round(1.5 * job.guards.blind_time / VEHICLE_STATE_PERIOD)):
            cycle.run(AT_REST)
    moved, at_end, bare, *at_rest = look.read
    assert np.isnan([at_end, *at_rest]).all()
    look.read[:] = [moved, bare]
    assert [d for d, _ in cycle.joint.seen] == look.read  # as a resumed crawl compares them
    assert moved - bare == pytest.approx(0.2e-3, abs=0.06e-3)
