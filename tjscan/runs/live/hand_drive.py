"""Driving a crawler by hand from its page: as long as a button is held, and no longer."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from threading import Event
from typing import Final

from tjscan.job.crawl.job import CrawlJob
from tjscan.vehicle.vehicle import REST, Twist

HELD: Final = 0.3
"""Seconds for which the page's last word that a button is held counts; the page repeats it 20 times
a second. It leaves the rest of a vehicle's `DEAD_MAN` to brake in."""
CYCLE: Final = 0.01
"""Seconds between two orders at least: a simulated vehicle waits for nothing."""


class PageHandDrive:
    """A `HandDrive` whose orders are buttons of the page that are held.

    It hears that a button is held again and again, and not that it is released: a page that is
    closed, a browser that dies and a network that fails say nothing, and so stop the vehicle too.
    Buttons that contradict each other, held in two browsers, stop it as well.

    Parameters
    ----------
    speed : float
        To drive at, m/s.
    curvature : float
        Of the turns, 1/m.
    clock : callable, optional
        Gives seconds.
    wait : callable, optional
        Waits for as many seconds.
    """

    def __init__(
        self,
        speed: float,
        curvature: float,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], object] = time.sleep,
    ) -> None:
        turn = speed * curvature
        self._twists = {
            "Hold: forward": Twist(speed, 0.0),
            "Hold: forward, left": Twist(speed, -turn),
            "Hold: forward, right": Twist(speed, turn),
            "Hold: back": Twist(-speed, 0.0),
        }
        self._heard = dict.fromkeys(self._twists, float("-inf"))
        self._clock, self._wait, self._last = clock, wait, float("-inf")
        self._begun = Event()

    @classmethod
    def of_job(cls, job: CrawlJob) -> PageHandDrive:
        """Drive as slowly as the crawler aligns, and turn as tightly as its motors may."""
        return cls(job.alignment.speed, 1 / job.steering.least_radius)

    @property
    def words(self) -> Sequence[str]:
        """Words of the buttons that drive."""
        return tuple(self._twists)

    def start(self) -> None:
        """Let the crawl begin: nobody drives by hand any more."""
        self._begun.set()

    def hear(self, word: str) -> None:
        """Note that a button is held."""
        self._heard[word] = self._clock()

    def order(self) -> Twist | None:
        """Return what is asked for now; see `HandDrive.order`."""
        self._wait(max(0.0, self._last + CYCLE - self._clock()))
        self._last = now = self._clock()
        if self._begun.is_set():
            return None
        held = [word for word, heard in self._heard.items() if now - heard < HELD]
        return self._twists[held[0]] if len(held) == 1 else REST
