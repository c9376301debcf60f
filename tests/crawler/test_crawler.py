"""The loop of a crawl, with devices that go wrong."""

import re
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from crawls import SHORT

from tjscan.core.errors import CrawlStopped, GrooveNotFound, VehicleLinkLost, VehicleStopped
from tjscan.crawler.contradiction import ContradictionWatch
from tjscan.crawler.crawler import (
    MOST_OFFSET_AT_REVERSAL,
    UNREAD_HERE,
    Crawler,
    CrawlStart,
)
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.crawler.plan import AlignmentSettings
from tjscan.crawler.torch_axes import SimulatedTorchAxes
from tjscan.job.crawl.cell import make_crawl_cell
from tjscan.job.crawl.job import read_crawl_job
from tjscan.laser.profile import Profile
from tjscan.recording.journal import RunEvent
from tjscan.runs.crawl.run import CrawlContext, make_crawler
from tjscan.vehicle.vehicle import AT_REST, Twist, VehicleState


class Notes:
    """A journal that keeps cycles and events in memory."""

    def __init__(self) -> None:
        self.cycles: list[CrawlCycle] = []
        self.events: list[str] = []
        self.texts: list[str] = []

    def record(self, message: object) -> None:
        match message:
            case CrawlCycle():
                self.cycles.append(replace(message, profile=None))
            case RunEvent():
                self.events.append(message.name)
                self.texts.append(message.detail)


class WrongVehicle:
    """A vehicle whose states are changed on their way."""

    def __init__(self, vehicle: Any, change: Callable[[VehicleState], VehicleState]) -> None:
        self._vehicle, self._change = vehicle, change

    def __getattr__(self, name: str) -> Any:
        return getattr(self._vehicle, name)

    def next_state(self) -> VehicleState:
        return self._change(self._vehicle.next_state())


class StandingClock:
    """A change after which all states are dated as the first of them."""

    time: float | None = None

    def __call__(self, state: VehicleState) -> VehicleState:
        self.time = state.time if self.time is None else self.time
        return replace(state, time=self.time)


class WrongLaser:
    """A laser whose profiles are changed on their way, by what it gave so far."""

    def __init__(self, laser: Any, change: Callable[[list[Profile]], Profile]) -> None:
        self._laser, self._change = laser, change
        self.given: list[Profile] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._laser, name)

    def capture(self) -> Profile:
        self.given.append(self._laser.capture())
        return self._change(self.given)


def context(tmp_path: Path, offset: str = "offset_mm = 20") -> CrawlContext:
    file = tmp_path / "short.toml"
    # As short as it goes: the joint at once, no way out, no run-up.
    text = SHORT.replace("run_up_mm = 30", "run_up_mm = 0").replace("[-30.0, 1.0]", "[0.0, 0.1]")
    file.write_text(text.replace("offset_mm = 20", offset))
    return CrawlContext(read_crawl_job(file), file)


@pytest.mark.parametrize(
    ("change", "guard"),
    [
        (lambda state: replace(state, odometry=Twist(0.0, 0.0)), "not moving"),
        (lambda state: replace(state, proximity=()), "proximity"),
        (lambda state: replace(state, time=state.time + 100), "clock"),
        (lambda state: replace(state, time=nan), "clock"),
        (StandingClock(), "clock"),
    ],
)
def test_a_fault_under_the_arc_ends_arc_and_motion(
    tmp_path: Path, change: Callable[[VehicleState], VehicleState], guard: str
) -> None:
    found, notes = context(tmp_path), Notes()
    cell = make_crawl_cell(found.job)

    def change_under_arc(state: VehicleState) -> VehicleState:
        return change(state) if "arc on" in notes.events else state

    wrong = replace(cell, vehicle=WrongVehicle(cell.vehicle, change_under_arc))
    with cell:
        with pytest.raises(CrawlStopped) as caught:
            make_crawler(found, wrong, found.make_method(), notes).run()
        assert not cell.torch.arc
    assert caught.value.guard == guard
    assert "return" not in notes.events  # nothing is told to be welded
    assert sum(cycle.arc for cycle in notes.cycles) < 130


@pytest.mark.parametrize(("off", "bends"), [(2.5e-3, []), (6e-3, []), (6e-3, [0.1, 0.7])])
def test_little_knowledge_does_not_make_a_torch_far_off_aligned(
    off: float, bends: list[float]
) -> None:
    told: list[str] = []
    far = off > MOST_OFFSET_AT_REVERSAL
    crawler: Any = SimpleNamespace(
        _plan=SimpleNamespace(alignment=AlignmentSettings(offset_sigma=6e-3)),
        _cycle=SimpleNamespace(travel=2.0, phase="forward", bends=bends),
        _method=SimpleNamespace(torch=TorchEstimate(off, 5e-3, 0.0)),
        _report=lambda _, text: told.append(text),
    )
    with pytest.raises(CrawlStopped, match="off the joint") if far else nullcontext():
        Crawler._align_forward(crawler, 0.0)
    assert any("2.5 mm off the joint" in text for text in told) != far


@pytest.mark.parametrize(("bends", "goes_on"), [([], False), ([0.1], False), ([0.1, 1.5], True)])
def test_from_a_bend_on_the_longest_way_counts_anew(bends: list[float], goes_on: bool) -> None:
    class GoesOn(Exception):
        """It drives another cycle."""

    def drive(speed: float) -> None:
        raise GoesOn

    crawler: Any = SimpleNamespace(
        _plan=SimpleNamespace(alignment=AlignmentSettings(longest=1.2)),
        _cycle=SimpleNamespace(travel=2.0, phase="forward", bends=bends, drive=drive),
        _method=SimpleNamespace(torch=TorchEstimate(6e-3, 1e-3, 0.0)),
    )
    with pytest.raises(GoesOn if goes_on else CrawlStopped):
        Crawler._align_forward(crawler, 0.0)


def blind(profiles: list[Profile]) -> Profile:
    return replace(profiles[-1], z_s=profiles[-1].z_s * nan)


def frozen(profiles: list[Profile]) -> Profile:
    return replace(profiles[100], time=profiles[-1].time)


def in_turn(profiles: list[Profile]) -> Profile:
    return replace(profiles[100 + len(profiles) % 2], time=profiles[-1].time)


def late(profiles: list[Profile]) -> Profile:
    return profiles[-12]


def of_tomorrow(profiles: list[Profile]) -> Profile:
    return replace(profiles[-1], time=profiles[-1].time + 86400)


@pytest.mark.parametrize("wrong", [blind, frozen, in_turn, late, of_tomorrow])
def test_what_is_no_profile_of_now_never_steers(
    tmp_path: Path, wrong: Callable[[list[Profile]], Profile]
) -> None:
    found, notes = context(tmp_path), Notes()
    cell = make_crawl_cell(found.job)

    def change_under_arc(profiles: list[Profile]) -> Profile:
        return wrong(profiles) if "arc on" in notes.events else profiles[-1]

    devices = replace(cell, laser=WrongLaser(cell.laser, change_under_arc))
    with cell, pytest.raises(CrawlStopped) as caught:
        make_crawler(found, devices, found.make_method(), notes).run()
    # A picture of another place looks like a knock; that it is not read is what matters here.
    assert caught.value.guard in ("joint lost", "knocked aside", "laser frozen")
    burning = [cycle for cycle in notes.cycles if cycle.arc]
    assert not any(cycle.was_read for cycle in burning[1:])
    assert burning[-1].travel - burning[0].travel < found.job.guards.blind_travel + 1e-3
    assert ("old profile" in notes.events) == (wrong in (late, of_tomorrow))


def test_motors_that_must_give_more_than_they_have_are_stopped(tmp_path: Path) -> None:
    file = tmp_path / "heavy.toml"
    file.write_text(SHORT + "[simulation.vehicle.pads]\nmass_kg = 500\ndown_deg = 180\n")
    found, notes = CrawlContext(read_crawl_job(file), file), Notes()
    cell = make_crawl_cell(found.job)  # heavier than its sizing says, on a joint that climbs
    with cell, pytest.raises(CrawlStopped, match="123 N m, more than 84") as caught:
        make_crawler(found, cell, found.make_method(), notes).run()
    assert caught.value.guard == "torque"


def test_a_torch_that_fails_on_a_stop_hides_no_stop(tmp_path: Path) -> None:
    found, notes = context(tmp_path), Notes()
    cell = make_crawl_cell(found.job)

    class BrokenTorch(SimulatedTorchAxes):
        def set_arc(self, *, burning: bool) -> None:
            raise VehicleLinkLost("the torch is gone")

    broken = replace(cell, torch=BrokenTorch(0.03, 0.1))
    with cell:
        with pytest.raises(VehicleLinkLost):
            make_crawler(found, broken, found.make_method(), notes).run()
        with pytest.raises(VehicleStopped):
            cell.vehicle.command(AT_REST)
    assert notes.events[-1] == "stop"


def test_an_operator_is_asked_while_the_vehicle_stands(tmp_path: Path) -> None:
    found, notes = context(tmp_path), Notes()
    cell = make_crawl_cell(found.job)

    class SlowOperator:
        """Takes ten seconds of the vehicle's clock to answer."""

        def confirm_weld(self, number: int, assumed: str, *, looks: bool = False) -> bool:
            last = notes.cycles[-1]
            assert last.commanded == AT_REST
            assert abs(last.state.odometry.speed) < 1e-3
            for _ in range(1000):
                cell.vehicle.next_state()
            return True

        def confirm_torch(self) -> bool:
            return True

    asked = replace(found, operator=SlowOperator())
    with cell:
        make_crawler(asked, cell, found.make_method(), notes).run()
    along = [cycle.travel for cycle in notes.cycles]
    assert max(abs(b - a) for a, b in pairwise(along)) < 1e-3


@pytest.mark.parametrize(
    ("knock", "told", "guard"),
    [
        (0.0, r"assumed that the joint bends by .* mm to the right from 47. to 7.. mm", "torch"),
        (2e-3, r"knocked .* It was assumed that the joint bends by .* from 47. to 7.. mm", "knock"),
    ],
)
def test_a_bend_is_told_as_an_assumption_at_ready_and_by_a_stop(
    tmp_path: Path, knock: float, told: str, guard: str
) -> None:
    """A joint goes 3 mm aside in 80 mm, and the vehicle is knocked where it was followed."""
    longer = SHORT.replace("length_mm = 50", "length_mm = 150").replace("= 100", "= 200")
    (file := tmp_path / "short.toml").write_text(longer)
    found, notes, asked = CrawlContext(read_crawl_job(file), file), Notes(), list[str]()
    cell = make_crawl_cell(found.job)

    class Refuses:
        """Asked about a bend, and gives up."""

        def confirm_weld(self, number: int, assumed: str, *, looks: bool = False) -> bool:
            asked.append(assumed)
            raise CrawlStopped("torch", f"pass {number}")

        def confirm_torch(self) -> bool:
            return True

    def going_aside(profiles: list[Profile]) -> Profile:
        assert cell.world is not None
        into = min(max(cell.world.torch_place()[0] / 0.08, 0.0), 1.0)
        off = 3e-3 * into**2 * (3 - 2 * into)
        if any("may bend" in text for text in notes.texts) and notes.cycles[-1].travel > 0.08:
            off -= knock
        return replace(profiles[-1], x_s=profiles[-1].x_s + off)

    refusing, laser = replace(found, operator=Refuses()), cell.laser
    devices = replace(cell, laser=WrongLaser(laser, going_aside))
    with cell, pytest.raises(CrawlStopped) as caught:
        make_crawler(refusing, devices, found.make_method(), notes).run()
    assert caught.value.guard.startswith(guard)
    assert any(re.search(told, text) for text in notes.texts)
    assert [text for text in asked if not text.startswith("the joint bends by ")] == []
    assert len(asked) == (guard == "torch")


def test_a_bend_is_followed_in_the_alignment_alone_and_not_at_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After it the vehicle drives out and back again, which tells a slide from a bend."""
    (file := tmp_path / "short.toml").write_text(SHORT)
    short, asked = CrawlContext(read_crawl_job(file), file), set[tuple[Phase, bool, bool]]()
    cell = make_crawl_cell(short.job)
    with cell:
        crawler = make_crawler(short, cell, short.make_method(), Notes())
        add = ContradictionWatch.add

        def remember(watch: ContradictionWatch, twist: Twist, *given: Any, **named: Any) -> None:
            follows = named["follow_bend"] is not None
            asked.add((crawler._cycle.phase, twist == AT_REST, follows))
            add(watch, twist, *given, **named)

        monkeypatch.setattr(ContradictionWatch, "add", remember)
        crawler.run()
    aligns = {Phase.FORWARD_ALIGNMENT, Phase.BACKWARD_ALIGNMENT}
    assert {Phase.READY, Phase.WELDING, Phase.RETURN, *aligns} <= {phase for phase, *_ in asked}
    assert {phase for phase, _, follows in asked if follows} == aligns
    assert not any(rests and follows for _, rests, follows in asked)


@pytest.mark.parametrize(
    ("jump", "sigma", "stops"),
    [(0.4e-3, 0.0, True), (0.4e-3, 0.12e-3, False), (1.2e-3, 0.12e-3, True)],
)
def test_an_unsure_reading_tells_of_a_jump_by_less(
    tmp_path: Path, jump: float, sigma: float, stops: bool
) -> None:
    """By a bead's toe the joint is read aside for millimetres."""
    short = context(tmp_path)
    cell, reader = make_crawl_cell(short.job), short.make_reader()

    class Jumping:
        """A reader by which the joint is aside for 6 mm of the weld."""

        def read(self, profile: Profile, travel: float) -> JointPlacement:
            found = reader.read(profile, travel)
            aside = jump * (0.005 < travel < 0.011)
            unsure = max(found.centre_sigma, sigma)
            return replace(
                found, centre=found.centre + aside, centre_sigma=unsure, lone_sigma=sigma
            )

    guard = ""
    with cell:
        try:
            make_crawler(short, cell, short.make_method(), Notes(), Jumping()).run()
        except CrawlStopped as stop:
            guard = stop.guard
    assert (guard in ("knocked aside", "joint jumped")) == stops


@pytest.mark.parametrize(
    ("start", "hidden", "says"),
    [
        (None, False, "waits for steel below every corner"),
        (None, True, "waits for the joint in view"),
        (CrawlStart(1), True, f"waits for the joint in view{UNREAD_HERE}"),
    ],
)
def test_it_says_what_it_waits_for(
    tmp_path: Path, start: CrawlStart | None, hidden: bool, says: str
) -> None:
    found, told = context(tmp_path), []

    class Unread:
        """A reader that the weld hides the joint from."""

        def read(self, profile: Profile, travel: float) -> JointPlacement:
            raise GrooveNotFound("no bevel", "the edges are gone", np.empty((0, 2)))

    class EndsWhenTold(Notes):
        def record(self, message: object) -> None:
            if isinstance(message, RunEvent):
                told.append(message.detail)
                raise KeyboardInterrupt

    cell = make_crawl_cell(found.job)
    missing = WrongVehicle(cell.vehicle, lambda state: replace(state, proximity=(nan,) * 4))
    reader = Unread() if hidden else None
    with cell, pytest.raises(KeyboardInterrupt):
        make_crawler(
            found, replace(cell, vehicle=missing), found.make_method(), EndsWhenTold(), reader
        ).run(start)
    assert told[0] == says
