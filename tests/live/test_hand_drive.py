"""A crawler driven by hand from its page: whatever ends the holding of a button stops it."""

import socket
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event, Thread

import pytest
from _live_client import page_client
from crawls import SHORT

from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.phases import Phase
from tjscan.job.crawl.cell import make_crawl_cell
from tjscan.job.crawl.job import read_crawl_job
from tjscan.live.page import HELD_BUTTON_RATE, Button, Page, PageAddress, press_in_time
from tjscan.live.step import SceneSetup
from tjscan.runs.crawl.run import CrawlContext, make_crawler
from tjscan.runs.live.crawl import BUTTON_HOLD_LIFETIME, LEAST_DRIVE_ORDER_INTERVAL, PageHandDrive
from tjscan.vehicle.vehicle import AT_REST, DEAD_MAN_TIME, Twist, VehicleState

SPEED, CURVATURE = 0.02, 0.125
FORWARD = "Hold: forward"
LONGEST = 60.0
"""Seconds for which it waits to be driven."""


class Clock:
    """A clock that stands until it is waited for."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def wait(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def hand(clock: Clock) -> PageHandDrive:
    return PageHandDrive(SPEED, CURVATURE, clock, clock.wait)


def test_it_drives_while_it_hears_that_a_button_is_held(hand: PageHandDrive, clock: Clock) -> None:
    assert hand.order() == AT_REST
    driven = []
    for word in hand.button_words:
        hand.note_held(word)
        driven.append(hand.order())
        clock.wait(BUTTON_HOLD_LIFETIME)
        assert hand.order() == AT_REST
    turn = SPEED * CURVATURE
    assert driven == [Twist(SPEED, 0), Twist(SPEED, -turn), Twist(SPEED, turn), Twist(-SPEED, 0)]


def test_two_that_contradict_each_other_stop_it(hand: PageHandDrive) -> None:
    for word in hand.button_words[:2]:
        hand.note_held(word)
    assert hand.order() == AT_REST


def test_holds_that_were_held_up_and_come_at_once_drive_no_longer(
    hand: PageHandDrive, clock: Clock
) -> None:
    press = press_in_time(partial(hand.note_held, FORWARD), clock)
    for _ in range(20):  # as they are sent
        press()
        assert hand.order() == Twist(SPEED, 0)
        clock.wait(1 / HELD_BUTTON_RATE)
    clock.wait(BUTTON_HOLD_LIFETIME)
    moved: list[int] = []
    for burst in (press, press_in_time(partial(moved.append, 1), clock)):
        for _ in range(40):
            burst()
            clock.wait(5e-3)
    assert len(moved) == 1
    clock.wait(BUTTON_HOLD_LIFETIME)
    assert hand.order() == AT_REST


def test_once_begun_nothing_held_is_heard(hand: PageHandDrive) -> None:
    hand.start_crawl()
    hand.note_held(FORWARD)
    assert hand.order() is None


def test_a_simulated_clock_does_not_outrun_the_hand(hand: PageHandDrive, clock: Clock) -> None:
    for _ in range(101):
        hand.order()
    assert clock.now == pytest.approx(100 * LEAST_DRIVE_ORDER_INTERVAL)


class StopsOnceItStands:
    """A journal that begins the crawl once the vehicle has been driven and stands again."""

    def __init__(self, hand: PageHandDrive) -> None:
        self._hand, self.drives = hand, Event()
        self.cycles: list[CrawlCycle] = []
        self.heard_at = 0.0

    def note_held(self) -> None:
        """Hand on that the button is held; note when, by the vehicle's clock."""
        self.heard_at = self.cycles[-1].state.time
        self._hand.note_held(FORWARD)

    def record(self, cycle: object) -> None:
        if not isinstance(cycle, CrawlCycle):
            return
        self.cycles.append(replace(cycle, profile=None))
        if cycle.state.odometry.speed > 0.5 * SPEED:
            self.drives.set()
        elif self.drives.is_set() and abs(cycle.state.odometry.speed) < 1e-3:
            self._hand.start_crawl()
        if cycle.phase is not Phase.MANUAL or cycle.state.time > LONGEST:
            raise KeyboardInterrupt


def hold_until_it_drives(page: Page, drives: Event) -> None:
    """Hold the button as a browser does, until the vehicle drives; then die without a word."""
    with page_client(page) as client:
        client.receive()
        client.look()
        while not drives.is_set():
            client.hold(FORWARD)
            time.sleep(1 / HELD_BUTTON_RATE)
        client.socket.socket.shutdown(socket.SHUT_RDWR)


def test_a_browser_that_is_lost_stops_it_in_half_a_second(tmp_path: Path) -> None:
    file = tmp_path / "short.toml"
    file.write_text(SHORT)
    job = read_crawl_job(file)
    hand = PageHandDrive.of_job(job)
    notes, cell = StopsOnceItStands(hand), make_crawl_cell(job)
    context = CrawlContext(job, file, notes, hand=hand)
    button = Button(FORWARD, lambda: notes.note_held(), held=True)
    with Page([SceneSetup("crawler")], PageAddress(port=0)) as page, cell:
        page.add_buttons([button])
        browser = Thread(target=partial(hold_until_it_drives, page, notes.drives))
        browser.start()
        with pytest.raises(KeyboardInterrupt):
            make_crawler(context, cell, context.make_method(), notes).run()
        browser.join()
    driven = [cycle for cycle in notes.cycles if cycle.commanded != AT_REST]
    assert {cycle.phase for cycle in driven[:-1]} == {Phase.MANUAL}
    assert {cycle.travel for cycle in driven[:-1]} == {driven[0].travel}  # no way along the joint
    after = [cycle for cycle in notes.cycles if cycle.state.time > notes.heard_at]
    stands = next(c for c in after if abs(c.state.odometry.speed) < 1e-3)
    assert stands.state.time - notes.heard_at < DEAD_MAN_TIME


def test_driven_by_hand_it_forgets_where_it_was_and_not_how_it_slips(tmp_path: Path) -> None:
    file = tmp_path / "short.toml"
    file.write_text(SHORT)
    job = read_crawl_job(file)
    for name in ("slip-aware", "paper"):
        method = CrawlContext(job.model_copy(update={"method": name}), file).make_method()
        first, at_first = method.torch, method.slip
        for _ in range(20):
            method.read(0.01, 1e-4)
            method.move(VehicleState(0.0, Twist(SPEED, 0.002)), 0.01, Twist(SPEED, 0.002))
        assert method.torch != first
        method.forget_place()
        assert replace(method.torch, sigma=0.0) == replace(first, sigma=0.0)
        assert method.torch.sigma == pytest.approx(first.sigma)
        assert (method.slip is None) == (at_first is None)
