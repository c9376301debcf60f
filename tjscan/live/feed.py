"""From a run to its page, without the run ever waiting."""

from __future__ import annotations

from collections.abc import Callable
from queue import Full, Queue
from threading import Event, Thread
from typing import Any, Final

FEED_CAPACITY: Final = 512
"""Entries that wait for the page; what comes while it is full is not shown."""
DRAW_INTERVAL: Final = 0.05
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

    def __init__(self, show: Callable[[list[Any]], None], report: Callable[[str], object]) -> None:
        self._show, self._report = show, report
        self._waiting: Queue[object] = Queue(FEED_CAPACITY)
        self._over, self.dropped, self.is_dead = Event(), 0, False
        self._thread = Thread(target=self._show_entries, name="live page", daemon=True)
        self._thread.start()

    def post(self, entry: object) -> None:
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
            over = self._over.wait(DRAW_INTERVAL)
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
