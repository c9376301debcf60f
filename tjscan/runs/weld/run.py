"""Weld, look, plan again, weld on: from a job to a weld and its log."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, LookRefused, WeldStopped
from tjscan.core.frames import Array, Mask, inverse_pose, stretches_of_true_values
from tjscan.job.cell import joint_surface, make_cell
from tjscan.job.files import read_scan_job
from tjscan.job.weld import WeldJob
from tjscan.laser.drivers import SimulatedScene
from tjscan.laser.optics import RaycastSurface
from tjscan.planning.edges import fit_groove_edges
from tjscan.planning.path import GrooveStations, cut_groove_stations
from tjscan.planning.wps import WeldingProcedure, read_wps
from tjscan.power.drivers import PowerDriverInputs
from tjscan.power.sequence import ArcFault
from tjscan.power.source import PowerSource
from tjscan.recording.journal import Journal, RunEvent
from tjscan.result.directory import CALIBRATION_FILE, JOB_FILE, JOINT_FILE, SUMMARY_FILE
from tjscan.result.shapes import read_finished_sections
from tjscan.robot.arm import ArmState
from tjscan.runs.run import (
    WPS_FILE,
    JobContext,
    make_run_directory,
    nobody_objects,
    record_vehicle_run,
)
from tjscan.runs.scan.run import ScanContext, result_frame_of_job, resume_scan, run_scan
from tjscan.runs.weld import look as looking
from tjscan.runs.weld.arc import ArcWelder, SimulatedClock, WallClock, left_to_weld
from tjscan.runs.weld.beads import order_beads
from tjscan.runs.weld.journal import (
    ARC_BEGUN_EVENT,
    SURFACE_EVENT,
    WELD_RECORDING,
    WELD_STOP_EVENT,
    WIDE_POOLS_EVENT,
    ArcMessage,
    LookMessage,
    PlannedBeadMessage,
    WeldRecording,
    read_weld,
)
from tjscan.runs.weld.results import write_weld_results
from tjscan.scanning.journal import grid_triangles
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ProfileView
from tjscan.scanning.stopping import StopRequest
from tjscan.welding.look import COLUMN_STEP, SurfaceLook
from tjscan.welding.replan import BeadOrder, NextBead, WeldPlanner
from tjscan.welding.state import WeldState
from tjscan.welding.target import WeldTarget
from tjscan.welding.world import TorchTrace, WeldWorld

SCAN_DIRECTORY: Final = "scan"
"""Of the scan, in a weld's run directory."""

RAY_HEIGHT: Final = 60e-3
"""Above the sections' origins from which the true surface is sought, metres."""

SHORTEST_ARC: Final = 20e-3
"""A shorter stretch between two that were not read is not welded, metres."""

SAG_WORTH_SAYING: Final = 0.5e-3
"""Below the line between the toes of a finished weld, metres."""

IGNITION_SHIFT: Final = 2e-3
"""Farther on along the bead a second ignition is tried, metres."""

WAIT_SLICE: Final = 1.0
"""Seconds of a wait between two beads after which a stop is seen."""

TRACE_STEP: Final = 0.5e-3
"""Between two places of a torch's trace, metres."""


class LookSchedule(StrEnum):
    """When the weld is looked at."""

    PASS = "pass"
    LAYER = "layer"
    CAP = "cap"
    NONE = "none"


@dataclass(frozen=True, eq=False)
class WeldContext(JobContext[WeldJob]):
    """A weld's job with what it names, and where its run reports to; see `JobContext`.

    Parameters
    ----------
    stop : StopRequest
        Asks for an end; an arc that burns is put out.
    ask : callable
        Asks a person to let the weld go on, or to strike the arc.
    """

    stop: StopRequest = field(default_factory=StopRequest)
    ask: Callable[[str], bool] = nobody_objects

    @cached_property
    def scan(self) -> ScanContext:
        """The same for the scan."""
        return ScanContext(self.job.scan_job, self.job_file, self.journal, stop=self.stop)

    @cached_property
    def wps(self) -> WeldingProcedure:
        """The welding procedure specification that the job names."""
        return read_wps(self.wps_file)

    @property
    def wps_file(self) -> Path:
        """Its file."""
        return self.job_file.parent / self.job.weld.wps

    @property
    def must_stop(self) -> bool:
        """Whether the operator asked for an end."""
        return self.stop.must_stop_now or self.stop.ends_after_section


def run_weld(
    context: WeldContext, directory: Path, *, arc: bool, looks: LookSchedule = LookSchedule.PASS
) -> None:
    """Scan, weld and look, into a new run directory.

    Parameters
    ----------
    context : WeldContext
    directory : Path
        To make.
    arc : bool
        Whether an arc may burn; without, the weld is planned alone.
    looks : LookSchedule, optional

    Raises
    ------
    TjscanError
        If the job is wrong, the weld is stopped or a device fails; the recording holds what
        happened until then, and the log is written from it.
    """
    with add_file_to_errors(context.job_file):
        scan, _ = context.scan, context.wps  # its mistakes are found before anything moves
        job = context.job.model_copy(update={"weld": replace(context.job.weld, wps=WPS_FILE)})
        copies = {
            JOINT_FILE: scan.joint_file,
            CALIBRATION_FILE: scan.sensor_mount.file,
            WPS_FILE: context.wps_file,
        }
        make_run_directory(directory, job, context.job_file, copies)
    run_scan(scan, directory / SCAN_DIRECTORY)
    _weld_and_record(context, directory, arc=arc, looks=looks)


def resume_weld(
    context: WeldContext, *, arc: bool, looks: LookSchedule = LookSchedule.PASS
) -> None:
    """Go on with a weld that was stopped, or that was a dry run, in its run directory.

    Parameters
    ----------
    context : WeldContext
        The job as the run directory holds it.
    arc, looks
        As of `run_weld`.
    """
    directory = context.job_file.parent
    scanned = directory / SCAN_DIRECTORY
    if not (scanned / JOB_FILE).is_file():
        run_scan(context.scan, scanned)
    elif not (scanned / SUMMARY_FILE).is_file():
        file = scanned / JOB_FILE
        resume_scan(replace(context.scan, job=read_scan_job(file), job_file=file))
    _weld_and_record(context, directory, arc=arc, looks=looks)


def _weld_and_record(
    context: WeldContext, directory: Path, *, arc: bool, looks: LookSchedule
) -> None:
    done = list(read_weld(directory)) if (directory / f"{WELD_RECORDING}.mcap").is_file() else []
    with add_file_to_errors(context.job_file):
        weld = Weld.of_scan(context, directory)
    with record_vehicle_run(
        context, directory, WELD_RECORDING, WeldRecording, write_weld_results
    ) as journal:
        try:
            for message in done:
                weld.replay(message)
            weld.end_replay()
            if weld.order.too_wide > 0:
                what = (
                    f"up to {1e3 * weld.order.too_wide:.1f} mm wider than gravity aside lets stand"
                )
                journal.record(RunEvent(WIDE_POOLS_EVENT, f"{what}: the WPS has no smaller beads"))
            if arc:
                with weld.power_source() as source:
                    weld.weld_all(source, looks, journal)
            else:
                weld.plan_all(journal)
        except (LookRefused, WeldStopped) as error:
            journal.record(RunEvent(WELD_STOP_EVENT, str(error)))
            raise


@dataclass(eq=False)
class Weld:
    """A weld under way: what is believed of it, and in a simulation what is true.

    Parameters
    ----------
    context : WeldContext
    stations : GrooveStations
        Sections of the first scan, in the frame of its results.
    flanks : FlanksAlongGroove
        Faces of the bare groove.
    toes_u : ndarray, shape (n, 2)
        Where the finished weld shall meet brace and leg, metres.
    order : BeadOrder
    world : WeldWorld
        The truth.
    views : list of ProfileView
        From which the scan looked, one a section.
    """

    context: WeldContext
    stations: GrooveStations
    flanks: looking.FlanksAlongGroove
    toes_u: Array
    order: BeadOrder
    world: WeldWorld
    views: list[ProfileView]
    planner: WeldPlanner | None = None
    weldable: Mask = field(init=False)
    _bead: NextBead | None = None
    _arcs: list[ArcMessage] = field(default_factory=list)
    _open_arc: str = ""
    _laid: bool = False
    _arm: ArmState | None = None
    _raised: float = 0.0

    def __post_init__(self) -> None:
        self.weldable = np.zeros(len(self.stations.s), dtype=bool)

    @classmethod
    def of_scan(cls, context: WeldContext, directory: Path) -> Weld:
        """Make a weld of a finished scan; nothing of it is welded.

        Raises
        ------
        ConfigurationError
            If the groove closes, or nothing that the WPS allows fits.
        """
        scanned, settings = directory / SCAN_DIRECTORY, context.job.weld
        wps = context.wps
        _, sections = read_finished_sections(scanned)
        edges = fit_groove_edges(sections, wps.sequence.longest_step)
        if edges.closed:
            raise ConfigurationError(
                "the groove was scanned all round; a weld of a stretch of it is made from one "
                "place of the arm: make scan.length_mm shorter",
                key="scan.length_mm",
            )
        gravity = np.array(settings.gravity) / np.linalg.norm(settings.gravity)
        count = max(2, round(edges.length / settings.station_step))
        stations = cut_groove_stations(edges, np.linspace(0.0, edges.length, count + 1))
        tilt = _tilt_of_gravity(stations, gravity)
        order = order_beads(edges, stations.corners, wps, settings.bead, gravity, tilt)
        toes_u = stations.corners[:, [3, 2], 0]
        u = _columns(toes_u, settings.margin)
        true = WeldState.of_groove(
            stations.s, u, _true_heights(context.scan, stations, u), toes_u, tilt
        )
        world = WeldWorld(
            true,
            wps.wire.diameter,
            wps.wire.deposition_efficiency,
            np.random.default_rng(settings.simulation.seed),
            faults=settings.simulation,
        )
        last = {view.index: view for view in read_recorded_scan(scanned).views}
        T_r_b = result_frame_of_job(context.job).T_r_b
        poses = [T_r_b @ last[one.index].T_b_s for one in sections]
        flanks = looking.FlanksAlongGroove.of_scan(edges, sections, poses)
        views = [last[k] for k in sorted(last)]
        return cls(context, stations, flanks, toes_u, order, world, views)

    @property
    def count(self) -> int:
        """Beads of the weld."""
        return sum(self.order.counts)

    def power_source(self) -> PowerSource:
        """The power source that the job names, not yet connected."""
        power = self.context.job.power
        simulated = power.driver_kind is DriverKind.SIMULATED
        self.clock = SimulatedClock() if simulated else WallClock()
        source: PowerSource = power.make_device(
            PowerDriverInputs(
                ask=self.context.ask,
                clock=lambda: self.clock.now,
                raised=lambda: self._raised,
                seed=self.context.job.weld.simulation.seed,
            )
        )
        return source

    def _raise_torch(self, s: float, raised: float) -> None:
        """Let the torch be so much over the plan as it is led, and as it is too high besides."""
        share = s / float(self.stations.s[-1])
        self._raised = raised + share * self.context.job.weld.simulation.height

    def plan_all(self, journal: Journal) -> None:
        """Look, and plan every bead that is left by the bead model alone; nothing is welded."""
        planner = self.planner or self._look(journal)
        while planner.done < self.count:
            self._stop_if_asked()
            bead, self._bead = self._bead or planner.next_bead(), None
            journal.record(self._planned(bead, dry=True))
            planner.after_bead(bead)
        journal.record(RunEvent("dry run", "nothing was welded: an arc needs --arc"))

    def weld_all(self, source: PowerSource, looks: LookSchedule, journal: Journal) -> None:
        """Weld every bead that is left, and look as often as is asked for.

        Raises
        ------
        WeldStopped
            If a guard, the operator or a look stops it; the arc is out.
        """
        job = self.context.job
        welder = ArcWelder(
            source,
            job.weld.arc,
            self.context.wps,
            self.clock,
            journal,
            lambda: self.context.must_stop,
            simulated=True,  # the arm is
            height=job.weld.height,
            raise_torch=self._raise_torch,
        )
        planner = self.planner or self._look(journal)
        while planner.done < self.count:
            bead = self._bead
            if bead is None:
                bead = self._bead = planner.next_bead()
                self._wait_before(bead)
                journal.record(self._planned(bead))
            for begin, end in tuple(self.stretches_left(bead)):
                self._weld_stretch(welder, bead, begin, end)
            self._finish_bead(planner, bead)
            if self._look_is_due(planner, looks):
                planner = self._look(journal)
            if planner.done < self.count:
                for _ in range(ceil(self.context.wps.sequence.interpass_wait / WAIT_SLICE)):
                    self._stop_if_asked()
                    self.clock.wait(WAIT_SLICE)
        if looks is not LookSchedule.NONE and self._laid:
            self._look(journal)
            journal.record(RunEvent(SURFACE_EVENT, self._surface_in_words(planner)))

    def _surface_in_words(self, planner: WeldPlanner) -> str:
        """How far the finished surface lies off its target, where the last look read it."""
        if not self.weldable.any():
            return "the last look did not read it"
        state = planner.belief.part(self.weldable)
        target = WeldTarget.over(state, self.order.cap_height)
        upright = np.hypot(1, target.slope)
        below = np.where(target.between, target.chord - state.w, 0.0).max(axis=1) / upright
        over = np.where(target.between, state.w - target.top, 0.0).max(axis=1) / upright
        step = 1e3 * float(self.stations.s[1])
        return (
            f"up to {1e3 * over.max():.1f} mm over its target, up to {1e3 * below.max():.1f} mm "
            f"below the line between its toes, and by more than {1e3 * SAG_WORTH_SAYING:g} mm on "
            f"{step * (below > SAG_WORTH_SAYING).sum():.0f} mm of the {step * len(below):.0f} mm "
            "that were read"
        )

    def replay(self, message: object) -> None:
        """Take in what was recorded before a stop."""
        match message:
            case PlannedBeadMessage(dry=True):
                pass
            case PlannedBeadMessage():
                self._finish_beads_before(message.number)
                self._bead = message
                self.weldable = message.weldable > 0
            case RunEvent(name=name) if name == ARC_BEGUN_EVENT:
                self._open_arc = message.detail
            case ArcMessage():
                self._open_arc = ""
                self._arcs.append(message)
                self._lay(message)
            case LookMessage():
                self._finish_beads_before(message.beads)
                self._take_look(message.seen)
                self._bead = None

    def end_replay(self) -> None:
        """Forget a bead that was planned alone.

        Raises
        ------
        WeldStopped
            If an arc has no recorded end, and no one says that its metal is ground out.
        """
        if self._open_arc and not self.context.ask(
            f"grind out what an arc laid whose end was not recorded ({self._open_arc})"
        ):
            raise WeldStopped("arc", f"no one knows how far it burned: {self._open_arc}")
        if not self._arcs:
            self._bead = None

    def stretches_left(self, bead: NextBead) -> Iterator[tuple[float, float]]:
        """From where to where a bead is still to be welded, metres along the groove."""
        for span in _spans(bead.s, self.weldable):
            left = left_to_weld(span, self._arcs, self.context.job.weld.overlap)
            if left is not None:
                yield left

    def _wait_before(self, bead: NextBead) -> None:
        number = bead.number + 1
        self._stop_if_asked()
        if number in self.context.job.weld.holds and not self.context.ask(f"weld bead {number}"):
            raise WeldStopped("hold", f"bead {number} was not let go")

    def _stop_if_asked(self) -> None:
        if self.context.must_stop:
            raise WeldStopped(ArcFault.STOPPED, "by the operator, between two beads")

    def _planned(self, bead: NextBead, *, dry: bool = False) -> PlannedBeadMessage:
        values = {one.name: getattr(bead, one.name) for one in fields(NextBead)}
        return PlannedBeadMessage(**values, weldable=self.weldable.astype(float), dry=dry)

    def _weld_stretch(self, welder: ArcWelder, bead: NextBead, begin: float, end: float) -> None:
        for at in (begin, begin + IGNITION_SHIFT):
            message, stopped = welder.weld(bead, at, end)
            self._arcs.append(message)
            self._lay(message)
            if stopped is None:
                if at > begin:
                    where = f"{1e3 * begin:.1f} to {1e3 * at:.1f} mm along the groove"
                    welder.journal.record(RunEvent("gap", f"{where}: the second ignition was on"))
                return
            if stopped.fault != ArcFault.NO_IGNITION or at > begin or at + IGNITION_SHIFT >= end:
                raise stopped

    def _lay(self, arc: ArcMessage) -> None:
        """Let the metal of an arc lie where the torch truly was."""
        bead = self._bead
        if bead is None or len(arc.s) < 2 or arc.end - arc.begin < TRACE_STEP:
            return
        s = np.linspace(arc.begin, arc.end, 1 + round((arc.end - arc.begin) / TRACE_STEP))
        tip = np.column_stack([np.interp(s, bead.s, column) for column in bead.tip.T])
        along = [np.interp(s, arc.s, values) for values in (arc.speed, arc.feed, arc.heat_input)]
        down = np.tile((0.0, -1.0), (len(s), 1))
        weave = np.interp(s, bead.s, bead.weave)
        speed, feed, heat = along
        self.world.weld(TorchTrace(s, tip, down, speed, feed, heat, weave))
        self._laid = True

    def _finish_bead(self, planner: WeldPlanner, bead: NextBead) -> None:
        laid, heat = np.zeros_like(self.weldable), bead.heat_input.copy()
        for arc in self._arcs:
            on = (bead.s > arc.begin - TRACE_STEP) & (bead.s < arc.end + TRACE_STEP)
            if len(arc.s):
                laid |= on
                heat[on] = np.interp(bead.s[on], arc.s, arc.heat_input)
        planner.after_bead(bead, laid, heat)
        self._bead, self._arcs = None, []

    def _finish_beads_before(self, number: int) -> None:
        """Count the recorded bead as laid, though no arc may have burned on it."""
        if self.planner is not None and self._bead is not None and self._bead.number < number:
            self._finish_bead(self.planner, self._bead)

    def _look_is_due(self, planner: WeldPlanner, looks: LookSchedule) -> bool:
        if planner.done >= self.count or looks is LookSchedule.NONE:
            return False
        layer, before = self.order.layer_of(planner.done)
        is_cap = layer == len(self.order.counts) - 1
        return looks is LookSchedule.PASS or (
            before == 0 and (is_cap or looks is LookSchedule.LAYER)
        )

    def _look(self, journal: Journal) -> WeldPlanner:
        """Look at the groove as it now is, and plan from what is seen."""
        seen, time = self._scan_again()
        planner = self._take_look(seen)
        learner, deviation = planner.learner, planner.deviation
        journal.record(
            LookMessage(
                planner.done,
                time,
                seen.u,
                seen.w.ravel(),
                seen.sigma.ravel(),
                seen.read.astype(float),
                None if deviation is None else deviation.value,
                None if deviation is None else deviation.sigma,
                learner.gain.value,
                learner.offset.value,
                learner.shrinkage.value,
            )
        )
        for begin, end in _spans(self.stations.s, ~self.weldable):
            where = f"{1e3 * begin:.0f} to {1e3 * end:.0f} mm along the groove"
            what = f"{where}, or too short a stretch of it: no arc burns there"
            journal.record(RunEvent("not read", what))
        return planner

    def _take_look(self, seen: SurfaceLook) -> WeldPlanner:
        if self.planner is None:
            tilt = self.world.state.tilt
            belief = WeldState.of_groove(self.stations.s, seen.u, seen.w, self.toes_u, tilt)
            model = self.context.job.weld.bead
            self.planner = WeldPlanner(belief, self.order, self.context.wps, model)
        else:
            u = np.tile(seen.u, (len(seen.w), 1))
            self.planner.take_look(u, seen.w, seen.sigma, seen.read)
        s, weldable = self.stations.s, seen.read.copy()
        for begin, end in _spans(s, seen.read):
            if end - begin < SHORTEST_ARC:
                weldable &= (s < begin) | (s > end)
        self.weldable, self._laid = weldable, False
        return self.planner

    def _scan_again(self) -> tuple[SurfaceLook, float]:
        """Go the way of the scan again over the groove as it now is."""
        context, settings = self.context.scan, self.context.job.weld
        state = self.world.state
        points = self.stations.points_to_space(np.stack((state.u, state.w), axis=2))
        surface = RaycastSurface(points.reshape(-1, 3), grid_triangles(*state.u.shape))
        frame = result_frame_of_job(context.job)
        job = context.job
        T_b_r = inverse_pose(job.T_w_b_true) @ (np.eye(4) if job.joint is None else job.joint.T_w_j)
        scene = SimulatedScene(surface, T_b_r)
        cell = make_cell(job, context.sensor_mount, lambda: scene, self._arm)
        profiles = []
        with cell:
            cell.arm.move_joint_to_pose(self.views[0].T_b_f, near=self.views[0].q)
            poses = [view.T_b_f for view in self.views]
            for T_b_f in looking.interpolate_poses(poses, settings.look_step):
                if self.context.must_stop:
                    raise WeldStopped(ArcFault.STOPPED, "by the operator, during a look")
                self._arm = cell.arm.move_linear(T_b_f)
                T_r_s = frame.T_r_b @ self._arm.T_b_f @ cell.T_f_s
                profile = cell.laser.capture()
                profiles.append(looking.read_steel(profile, self.flanks, T_r_s, job.groove))
            time = cell.arm.state().time
        u = _columns(self.toes_u, settings.margin)
        surface_seen = looking.surface_of_profiles(
            self.stations, profiles, u, self.toes_u, settings.look_step
        )
        return surface_seen, time


def _columns(toes_u: Array, margin: float) -> Array:
    low, high = float(toes_u[:, 0].min()) - margin, float(toes_u[:, 1].max()) + margin
    return np.linspace(low, high, 1 + round((high - low) / COLUMN_STEP))


def _tilt_of_gravity(stations: GrooveStations, gravity: Array) -> Array:
    """Angle of gravity in each section from straight into it, towards the brace; radians."""
    return np.asarray(np.arctan2(-(stations.across @ gravity), -(stations.up @ gravity)))


def _true_heights(scan: ScanContext, stations: GrooveStations, u: Array) -> Array:
    """Heights of the true joint over the sections' columns, shape (n, m), metres."""
    if scan.joint is None:
        raise ConfigurationError("a simulated weld needs a [joint] table", key="joint")
    shape = len(stations.s), len(u)
    start = np.stack(np.broadcast_arrays(u, np.full(shape, RAY_HEIGHT)), axis=2)
    origins = stations.points_to_space(start).reshape(-1, 3)
    directions = np.repeat(-stations.up, len(u), axis=0)
    hits = joint_surface(scan.joint).cast_rays(origins, directions)
    heights = RAY_HEIGHT - hits.distance.reshape(shape)
    if not np.isfinite(heights).all():
        raise ConfigurationError(
            "the joint has no faces as far beside the groove as weld.margin_mm", key="weld"
        )
    return heights


def _spans(s: Array, on: Mask) -> Iterator[tuple[float, float]]:
    """From where to where a mask holds, metres."""
    for a, b in zip(*stretches_of_true_values(on), strict=True):
        yield float(s[a]), float(s[b - 1])
