"""What the live page shows of a scan, while it runs and from its recording."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Final

import numpy as np

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, transform_points
from tjscan.groove.measured import MeasuredSection, section_to_result_frame
from tjscan.job.cell import kinematics_of_job, solids_in_base
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.live.colours import FITTED_COLOUR, LASER_COLOUR, NOMINAL_COLOUR
from tjscan.live.drawables import ArmPosture, Drawable, Lines, MeasuredPiece, Surface
from tjscan.live.listening import Report, RunOnPage, show_run
from tjscan.live.page import Act, Button, PageAddress
from tjscan.live.step import STATE_FACT, Measure, PlaneCurve, Sample, SceneSetup, Step
from tjscan.recording.journal import RunEvent
from tjscan.recording.parts import recording_files
from tjscan.result.directory import JOB_FILE, RECORDING_FILE
from tjscan.result.section import absent_corners
from tjscan.result.wireframe import joint_wireframe
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job, result_frame_of_job
from tjscan.scanning.journal import grid_triangles
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.recording import read_recording_entries
from tjscan.scanning.section import ProfileView, ScannedSection, Substep
from tjscan.scanning.sections_before import read_section
from tjscan.scanning.stopping import StopRequest

CORNER_DEVIATION_MEASURE: Final = Measure("deviation", "mm")
GROOVE_ANGLE_MEASURE: Final = Measure("groove angle", "°")
ROOT_OPENING_MEASURE: Final = Measure("root opening", "mm")
GROOVE_DEPTH_MEASURE: Final = Measure("depth", "mm")
CORNER_SIGMA_MEASURE: Final = Measure("sigma of the corners", "mm")
"""By the profile's noise alone: what all sections share is in the report's budget."""

ARM_STILL_EVENTS: Final = ("paused", "stop", "failed", "interrupted", "complete")
"""Events after which the arm does not move."""

LASER_FAN_POINTS: Final = 32
"""Of the laser's drawn fan."""


@dataclass(frozen=True, slots=True)
class UnreadSection:
    """A recorded section, as it was then, whose profile is not read with the settings of now."""

    section: ScannedSection


class ScanShow:
    """Turns what a scan's journal receives into steps of the page.

    Parameters
    ----------
    context : ScanContext
        The job, of one station if it has any.
    title : str
        Of the run.

    Attributes
    ----------
    total : int or None
        Sections that the job asks for, if it does.
    """

    def __init__(self, context: ScanContext, title: str) -> None:
        self._frame = result_frame_of_job(context.job)
        self._last_b: Array | None = None
        self._section_before: ScannedSection | None = None
        self._joint = context.joint if self._frame.T_b_j is not None else None
        self._edges = None if self._joint is None else feature_edges(self._joint)
        self.total = context.job.scan.expected_sections
        self.setting = self._make_scene_setup(context.job, title)

    def _make_scene_setup(self, job: ScanJob, title: str) -> SceneSetup:
        measures = (
            GROOVE_ANGLE_MEASURE,
            ROOT_OPENING_MEASURE,
            GROOVE_DEPTH_MEASURE,
            CORNER_SIGMA_MEASURE,
        )
        look_at, look_from = self._camera_target_and_place(job.scan)
        known = self._joint is not None
        return SceneSetup(
            title,
            (CORNER_DEVIATION_MEASURE, *measures) if known else measures,
            "clock position, 12 at the crown" if known else "section",
            known,
            kinematics_of_job(job),
            solids_in_base(job),
            tuple(one.solid for one in job.clearance.tool),
            ghost=tuple(self._designed_joint_lines()),
            look_at=look_at,
            look_from=look_from,
        )

    def step_of_entry(self, entry: object) -> Step:
        """Return what one entry of the journal changes on the page."""
        match entry:
            case ProfileView():
                return self._page_step_of_view(entry)
            case ScannedSection():
                return self._page_step_of_section(entry)
            case UnreadSection(section):
                label = f"section {section.view.index}"
                return Step(label, self._groove_piece_to_draw(section.view, section.points_b, {}))
            case RunEvent(name, detail):
                state = {STATE_FACT: f"{name}: {detail}"} if name in ARM_STILL_EVENTS else {}
                return Step(name, facts=state, events=((name, detail),))
        return Step()

    def _page_step_of_view(self, view: ProfileView) -> Step:
        label = f"section {view.index}, {view.substep}"
        drawn = {"arm": ArmPosture(view.q), **laser_fan_to_draw(view)}
        follows = view.substep in (Substep.PASSING, Substep.FUSED)
        doing = "following the groove" if follows else label
        facts = {"doing": doing, "arm's clock": f"{view.time:.1f} s"}
        return Step(label, drawn, facts, profile=PlaneCurve.along_groove(view.profile))

    def _page_step_of_section(self, section: ScannedSection) -> Step:
        groove, view, done = section.groove, section.view, section.view.index + 1
        T_r_s = self._frame.T_r_b @ view.T_b_s
        measured = section_to_result_frame(groove, T_r_s, self._frame.letter, index=view.index)
        values, sigmas = self._values_of(measured)
        x = view.index if np.isnan(measured.azimuth) else np.degrees(measured.azimuth) % 360 / 30
        facts = {
            "sections": f"{done} of {max(self.total, done)}" if self.total else f"{done}",
            "groove": ", ".join((groove.model, *groove.conditions)),
        }
        before, self._section_before = self._section_before, section
        if view.substep is Substep.FUSED and before is not None:
            gone = float(np.linalg.norm(section.T_b_g[:3, 3] - before.T_b_g[:3, 3]))
            passed = view.time - before.view.time
            if passed > 0:
                facts["speed"] = f"{1e3 * gone / passed:.0f} mm/s along the groove"
        for measure in (CORNER_DEVIATION_MEASURE, GROOVE_ANGLE_MEASURE, ROOT_OPENING_MEASURE):
            if measure is not CORNER_DEVIATION_MEASURE or self._joint is not None:
                facts[measure.name] = _value_in_words(measure, values, sigmas)
        drawn = self._groove_piece_to_draw(view, section.points_b, values)
        drawn["fitted"] = Lines.through(section.points_b, colour=FITTED_COLOUR, width=3.0)
        progress = None if self.total is None else min(done / self.total, 1.0)
        samples = (Sample(float(x), values, sigmas),)
        profile = PlaneCurve.along_groove(view.profile, groove.points_s)
        return Step(f"section {view.index}", drawn, facts, progress, samples, profile)

    def _values_of(self, section: MeasuredSection) -> tuple[dict[str, float], dict[str, float]]:
        """Values of the measures and their standard deviations, millimetres and degrees."""
        names = GROOVE_ANGLE_MEASURE.name, ROOT_OPENING_MEASURE.name, GROOVE_DEPTH_MEASURE.name
        units = np.array((180 / np.pi, 1e3, 1e3))
        values, sigmas = (
            dict(zip(names, (units * known[:3]).tolist(), strict=True))
            for known in (section.measures, section.sigmas)
        )
        if np.isfinite(section.root_opening):
            values[ROOT_OPENING_MEASURE.name] = 1e3 * float(section.root_opening)
        corner_sigma = 1e3 * float(np.max(section.corner_sigmas))
        values[CORNER_SIGMA_MEASURE.name] = corner_sigma
        if self._edges is not None:
            absent = absent_corners([section])
            off = corner_to_edge_distances(section.points[None], self._edges, absent)
            largest = float(np.nanmax(off)) if np.isfinite(off).any() else np.nan
            values[CORNER_DEVIATION_MEASURE.name] = 1e3 * largest
            sigmas[CORNER_DEVIATION_MEASURE.name] = corner_sigma
        return values, sigmas

    def _groove_piece_to_draw(
        self, view: ProfileView, points_b: Array, values: dict[str, float]
    ) -> dict[str, Drawable]:
        last, self._last_b = self._last_b, points_b
        vertices, triangles = np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
        if last is not None:
            vertices, triangles = np.concatenate((last, points_b)), grid_triangles(2, len(points_b))
        seen_b = transform_points(view.T_b_s, view.profile.points_s)
        return {f"groove/{view.index}": MeasuredPiece(seen_b, vertices, triangles, values)}

    def _designed_joint_lines(self) -> Iterator[Lines | Surface]:
        T_b_j = self._frame.T_b_j
        if self._joint is None or T_b_j is None:
            return
        lines = [transform_points(T_b_j, line) for line in joint_wireframe(self._joint)]
        yield Lines.through(*lines[:3], colour=NOMINAL_COLOUR, width=2.0)  # the groove's edges
        yield Lines.through(*lines[3:], colour=NOMINAL_COLOUR, width=1.0)

    def _camera_target_and_place(self, plan: ScanPlan) -> tuple[Array, Array]:
        """Middle of the picture, and whence it is seen: over the taught pose, beside the arm."""
        T_b_j, first = self._frame.T_b_j, plan.first
        flange = np.array((0.8, 0.0, 0.4)) if first is None else first.T[:3, 3]
        at = flange * (0.7, 0.7, 0.5) if T_b_j is None else T_b_j[:3, 3] + (0.0, 0.0, 0.2)
        out = (flange - at) * (1.0, 1.0, 0.0)
        size = max(float(np.linalg.norm(at[:2])), 0.5)
        out *= 1.25 * size / max(float(np.linalg.norm(out)), 1e-6)
        at = at * (0.8, 0.8, 1.0)  # towards the arm's base, which is in the picture too
        return at, at + out + (0.0, 0.0, 1.1 * size)


def laser_fan_to_draw(view: ProfileView) -> dict[str, Drawable]:
    """The laser's plane, from the sensor to what it saw; and the profile."""
    points = view.profile.points_s
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        return {"profile": Lines(np.empty((0, 2, 3)), LASER_COLOUR)}
    thin = points[np.linspace(0, len(points) - 1, LASER_FAN_POINTS).round().astype(int)]
    seen_b = transform_points(view.T_b_s, thin)
    k = np.arange(1, len(thin))
    fan = np.concatenate((view.T_b_s[None, :3, 3], seen_b))
    return {
        "laser": Surface(fan, np.column_stack((np.zeros_like(k), k, k + 1)), LASER_COLOUR, 0.18),
        "profile": Lines.through(seen_b, colour=LASER_COLOUR, width=3.0),
    }


def _value_in_words(measure: Measure, values: dict[str, float], sigmas: dict[str, float]) -> str:
    """A value with its standard deviation; empty if it is not known."""
    value, sigma = values.get(measure.name, np.nan), sigmas.get(measure.name, np.nan)
    if not np.isfinite(value):
        return ""
    spread = f" ± {sigma:.3f}" if np.isfinite(sigma) else ""
    return f"{value:.3f}{spread} {measure.unit}"


def read_scan_show(directory: Path) -> tuple[ScanShow, Iterator[object]]:
    """Read what a scan's recording has to show; see `tjscan.live.step.ReplayReader`."""
    job_file = directory / JOB_FILE
    context = ScanContext(read_scan_job(job_file), job_file).at_station()
    return ScanShow(context, directory.resolve().name), read_scan_entries(directory, context)


def read_scan_entries(directory: Path, context: ScanContext) -> Iterator[object]:
    """Yield views, sections and events of a run; sections are read again for their measures."""
    read = groove_reader_of_job(context.job)
    found: list[ScannedSection] = []
    for file in recording_files(directory):
        for _, entry in read_recording_entries(file, lambda _: None):
            match entry:
                case ScannedSection():
                    try:
                        found.append(read_section(read, entry.view, entry.T_s_t, found))
                        yield found[-1]
                    except GrooveNotFound:
                        yield UnreadSection(entry)
                case ProfileView() | RunEvent():
                    yield entry


class ScanPageJournal:
    """Journal that hands everything to the page and waits for nothing.

    Parameters
    ----------
    run : RunOnPage
        The scan on the page.
    total : int or None
        Sections to scan, if that is known.
    """

    def __init__(self, run: RunOnPage, total: int | None) -> None:
        self.run, self._total = run, total
        self._first: tuple[int, float] | None = None

    def record(self, message: object) -> None:
        """Show a message; of a section also how long the rest takes at the pace until now."""
        self.run.record(message)
        if not isinstance(message, ScannedSection):
            return
        number, now = message.view.index, monotonic()
        first, began = self._first = self._first or (number, now)
        if self._total is not None and number > first:
            left = (now - began) / (number - first) * max(self._total - 1 - number, 0)
            self.run.record(Step(facts={"time left": f"{left // 60:.0f} min {left % 60:02.0f} s"}))


@contextmanager
def show_scan(
    context: ScanContext,
    where: PageAddress,
    report: Report,
    interrupt: Act,
    resumed: Path | None = None,
) -> Iterator[ScanPageJournal]:
    """Show a scan on a page while the block runs; gives the journal that shows it.

    Parameters
    ----------
    context : ScanContext
        The job, of one station if it has any, and what pauses its scan.
    where : PageAddress
    report : callable
        Receives the page's address, or why there is none.
    interrupt : callable
        Does what Ctrl-C does.
    resumed : Path, optional
        Directory of the run that is gone on with: what was scanned before is shown too.
    """

    def before() -> Iterator[Step]:
        simulation = context.job.simulation
        if simulation is not None and simulation.arm is not None:
            yield Step(drawn={"arm": ArmPosture(np.array(simulation.arm.home))})
        if resumed is not None and (resumed / RECORDING_FILE).is_file():
            yield from map(show.step_of_entry, read_scan_entries(resumed, context))

    show = ScanShow(context, context.job_file.stem)
    buttons = partial(scan_buttons, stop=context.stop, interrupt=interrupt)
    with show_run(show, where, report, buttons, before) as run:
        yield ScanPageJournal(run, show.total)


def scan_buttons(run: RunOnPage, stop: StopRequest, interrupt: Act) -> list[Button]:
    """Buttons of a scan: Start, which goes on too, Pause, Step and Stop.

    Parameters
    ----------
    run : RunOnPage
    stop : StopRequest
        Of the scan.
    interrupt : callable
        Does what Ctrl-C does.
    """

    def press(state: str, *actions: Act) -> Act:
        def show_and_act() -> None:
            run.show_state(state)
            for act in actions:
                act()

        return show_and_act

    start = press("scanning", stop.go_on, run.start)
    pause = press("pausing after the section under way", stop.pause)
    step = press("scanning one section", stop.go_one_step, run.start)
    words = "stopping after the section under way; another Stop stops the arm at once"
    hint = "As Ctrl-C: end after the section; twice, stop the arm at once"
    return [
        Button("Start", start, "green", "Begin, or go on after a pause"),
        Button("Pause", pause, "yellow", "Wait after the section under way"),
        Button("Step", step, "blue", "Scan one section, then wait"),
        Button("Stop", press(words, interrupt), "red", hint),
    ]
