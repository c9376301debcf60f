"""What the live page shows of a crawl: while it goes on, and of its recording."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.frames import pose, rot_z
from tjscan.crawler.journal import CrawlCycle, SimulatedPlace
from tjscan.crawler.phases import TRANSITIONS, Event, Phase
from tjscan.crawler.topics import CRAWL_RECORDING, CrawlProfile, read_crawl
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.live.colours import GHOST, LASER
from tjscan.live.diagram import StateDiagram
from tjscan.live.drawables import Drawable, Lines, MeasuredPiece, Placement, Surface
from tjscan.live.events import NotedEvent
from tjscan.live.step import STATE, Measure, PlaneCurve, RecordedShow, Sample, Setting, Step
from tjscan.recording.event import RecordedEvent
from tjscan.recording.parts import recording_files
from tjscan.result.directory import JOB
from tjscan.robot.solids import Box, Cylinder, Solid

DEVIATION: Final = Measure("torch beside its path", "mm")
OFFSET: Final = Measure("vehicle beside the joint", "mm")
SIGMA: Final = Measure("torch known to", "mm")
TORQUE: Final = Measure("largest torque", "N m")

HEIGHT: Final = 0.12
"""Metres, of the drawn body."""
GROUND: Final = 0.05
"""Metres by which it stands off the hull."""
SPACING: Final = 5e-3
"""Metres of travel that a drawn piece of weld is long."""
WIDTH: Final = 0.01
"""Metres, of the drawn weld."""
EVERY: Final = 0.25
"""Seconds of the vehicle's clock between two steps of a recording."""

CrawlEntry = CrawlCycle | CrawlProfile | NotedEvent


class CrawlShow:
    """Turns what a crawl's journal receives into steps of the page.

    In the picture x leads along the joint from where the weld begins, y to its left, z out of
    the hull; the vehicle stands where its method believes it to be.

    Parameters
    ----------
    job : CrawlJob
    title : str
        Of the run.
    """

    def __init__(self, job: CrawlJob, title: str) -> None:
        self._job, self._piece = job, 0
        self._last: tuple[int, float, float] | None = None
        self.setting = self._setting(title)

    def step(self, entry: CrawlEntry) -> Step:
        """Return what one entry of the journal changes on the page."""
        match entry:
            case CrawlCycle():
                return self._cycle_step(entry)
            case CrawlProfile():
                points = 1e3 * entry.profile.points_s
                return Step(profile=PlaneCurve(points[:, 0], points[:, 2]))
            case NotedEvent():
                return self._event_step(entry)

    def _event_step(self, event: NotedEvent) -> Step:
        """Events that a phase begins with bear its name: no cycle follows that of a stop."""
        news = ((event.name, event.detail),)
        if event.name not in set(Phase):
            return Step(event.name, events=news)
        facts = {STATE: event.name}
        return Step(event.name, facts=facts, events=news, diagram=phase_diagram(Phase(event.name)))

    def _setting(self, title: str) -> Setting:
        job, length = self._job, self._job.weld.length
        before = job.alignment.length + job.weld.run_up
        size = (job.vehicle.body_length, job.vehicle.body_width, HEIGHT)
        body = Solid("body", Box(size), pose(p=(0.0, 0.0, GROUND + 0.5 * HEIGHT)))
        torch = Solid("torch", Cylinder(0.012, 0.25), pose(p=(0.0, 0.0, 0.125)))
        ends = np.array([(-before, 0.0, 0.0), (length + job.weld.run_up, 0.0, 0.0)])
        weld = np.array([(0.0, 0.0, 0.0), (length, 0.0, 0.0)])
        wide = np.array((0.0, 0.6, -1e-3))
        hull = np.vstack((ends - wide, (ends + wide * (1, 1, -1))[::-1]))
        middle = np.array((0.5 * (length - before), 0.0, 0.0))
        away = length + before + 2 * job.vehicle.body_length
        return Setting(
            title,
            (DEVIATION, OFFSET, SIGMA, TORQUE),
            "along the joint / mm",
            see_through=("vehicle",),
            bodies={"vehicle": (body,), "torch": (torch,)},
            ghost=(
                Surface(hull, np.array([(0, 1, 2), (0, 2, 3)]), GHOST, 0.35),
                Lines.through(ends, colour=GHOST, width=1.5),
                Lines.through(weld, colour=LASER, width=2.0),
            ),
            look_at=middle,
            look_from=middle + away * np.array((-0.35, -0.9, 0.7)),
        )

    def _cycle_step(self, cycle: CrawlCycle) -> Step:
        torch, state = cycle.torch, cycle.state
        at = cycle.travel, -(torch.offset + cycle.torch_y), 0.0
        values = {
            DEVIATION.name: 1e3 * cycle.deviation,
            OFFSET.name: 1e3 * torch.offset,
            SIGMA.name: 1e3 * torch.sigma,
        }
        if state.torques:
            values[TORQUE.name] = max(map(abs, state.torques))
        drawn: dict[str, Drawable] = {
            "vehicle": Placement(pose(rot_z(-torch.heading), (cycle.travel, -torch.offset, 0.0))),
            "torch": Placement(pose(p=at)),
        }
        samples: tuple[Sample, ...] = ()
        if cycle.arc and (welded := self._welded(cycle, values)):
            drawn.update(welded)
            samples = (Sample(1e3 * cycle.travel, values),)
        return Step(
            f"{cycle.phase}, {1e3 * cycle.travel:.0f} mm",
            drawn,
            self._facts(cycle),
            self._share_done(cycle),
            samples,
            diagram=phase_diagram(cycle.phase),
        )

    def _facts(self, cycle: CrawlCycle) -> dict[str, str]:
        reading = f"{1e3 * cycle.d:+.2f} ± {1e3 * cycle.d_sigma:.2f} mm" if cycle.was_read else "no"
        proximity = [value for value in cycle.state.proximity if isfinite(value)]
        nearest = {"nearest corner": f"{1e3 * min(proximity):.0f} mm"} if proximity else {}
        return {
            STATE: str(cycle.phase),
            "pass": f"{cycle.number} of {len(self._job.passes)}" if cycle.number else "",
            "along the joint": f"{1e3 * cycle.travel:.0f} of {1e3 * self._job.weld.length:.0f} mm",
            "speed": f"{1e3 * cycle.state.odometry.speed:.1f} mm/s",
            "joint read": reading,
            "arc": "burns" if cycle.arc else "off",
            **nearest,  # not in every cycle
            "fault": cycle.state.fault,
        }

    def _share_done(self, cycle: CrawlCycle) -> float | None:
        if cycle.phase is not Phase.WELDING or not cycle.number:
            return None
        along = min(max(cycle.travel / self._job.weld.length, 0.0), 1.0)
        return (cycle.number - 1 + along) / len(self._job.passes)

    def _welded(self, cycle: CrawlCycle, values: dict[str, float]) -> dict[str, Drawable]:
        """The weld since the last piece, once it is long enough; passes lie on one another."""
        y = -(cycle.torch.offset + cycle.torch_y)
        number, x0, y0 = self._last or (cycle.number, cycle.travel, y)
        if number != cycle.number or self._last is None:
            self._last = cycle.number, cycle.travel, y
            return {}
        if abs(cycle.travel - x0) < SPACING:
            return {}
        self._last, self._piece = (cycle.number, cycle.travel, y), self._piece + 1
        z, half = 4e-3 * cycle.number, 0.5 * WIDTH
        strip = [(x0, y0 - half, z), (x0, y0 + half, z)]
        strip += [(cycle.travel, y - half, z), (cycle.travel, y + half, z)]
        triangles = np.array([(0, 1, 2), (1, 3, 2)])
        piece = MeasuredPiece(np.empty((0, 3)), np.array(strip), triangles, values)
        return {f"weld/{self._piece}": piece}


def phase_diagram(now: Phase) -> StateDiagram:
    """The phases and what leads from one to another, the present one marked."""
    ways = [
        (str(phase), str(after), str(event))
        for (phase, event), after in TRANSITIONS.items()
        if event is not Event.DANGER
    ]
    return StateDiagram(tuple(map(str, Phase)), tuple(ways), str(now), str(Phase.STOP))


def read_crawl_show(directory: Path) -> RecordedShow | None:
    """Read what a crawl's recording has to show; see `tjscan.live.step.ShowReader`."""
    if not recording_files(directory, CRAWL_RECORDING)[0].is_file():
        return None
    show = CrawlShow(read_crawl_job(directory / JOB), directory.resolve().name)
    return RecordedShow(show.setting, tuple(map(show.step, _entries(directory))))


def _entries(directory: Path) -> Iterator[CrawlEntry]:
    """Events, and a cycle with its profile now and then."""
    due, with_profile = -np.inf, False
    for entry in read_crawl(directory):
        match entry:
            case CrawlCycle() if entry.state.time >= due:
                due, with_profile = entry.state.time + EVERY, True
                yield entry
            case CrawlProfile() if with_profile:
                with_profile = False
                yield entry
            case RecordedEvent():
                yield NotedEvent(entry.name, entry.detail)
            case CrawlCycle() | CrawlProfile() | SimulatedPlace():
                pass
