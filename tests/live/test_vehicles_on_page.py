"""Crawls and tows on the page: what a cycle shows, and a Stop that is Ctrl-C."""

import socket
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from cells import EXAMPLES
from command import tjscan
from crawls import SHORT

from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.job.crawl.job import read_crawl_job
from tjscan.job.tow.cell import TowCell
from tjscan.job.tow.job import read_tow_job
from tjscan.laser.profile import Profile
from tjscan.live.access import LOOPBACK_ADDRESS
from tjscan.live.drawables import BodyPose, Lines, MeasuredPiece
from tjscan.live.listening import RunOnPage
from tjscan.live.page import Page, PageAddress, Replay, stop_button
from tjscan.live.step import STATE_FACT, RecordedShow, SceneSetup
from tjscan.recording.journal import RunEvent
from tjscan.runs.live.crawl import TORCH_DEVIATION_MEASURE, CrawlPageJournal, CrawlShow
from tjscan.runs.live.tow import CABLE_CLEARANCE_MEASURE, TowShow
from tjscan.runs.tow.results import clearance_from_discs, vehicles_apart
from tjscan.runs.tow.run import TowContext
from tjscan.towing.journal import TowCycle, TowTruth
from tjscan.towing.shape.plan import PlanTerms, TowingPlan
from tjscan.vehicle.vehicle import AT_REST, VehicleState

CRAWL, TOW = EXAMPLES / "crawl.toml", EXAMPLES / "tow-yard.toml"


def crawl_cycle(travel: float, *, time: float = 0.0, right: float = 0.002) -> CrawlCycle:
    """A cycle of the first pass, welding, its torch so far to the right of its path."""
    torch = TorchEstimate(right, 0.0005, 0.01)
    state = VehicleState(time, AT_REST, (12.0, -30.0), (0.2, 0.3, nan, 0.4))
    return CrawlCycle(Phase.WELDING, 1, travel, state, AT_REST, torch, 0.0, 0.0, True, 0.01, 0.001)


def test_a_crawl_shows_where_the_vehicle_is_and_what_is_welded() -> None:
    show = CrawlShow(read_crawl_job(CRAWL), "crawl")
    steps = [show.step_of_entry(crawl_cycle(x)) for x in (0.0, 0.001, 0.02, 0.04)]
    places = [step.drawn["vehicle"] for step in steps]
    assert [one.T[:2, 3].tolist() for one in places if isinstance(one, BodyPose)] == [
        [x, -0.002] for x in (0.0, 0.001, 0.02, 0.04)
    ]
    welded = [thing for step in steps for thing in step.drawn.values()]
    pieces = [piece for piece in welded if isinstance(piece, MeasuredPiece)]
    assert [piece.values[TORCH_DEVIATION_MEASURE.name] for piece in pieces] == pytest.approx(
        [2.0, 2.0]
    )
    facts = steps[-1].facts
    assert facts[STATE_FACT] == "welding"
    assert facts["nearest corner"] == "200 mm"
    assert facts["arc"] == "burns"
    facts = {**facts, **show.step_of_entry(RunEvent(Phase.STOP, "a drive fails")).facts}
    assert facts[STATE_FACT] == "stop"
    assert not facts["arc"]
    assert not facts["speed"]
    diagram = steps[-1].diagram
    assert diagram is not None
    assert diagram.now == "welding"


def test_a_crawl_hands_over_twenty_cycles_a_second() -> None:
    show = CrawlShow(read_crawl_job(CRAWL), "crawl")

    class Counted(RunOnPage):
        count = 0

        def record(self, message: object) -> None:
            self.count += isinstance(message, CrawlCycle)

    run = Counted(None, show, print)
    journal, nothing = CrawlPageJournal(run), Profile(np.empty(0), np.empty(0))
    for k in range(200):
        journal.record(replace(crawl_cycle(1e-4 * k, time=0.01 * k), profile=nothing))
    assert 38 <= run.count <= 42


def test_a_tow_shows_cable_vehicles_clearance_and_forces() -> None:
    job = read_tow_job(TOW)
    count, links = job.vehicles.count, job.chain.links
    angles, poses = np.zeros(links), np.zeros((count, 3))
    plan = TowingPlan(
        angles, angles, np.zeros((links, 3)), poses, PlanTerms(1.0, 2.0, 3.0), 0.0, ("bend",)
    )
    line = job.chain.line(angles)
    beside = np.array([[*(line[links // 2] + (0.0, 1.0)), 0.2, 0.0, 0.0]])
    pairs = np.zeros((count, 2))
    cycle = TowCycle(5.0, 0.1, 1.0, poses, poses, pairs, poses, poses, beside, plan, 0.01, 0.1)
    show = TowShow(job, "tow")
    step = show.step_of_entry(cycle)
    assert show.setting.bodies.keys() <= step.drawn.keys()
    cable = step.drawn["cable"]
    assert isinstance(cable, Lines)
    assert len(cable.segments) == links
    assert step.samples[0].values[CABLE_CLEARANCE_MEASURE.name] == pytest.approx(800, rel=0.02)
    truth = TowTruth(5.0, line, poses, np.array((3.0, 4.0, 0.0)), np.zeros(count), beside[:, :3])
    facts = show.step_of_entry(truth).facts
    assert facts["force on the welder"] == "5.0 N"
    assert facts["largest force of a vehicle"] == "0.0 N"


def test_what_a_simulated_tow_records_of_the_truth_is_shown_too() -> None:
    class Cell:
        truth: Any = staticmethod(lambda: "truth")

    shown: list[object] = []
    context = TowContext(read_tow_job(TOW), TOW, show_truth=shown.append)
    truth = context.truth_of(cast(TowCell, Cell()))
    assert truth is not None
    assert [truth(), *shown] == ["truth", "truth"]
    Cell.truth = None
    assert context.truth_of(cast(TowCell, Cell())) is None


def test_clearance_is_to_the_rim_of_the_nearest_disc() -> None:
    line = np.array([(0.0, 0.0), (1.0, 0.0)])
    assert clearance_from_discs(
        line, np.array([(1.0, 2.0, 0.5), (5.0, 0.0, 1.0)])
    ) == pytest.approx(1.5)


def test_vehicles_are_apart_from_rim_to_rim() -> None:
    poses = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 2.0), (4.0, 0.0, 1.0)])
    assert vehicles_apart(poses, 0.2, np.empty((0, 3))) == pytest.approx(0.6)
    assert vehicles_apart(poses, 0.2, np.array([(4.0, 1.0, 0.5)])) == pytest.approx(0.3)
    assert vehicles_apart(poses[:1], 0.2, np.empty((0, 3))) == np.inf


def test_a_stop_is_shown_in_state_and_diagram() -> None:
    show = CrawlShow(read_crawl_job(CRAWL), "crawl")
    step = show.step_of_entry(RunEvent("stop", "interrupted"))
    assert step.diagram is not None
    assert step.diagram.now == step.facts[STATE_FACT] == "stop"
    assert show.step_of_entry(RunEvent("arc on", "pass 1")).diagram is None
    tow = TowShow(read_tow_job(TOW), "tow")
    assert tow.step_of_entry(RunEvent("stop", "interrupted")).facts == {
        STATE_FACT: "stop: interrupted"
    }


def test_the_slider_hides_a_state_of_later() -> None:
    show = CrawlShow(read_crawl_job(CRAWL), "crawl")
    steps = (
        show.step_of_entry(RunEvent("warning", "short")),
        show.step_of_entry(RunEvent("stop", "danger")),
    )
    replay = Replay([RecordedShow(show.setting, steps)], PageAddress(port=0))
    with replay.page:
        panel = replay.page.views[0].panel
        for number, shown in ((1, True), (0, False), (1, True)):
            replay.move_to_step(number)
            assert panel.diagram.visible is shown


def test_stop_is_pressed_once_for_each_click() -> None:
    pressed: list[str] = []
    (button,) = stop_button(lambda: pressed.append("Ctrl-C"), "the crawler")
    with Page([SceneSetup("stop")], PageAddress(port=0)) as page:
        page.add_buttons([button])
        button.press()
    assert pressed == ["Ctrl-C"]


@pytest.mark.parametrize("words", [("crawl", "run", CRAWL), ("tow", "run", TOW)])
def test_options_of_the_page_need_the_page(words: tuple[object, ...]) -> None:
    assert tjscan(*words, "--port", 0) == 2


def test_only_a_new_crawl_waits_and_only_for_a_page(tmp_path: Path) -> None:
    (tmp_path / "job.toml").write_text(SHORT)
    assert tjscan("crawl", "run", tmp_path, "--resume", "--live", "--wait") == 2
    with socket.create_server((LOOPBACK_ADDRESS, 0)) as taken:
        port, out = taken.getsockname()[1], tmp_path / "run"
        words = ("crawl", "run", tmp_path / "job.toml", "--out", out, "--live", "--wait")
        assert tjscan(*words, "--port", port) == 1
    assert not out.exists()
