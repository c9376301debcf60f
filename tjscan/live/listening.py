"""A run on the page while it goes on: entries of its journal become steps, in a thread apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from queue import Full, Queue
from threading import Event, Thread
from typing import Any, Final

from tjscan.core.errors import PageUnavailable
from tjscan.live.page import Button, Page, PageAddress
from tjscan.live.step import STATE_FACT, Show, Step, merge_steps
from tjscan.recording.journal import RunEvent

Report = Callable[[str], object]
"""Receives messages, each a sentence."""

FEED_CAPACITY: Final = 512
"""Entries that wait for the page; what comes while it is full is not shown."""
PAGE_DRAW_INTERVAL: Final = 0.05
"""Seconds between two looks: the page changes 20 times a second at most."""
CLOSING_TIMEOUT: Final = 2.0
"""Seconds that the end of a run leaves the page to show what is waiting."""


class LiveFeed:
    """Bounded queue between a run and its page, emptied by a thread of its own.

    Parameters
    ----------
    show : callable
        Shows entries, all that came since the last time at once. If it raises, the page is
        dead: `report` hears of it once, and entries are dropped from then on.
    report : callable
        Receives messages, each a sentence.
    """

    def __init__(self, show: Callable[[list[Any]], None], report: Report) -> None:
        self._show, self._report = show, report
        self._waiting: Queue[object] = Queue(FEED_CAPACITY)
        self._over, self.dropped, self.is_dead = Event(), 0, False
        self._thread = Thread(target=self._show_entries, name="live page", daemon=True)
        self._thread.start()

    def post_entry(self, entry: object) -> None:
        """Hand an entry over at once; drop it if the page is dead or does not keep up."""
        if self.is_dead:
            return
        try:
            self._waiting.put_nowait(entry)
        except Full:
            self.dropped += 1

    def close(self) -> None:
        """Show what is waiting, if that takes no longer than `CLOSING_TIMEOUT`, and end."""
        self._over.set()
        self._thread.join(CLOSING_TIMEOUT)
        if self.dropped:
            self._report(f"the page did not keep up: {self.dropped} entries are missing from it")

    def _show_entries(self) -> None:
        while True:
            over = self._over.wait(PAGE_DRAW_INTERVAL)
            entries = [self._waiting.get_nowait() for _ in range(self._waiting.qsize())]
            try:
                if entries:
                    self._show(entries)
            except Exception as error:  # whatever it is, the run goes on
                self.is_dead = True
                self._report(f"the page is dead, the run goes on without: {error!r}")
                return
            if over:
                return


class RunOnPage:
    """A run that is shown while it goes on, a journal of it; see `show_run`.

    Parameters
    ----------
    page : Page or None
        None if there can be none: everything is dropped then.
    show : Show
    report : callable
        Receives, in a sentence, what becomes of the page.
    """

    def __init__(self, page: Page | None, show: Show, report: Report) -> None:
        self.page, self._show = page, show
        self._started, self._how_it_ended = Event(), ""
        self._feed = None if page is None else LiveFeed(self._draw_entries, report)

    def record(self, message: object) -> None:
        """Show a message of the run's journal, or a step; never waits."""
        if self._feed is not None:
            self._feed.post_entry(message)

    def show_state(self, state: str) -> None:
        """Show what the run is doing, in a few words."""
        self.record(Step(facts={STATE_FACT: state}))

    def check_page(self) -> None:
        """Check that there is a page to press Start in.

        Raises
        ------
        PageUnavailable
            If not.
        """
        if self.page is None:
            raise PageUnavailable("there is no page to press Start in: leave out --wait")

    def start(self) -> None:
        """Let the run that waits for the start go on."""
        self._started.set()

    def wait_for_start(self) -> None:
        """Wait until Start is pressed.

        Raises
        ------
        PageUnavailable
            If there is no page to press it in.
        """
        self.check_page()
        self.show_state("waiting for Start")
        self._started.wait()

    def close(self) -> None:
        """Show what is waiting, and end."""
        if self._feed is not None and self.page is not None:
            self._feed.close()
            with suppress(Exception):  # whatever it is, the run is over
                self.page.show_end(self._how_it_ended)

    def _draw_entries(self, entries: Sequence[object]) -> None:
        if self.page is not None:
            for event in (one for one in entries if isinstance(one, RunEvent)):
                self._how_it_ended = f"{event.name}, {event.detail}"
            steps = [
                one if isinstance(one, Step) else self._show.step_of_entry(one) for one in entries
            ]
            self.page.show_step(merge_steps(steps))


@contextmanager
def show_run(
    show: Show,
    where: PageAddress,
    report: Report,
    buttons: Callable[[RunOnPage], Sequence[Button]],
    before: Callable[[], Iterable[Step]] = tuple,
) -> Iterator[RunOnPage]:
    """Show a run on a page while the block runs; it goes on without if there is none.

    Parameters
    ----------
    show : Show
        What is shown of it.
    where : PageAddress
    report : callable
        Receives the page's address, or why there is none.
    buttons : callable
        Gives the page's buttons.
    before : callable
        Gives what is shown from the beginning.
    """
    try:
        page = Page([show.setting], where)
    except Exception as error:  # whatever it is, the run goes on
        report(f"there is no live page: {error}")
        yield RunOnPage(None, show, report)
        return
    report(f"live page: {page.url}")
    with page:
        run = RunOnPage(page, show, report)
        try:
            page.add_buttons(buttons(run))
            try:
                run.record(merge_steps([Step(), *before()]))
            except Exception as error:  # whatever it is, the run goes on
                report(f"what was there before is not on the page: {error}")
            yield run
        finally:
            run.close()
