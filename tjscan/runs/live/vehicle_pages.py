"""Crawls and tows on the live page, with a Stop that does what Ctrl-C does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Final

from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.topics import CrawlProfile
from tjscan.job.crawl.job import CrawlJob
from tjscan.job.tow.job import TowJob
from tjscan.laser.profile import Profile
from tjscan.live.buttons import Button, HoldButton, PageButton
from tjscan.live.events import NotedEvent
from tjscan.live.listening import RunOnPage, show_run
from tjscan.live.page import PageAddress
from tjscan.live.step import PRESS, Step
from tjscan.runs.live.crawl import CrawlEntry, CrawlShow
from tjscan.runs.live.hand_drive import PageHandDrive
from tjscan.runs.live.tow import TowEntry, TowShow
from tjscan.towing.journal import TowCycle, TowTruth

EVERY: Final = 0.05
"""Seconds of the vehicle's clock between two cycles that are handed to the page."""
START: Final = "Start"


class CrawlPageJournal:
    """A crawl's journal that hands cycles and profiles to the page now and then, and all events.

    Parameters
    ----------
    run : RunOnPage
    """

    def __init__(self, run: RunOnPage[CrawlEntry]) -> None:
        self._run, self._due = run, float("-inf")

    def record_cycle(self, cycle: CrawlCycle, profile: Profile | None) -> None:
        """Show a cycle, if the last one is a while ago."""
        if cycle.state.time < self._due:
            return
        self._due = cycle.state.time + EVERY
        self._run.post(cycle)
        if profile is not None:
            self._run.post(CrawlProfile(cycle, profile))

    def record_event(self, name: str, detail: str) -> None:
        """Show an event."""
        self._run.post(NotedEvent(name, detail))


class TowPageJournal:
    """A tow's journal that hands everything to the page, and what a simulation knows beside.

    Parameters
    ----------
    run : RunOnPage
    """

    def __init__(self, run: RunOnPage[TowEntry]) -> None:
        self._run = run

    def record_cycle(self, cycle: TowCycle) -> None:
        """Show a cycle."""
        self._run.post(cycle)

    def show_truth(self, truth: TowTruth) -> None:
        """Show the cable as it lies, and its forces."""
        self._run.post(truth)

    def record_event(self, name: str, detail: str) -> None:
        """Show an event."""
        self._run.post(NotedEvent(name, detail))


def stop_button(interrupt: Callable[[], object], what: str) -> Sequence[Button]:
    """The button of all vehicles.

    Parameters
    ----------
    interrupt : callable
        Does what Ctrl-C does.
    what : str
        Is stopped.
    """
    return [Button("STOP", interrupt, "red", f"As Ctrl-C: stop {what} at once", big=True)]


@contextmanager
def show_crawl(
    job: CrawlJob,
    title: str,
    where: PageAddress,
    report: Callable[[str], object],
    interrupt: Callable[[], object],
    hand: PageHandDrive | None = None,
) -> Iterator[CrawlPageJournal]:
    """Show a crawl while the block runs; gives the journal that shows it.

    Parameters
    ----------
    job : CrawlJob
    title : str
        Of the run.
    where : PageAddress
    report : callable
        Is told the page's address, or why there is none.
    interrupt : callable
        Does what Ctrl-C does.
    hand : PageHandDrive, optional
        Who drives by hand on it before the crawl begins.

    Raises
    ------
    PageUnavailable
        If there is no page, and somebody is to drive on it.
    """

    def buttons(run: RunOnPage[CrawlEntry]) -> Sequence[PageButton]:
        stop = stop_button(interrupt, "the crawler")
        return stop if hand is None else [*stop, *hand_drive_buttons(run, hand)]

    with show_run(CrawlShow(job, title), where, report, buttons) as run:
        if hand is not None:
            run.check_page()
        yield CrawlPageJournal(run)


def hand_drive_buttons(run: RunOnPage[CrawlEntry], hand: PageHandDrive) -> Sequence[PageButton]:
    """Buttons that drive a crawler while they are held, and Start, which takes them away.

    Parameters
    ----------
    run : RunOnPage
    hand : PageHandDrive
    """

    def start() -> None:
        hand.start()
        if run.page is not None:
            run.page.enable(dict.fromkeys((START, *hand.words), False))
        run.post(Step(facts={PRESS: ""}))

    run.post(Step(facts={PRESS: "Start, or hold a button to drive"}))
    hint = "Drives slowly while it is held; released, or gone with the page, the crawler stops"
    held = [HoldButton(word, partial(hand.hear, word), hint=hint) for word in hand.words]
    return [Button(START, start, "green", "Let the crawl begin"), *held]


@contextmanager
def show_tow(
    job: TowJob,
    title: str,
    where: PageAddress,
    report: Callable[[str], object],
    interrupt: Callable[[], object],
) -> Iterator[TowPageJournal]:
    """Show a tow while the block runs; for the parameters see `show_crawl`."""

    def buttons(_: RunOnPage[TowEntry]) -> Sequence[Button]:
        return stop_button(interrupt, "all vehicles")

    with show_run(TowShow(job, title), where, report, buttons) as run:
        run.say("plans the whole seam before anything moves")
        yield TowPageJournal(run)
