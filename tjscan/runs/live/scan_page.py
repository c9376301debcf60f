"""A scan on the live page, with buttons that pause, step and stop it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tjscan.live.buttons import Button
from tjscan.live.drawables import Posture
from tjscan.live.events import NotedEvent
from tjscan.live.listening import RunOnPage, show_run
from tjscan.live.page import PageAddress
from tjscan.live.step import Step
from tjscan.result.directory import RECORDING
from tjscan.runs.context import RunContext
from tjscan.runs.live.scan import ScanEntry, ScanShow, recorded_entries
from tjscan.scanning.section import ProfileView, ScannedSection
from tjscan.scanning.stopping import StopRequest


class PageJournal:
    """Journal that hands everything to the page and waits for nothing.

    Parameters
    ----------
    run : RunOnPage
        The scan on the page.
    total : int or None
        Sections to scan, where that is known.
    clock : callable
        Gives seconds.
    """

    def __init__(
        self,
        run: RunOnPage[ScanEntry],
        total: int | None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.run, self._total, self._clock = run, total, clock
        self._first: tuple[int, float] | None = None

    def record_view(self, view: ProfileView) -> None:
        """Show where the arm stands and what the laser saw."""
        self.run.post(view)

    def record_section(self, section: ScannedSection) -> None:
        """Show a finished section, and how long the rest takes at the pace until now."""
        self.run.post(section)
        number, now = section.view.index, self._clock()
        first, began = self._first = self._first or (number, now)
        if self._total is not None and number > first:
            left = (now - began) / (number - first) * max(self._total - 1 - number, 0)
            self.run.post(Step(facts={"time left": f"{left // 60:.0f} min {left % 60:02.0f} s"}))

    def record_event(self, name: str, detail: str) -> None:
        """Show an event; for the parameters see `Journal.record_event`."""
        self.run.post(NotedEvent(name, detail))


@contextmanager
def show_scan(
    context: RunContext,
    where: PageAddress,
    report: Callable[[str], object],
    interrupt: Callable[[], object],
    resumed: Path | None = None,
) -> Iterator[PageJournal]:
    """Show a scan on a page while the block runs; gives the journal that shows it.

    Parameters
    ----------
    context : RunContext
        The job, of one station if it has any, and what pauses its scan.
    where : PageAddress
    report : callable
        Is told the page's address, or why there is none.
    interrupt : callable
        Does what Ctrl-C does.
    resumed : Path, optional
        Directory of the run that is gone on with: what was scanned before is shown too.
    """

    def buttons(run: RunOnPage[ScanEntry]) -> Sequence[Button]:
        return scan_buttons(run, context.stop, interrupt)

    def before() -> Iterator[Step]:
        simulation = context.job.simulation
        if simulation is not None and simulation.arm is not None:
            yield Step(drawn={"arm": Posture(np.array(simulation.arm.home))})
        if resumed is not None and (resumed / RECORDING).is_file():
            yield from map(show.step, recorded_entries(resumed, context))

    show = ScanShow(context, context.job_file.stem)
    with show_run(show, where, report, buttons, before) as run:
        yield PageJournal(run, show.total)


def scan_buttons(
    run: RunOnPage[ScanEntry], stop: StopRequest, interrupt: Callable[[], object]
) -> list[Button]:
    """Buttons of a scan: Start, which goes on too, Pause, Step and Stop.

    Parameters
    ----------
    run : RunOnPage
    stop : StopRequest
        Of the scan.
    interrupt : callable
        Does what Ctrl-C does.
    """

    def start() -> None:
        stop.go_on()
        run.start()
        run.say("scanning")

    def pause() -> None:
        stop.pause()
        run.say("pausing after the section under way")

    def step() -> None:
        stop.go_one_step()
        run.start()
        run.say("scanning one section")

    def end() -> None:
        run.say("stopping after the section under way; Stop once more stops the arm at once")
        interrupt()

    return [
        Button("Start", start, "green", "Begin, or go on after a pause"),
        Button("Pause", pause, "yellow", "Stand after the section under way"),
        Button("Step", step, "blue", "Scan one section, then stand"),
        Button("Stop", end, "red", "As Ctrl-C: end after the section; twice, stop the arm at once"),
    ]
