"""What the live page shows of a tow: while it goes on, and of its recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.frames import Array, pose, rot_z
from tjscan.job.tow.job import TowJob, read_tow_job
from tjscan.live.colours import (
    FITTED_COLOUR,
    LASER_COLOUR,
    NOMINAL_COLOUR,
    SOLID_COLOUR,
    TOOL_COLOUR,
)
from tjscan.live.drawables import BodyPose, Drawable, Lines
from tjscan.live.listening import Report, RunOnPage, show_run
from tjscan.live.page import Act, PageAddress, stop_button
from tjscan.live.step import STATE_FACT, Measure, Sample, SceneSetup, Step
from tjscan.recording.journal import RunEvent
from tjscan.result.directory import JOB_FILE
from tjscan.robot.settings import Cylinder, Solid
from tjscan.runs.tow.results import clearance_from_discs, vehicles_apart
from tjscan.towing.journal import TowCycle, TowTruth, read_tow
from tjscan.towing.seam import Seam

CABLE_CLEARANCE_MEASURE: Final = Measure("cable's clearance of obstacles", "mm")
VEHICLE_CLEARANCE_MEASURE: Final = Measure("vehicles' clearance", "mm")
LARGEST_BEND_MEASURE: Final = Measure("largest planned bend", "°")
OBJECTIVE_MEASURE: Final = Measure("objective", "of 100")
WELDER_FORCE_MEASURE: Final = Measure("force on the welder", "N")
VEHICLE_FORCE_MEASURE: Final = Measure("largest force of a vehicle", "N")

DRAWN_VEHICLE_HEIGHT: Final = 0.25
"""Metres, of a drawn vehicle."""
DRAWN_CABLE_HEIGHT: Final = 0.1
"""Metres above the floor at which the cable is drawn."""
VIEW_DISTANCE: Final = 1.7
"""From which the area is seen, in lengths of its longer side."""
SIDES_OF_DRAWN_OBSTACLE: Final = 40
"""Sides of a drawn obstacle."""
CYCLES_BETWEEN_PAGE_STEPS: Final = 2
"""Cycles of a recording between two steps."""


class TowShow:
    """Turns what a tow's journal receives into steps of the page; frame w, z up.

    Parameters
    ----------
    job : TowJob
    title : str
        Of the run.
    """

    def __init__(self, job: TowJob, title: str) -> None:
        self._job, self._chain, self._seam = job, job.chain, Seam(job.seam)
        self._began: float | None = None
        self.setting = self._make_scene_setup(title)

    def step_of_entry(self, entry: object) -> Step:
        """Return what one entry of the journal changes on the page."""
        match entry:
            case TowCycle():
                return self._cycle_step(entry)
            case TowTruth():
                return self._page_step_of_truth(entry)
            case RunEvent(name, detail):
                stopped = {STATE_FACT: f"stop: {detail}"} if name == "stop" else {}
                return Step(name, facts=stopped, events=((name, detail),))
        return Step()

    def _make_scene_setup(self, title: str) -> SceneSetup:
        job = self._job
        rings = (job.area.outline, *job.area.holes)
        walls = [_lift_to_height(np.array((*ring, ring[0])), height=0.0) for ring in rings]
        outline = np.array(job.area.outline)
        middle = np.array((*(0.5 * (outline.min(axis=0) + outline.max(axis=0))), 0.0))
        wide, deep = np.ptp(outline, axis=0)
        # The longer side is across the picture, and all of it in view.
        away = (0.0, -0.55, 0.85) if wide > deep else (-0.55, 0.0, 0.85)
        out = VIEW_DISTANCE * max(wide, deep)
        upright = pose(p=(0.0, 0.0, 0.5 * DRAWN_VEHICLE_HEIGHT))
        shape = Cylinder(job.vehicles.radius, DRAWN_VEHICLE_HEIGHT)
        names = [f"vehicle {k + 1}" for k in range(job.vehicles.count - 1)]
        seam = _lift_to_height(self._seam.path.points)
        clearances = CABLE_CLEARANCE_MEASURE, VEHICLE_CLEARANCE_MEASURE
        forces = WELDER_FORCE_MEASURE, VEHICLE_FORCE_MEASURE
        return SceneSetup(
            title,
            (LARGEST_BEND_MEASURE, *clearances, OBJECTIVE_MEASURE, *forces),
            "time / s",
            bodies={name: (Solid(name, shape, upright),) for name in (*names, "welder")},
            ghost=(
                Lines.through(*walls, colour=NOMINAL_COLOUR, width=2.0),
                Lines.through(seam, colour=LASER_COLOUR, width=2.5),
            ),
            look_at=middle,
            look_from=middle + out * np.array(away),
        )

    def _cycle_step(self, cycle: TowCycle) -> Step:
        self._began = cycle.time if self._began is None else self._began
        plan, time = cycle.plan, cycle.time - self._began
        estimate, planned = self._chain.line(plan.estimate), self._chain.line(plan.angles)
        discs, radius = cycle.obstacles[:, :3], self._job.vehicles.radius
        values = {
            LARGEST_BEND_MEASURE.name: float(np.degrees(np.abs(plan.angles).max())),
            OBJECTIVE_MEASURE.name: plan.terms.paper,
            VEHICLE_CLEARANCE_MEASURE.name: 1e3 * vehicles_apart(cycle.poses, radius, discs),
        }
        if len(discs):
            values[CABLE_CLEARANCE_MEASURE.name] = 1e3 * clearance_from_discs(estimate, discs)
        bodies = zip(self.setting.bodies, cycle.poses, strict=True)
        drawn: dict[str, Drawable] = {
            **{name: BodyPose(pose(rot_z(a), (x, y, 0.0))) for name, (x, y, a) in bodies},
            "cable": Lines.through(_lift_to_height(estimate), colour=TOOL_COLOUR, width=4.0),
            "planned": Lines.through(_lift_to_height(planned), colour=FITTED_COLOUR, width=2.0),
            "obstacles": Lines.through(*map(_disc_outline, discs), colour=SOLID_COLOUR, width=3.0),
        }
        facts, samples = self._cycle_facts(cycle, values), (Sample(time, values),)
        progress = min(cycle.along / self._seam.length, 1.0) if self._seam.length else None
        return Step(f"{time:.1f} s", drawn, facts, progress, samples)

    def _cycle_facts(self, cycle: TowCycle, values: dict[str, float]) -> dict[str, str]:
        state = f"waits: {cycle.wait}" if cycle.wait else "welding"
        nearest = values.get(CABLE_CLEARANCE_MEASURE.name)
        stopped = ", ".join(str(k + 1) for k in cycle.stopped)
        return {
            STATE_FACT: cycle.plan.halt or state,
            "along the seam": f"{1e3 * cycle.along:.0f} of {1e3 * self._seam.length:.0f} mm",
            "pace": f"{100 * cycle.pace:.0f} %",
            CABLE_CLEARANCE_MEASURE.name: "" if nearest is None else f"{nearest:.0f} mm",
            VEHICLE_CLEARANCE_MEASURE.name: f"{values[VEHICLE_CLEARANCE_MEASURE.name]:.0f} mm",
            "largest bend": f"{values[LARGEST_BEND_MEASURE.name]:.1f}°",
            "at its limits": ", ".join(cycle.plan.limits),
            "stopped vehicles": stopped,
        }

    def _page_step_of_truth(self, truth: TowTruth) -> Step:
        """What a simulation knows too: the true cable, and its forces."""
        cable = Lines.through(_lift_to_height(truth.line), colour=NOMINAL_COLOUR, width=2.0)
        values = {
            WELDER_FORCE_MEASURE.name: float(np.hypot(*truth.welder_force[:2])),
            VEHICLE_FORCE_MEASURE.name: float(truth.vehicle_forces.max(initial=0.0)),
        }
        return Step(
            drawn={"true cable": cable},
            facts={name: f"{force:.1f} N" for name, force in values.items()},
            samples=(Sample(truth.time - (self._began or 0.0), values),),
            events=[("touch", one) for one in truth.touches],
        )


def _lift_to_height(points: Array, height: float = DRAWN_CABLE_HEIGHT) -> Array:
    return np.column_stack((points[:, :2], np.full(len(points), height)))


def _disc_outline(disc: Array) -> Array:
    turn = np.linspace(0, 2 * np.pi, SIDES_OF_DRAWN_OBSTACLE + 1)
    return _lift_to_height(disc[:2] + disc[2] * np.column_stack((np.cos(turn), np.sin(turn))))


def read_tow_show(directory: Path) -> tuple[TowShow, Iterator[object]]:
    """Read what a tow's recording has to show; see `tjscan.live.step.ReplayReader`."""
    show = TowShow(read_tow_job(directory / JOB_FILE), directory.resolve().name)
    return show, _read_thinned_entries(directory)


def _read_thinned_entries(directory: Path) -> Iterator[object]:
    """Events, and of cycles and truths every second one."""
    seen = Counter[type]()
    for entry in read_tow(directory):
        seen[type(entry)] += 1
        if isinstance(entry, RunEvent) or seen[type(entry)] % CYCLES_BETWEEN_PAGE_STEPS == 1:
            yield entry


@contextmanager
def show_tow(
    job: TowJob, title: str, where: PageAddress, report: Report, interrupt: Act
) -> Iterator[RunOnPage]:
    """Show a tow while the block runs; for the parameters see `show_crawl`."""
    stop = stop_button(interrupt, "all vehicles")
    with show_run(TowShow(job, title), where, report, lambda _: stop) as run:
        show_planned(run, 0.0)
        yield run


def show_planned(run: RunOnPage, share: float) -> None:
    """Show how much of the seam is planned."""
    state = f"plans the whole seam before anything moves: {share:.0%}"
    run.record(Step(facts={STATE_FACT: state}, progress=share))
