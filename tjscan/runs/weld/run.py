"""Weld, look, plan again, weld on: from a job to a weld and its log."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.calibration.wizard.operator import Question
from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, LookRefused, RecordingError, WeldStopped
from tjscan.core.frames import Array, Mask, stretches_of_true_values, transform_points
from tjscan.job.cell import joint_surface
from tjscan.job.files import read_scan_job
from tjscan.job.weld import WeldJob
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
from tjscan.runs.run import (
    WPS_FILE,
    JobContext,
    make_run_directory,
    nobody_objects,
    record_vehicle_run,
)
from tjscan.runs.scan.run import ScanContext, resume_scan, run_scan
from tjscan.runs.stations.run import (
    StationScan,
    Watch,
    resume_stations,
    run_stations,
    stitch_station_runs,
)
from tjscan.runs.weld.arc import ArcWelder, SimulatedClock, WallClock, left_to_weld
from tjscan.runs.weld.beads import WeldPass, order_beads, passes_of_weld, plan_pass
from tjscan.runs.weld.journal import (
    ARC_BEGUN_EVENT,
    STATION_EVENT,
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
from tjscan.runs.weld.stations import ArmStation, arm_stations
from tjscan.scanning.journal import grid_triangles
from tjscan.scanning.stopping import StopRequest
from tjscan.welding.look import SurfaceLook, columns_over
from tjscan.welding.replan import BeadOrder, GroovePart, NextBead, WeldPlanner
from tjscan.welding.state import WeldState
from tjscan.welding.target import surface_in_words
from tjscan.welding.world import TorchTrace, WeldWorld

SCAN_DIRECTORY: Final = "scan"
"""Of the scan, in a weld's run directory."""

RAY_HEIGHT: Final = 60e-3
"""Above the sections' origins from which the true surface is sought, metres."""

SHORTEST_ARC: Final = 20e-3
"""A shorter stretch between two that were not read is not welded, metres."""

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
    _scan(context, directory / SCAN_DIRECTORY)
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
        _scan(context, scanned)
    elif not (scanned / SUMMARY_FILE).is_file():
        file = scanned / JOB_FILE
        scan = replace(context.scan, job=read_scan_job(file), job_file=file)
        if len(scan.job.station) > 1:
            _stitch(scanned, resume_stations(scan, {}, _Answers(context.ask), _reporter(scan)))
        else:
            resume_scan(scan)
    _weld_and_record(context, directory, arc=arc, looks=looks)


@dataclass(frozen=True, slots=True)
class _Answers:
    """The person who moves the arm from station to station."""

    ask: Callable[[str], bool]

    def confirm(self, question: Question) -> bool:
        return self.ask(question.text)


def _reporter(scan: ScanContext) -> Watch:
    return lambda name, plan: nullcontext(scan.journal)


def _scan(context: WeldContext, directory: Path) -> None:
    """Scan from one place, or from all stations, whose scans are stitched."""
    scan = context.scan
    if len(scan.job.station) > 1:
        done = run_stations(scan, directory, _Answers(context.ask), _reporter(scan))
        _stitch(directory, done)
    else:
        run_scan(scan, directory)


def _stitch(directory: Path, stations: Sequence[StationScan]) -> None:
    for one in stations:
        if not one.is_complete:
            raise WeldStopped(ArcFault.STOPPED, f"station {one.name} is not scanned to its end")
    stitch_station_runs(directory)


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
    toes_u : ndarray, shape (n, 2)
        Where the finished weld shall meet brace and leg, metres.
    order : BeadOrder
    passes : tuple of WeldPass
        In which the beads are laid.
    world : WeldWorld
        The truth.
    arms : dict of str to ArmStation
        The arm at each of its stations.
    done : int
        Passes that were laid.
    weldable : ndarray of bool, shape (k,)
        Stations of the pass under way at which an arc may burn.
    """

    context: WeldContext
    stations: GrooveStations
    toes_u: Array
    order: BeadOrder
    passes: tuple[WeldPass, ...]
    world: WeldWorld
    arms: dict[str, ArmStation]
    planner: WeldPlanner | None = None
    done: int = 0
    weldable: Mask = field(default_factory=lambda: np.empty(0, dtype=bool))
    _readable: dict[str, Mask] = field(default_factory=dict)
    _begun: Mask = field(init=False)
    _fresh: str | None = None
    _at: str | None = None
    _bead: NextBead | None = None
    _arcs: list[ArcMessage] = field(default_factory=list)
    _open_arc: str = ""
    _laid: bool = False
    _raised: float = 0.0

    def __post_init__(self) -> None:
        self._begun = np.zeros(len(self.stations.s), dtype=bool)

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
        if edges.closed and len(context.job.station) < 2:
            raise ConfigurationError(
                "the groove was scanned all round from one place; a weld all round is made from "
                "several stations of the arm: make scan.length_mm shorter",
                key="scan.length_mm",
            )
        gravity = np.array(settings.gravity) / np.linalg.norm(settings.gravity)
        count = max(2, round(edges.length / settings.station_step))
        s = np.linspace(0.0, edges.length, count + 1)
        stations = cut_groove_stations(edges, s[:-1] if edges.closed else s)
        tilt = _tilt_of_gravity(stations, gravity)
        order = order_beads(edges, stations.corners, wps, settings.bead, gravity, tilt)
        toes_u = stations.corners[:, [3, 2], 0]
        arms, T_j_r = arm_stations(context.scan, scanned, edges, sections, stations)
        passes = passes_of_weld(order, edges, wps, [arm.stretch for arm in arms])
        u = columns_over(toes_u, settings.margin)
        true = WeldState.of_groove(
            stations.s, u, _true_heights(context.scan, stations, u, T_j_r), toes_u, tilt
        )
        world = WeldWorld(
            true,
            wps.wire.diameter,
            wps.wire.deposition_efficiency,
            np.random.default_rng(settings.simulation.seed),
            faults=settings.simulation,
            period=edges.length if edges.closed else 0.0,
        )
        by_name = {arm.stretch.station: arm for arm in arms}
        return cls(context, stations, toes_u, order, passes, world, by_name)

    @property
    def count(self) -> int:
        """Passes of the weld: one a bead from each station."""
        return len(self.passes)

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
        while self.done < self.count:
            self._stop_if_asked()
            self._go_to_station(journal)
            if self._look_is_due(LookSchedule.NONE):
                self._look(journal)
            bead = self._plan_pass()
            journal.record(self._planned(bead, dry=True))
            self._begun_planner.after_bead(bead, part=self._part_of_pass())
            self._bead, self.done = None, self.done + 1
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
        while self.done < self.count:
            self._go_to_station(journal)
            bead = self._bead
            if bead is None:
                if self._look_is_due(looks):
                    self._look(journal)
                bead = self._plan_pass()
                self._wait_before(bead)
                journal.record(self._planned(bead))
            there = replace(welder, station=self._pass.station)
            for begin, end in tuple(self.stretches_left(bead)):
                self._weld_stretch(there, bead, begin, end)
            self._finish_bead(bead)
            if looks is LookSchedule.PASS:
                self._look(journal)
            if self.done < self.count:
                for _ in range(ceil(self.context.wps.sequence.interpass_wait / WAIT_SLICE)):
                    self._stop_if_asked()
                    self.clock.wait(WAIT_SLICE)
        if looks is not LookSchedule.NONE:
            if self._laid:
                self._look(journal)
            journal.record(RunEvent(SURFACE_EVENT, self._surface_in_words()))

    def _surface_in_words(self) -> str:
        """How far the finished surface lies off its target, where the last looks read it."""
        read = np.zeros(len(self.stations.s), dtype=bool)
        for name, readable in self._readable.items():
            read[self.arms[name].part.rows[readable]] = True
        if self.planner is None or not read.any():
            return "the last look did not read it"
        state, step = self.planner.belief.part(read), float(self.stations.s[1])
        return surface_in_words(state, self.order.cap_height, step)

    def replay(self, message: object) -> None:
        """Take in what was recorded before a stop."""
        match message:
            case PlannedBeadMessage(dry=True):
                pass
            case PlannedBeadMessage():
                if self._bead is not None and message.number != self._bead.number:
                    self._finish_bead(self._bead)
                self._bead = message
                self.weldable = message.weldable > 0
            case RunEvent(name=name) if name == ARC_BEGUN_EVENT:
                self._open_arc = message.detail
            case ArcMessage():
                self._open_arc = ""
                self._arcs.append(message)
                self._lay(message)
            case LookMessage():
                if self._bead is not None and self.done < message.beads:
                    self._finish_bead(self._bead)
                self._take_look(message.seen, message.station)
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
        for begin, end in _spans(bead.s, self.weldable):
            span = max(begin, self._pass.begin), min(end, self._pass.end)
            left = left_to_weld(span, self._arcs, self.context.job.weld.overlap)
            if left is not None:
                yield left

    @property
    def _begun_planner(self) -> WeldPlanner:
        if self.planner is None:
            raise RecordingError("the weld's recording has a bead before its first look")
        return self.planner

    @property
    def _pass(self) -> WeldPass:
        """The pass under way, or the last."""
        return self.passes[min(self.done, self.count - 1)]

    def _part_of_pass(self) -> GroovePart:
        """The stations of the pass under way, and one more at either end."""
        return self._pass.part_of(self.arms[self._pass.station].part, float(self.stations.s[1]))

    def _plan_pass(self) -> NextBead:
        """Plan the next pass, from what the station that welds it sees."""
        one, there = self._pass, self.arms[self._pass.station].part
        part = self._part_of_pass()
        self._bead = plan_pass(self._begun_planner, one, there).at(part.s)
        self.weldable = self._readable[one.station][np.isin(there.s, part.s)]
        return self._bead

    def _go_to_station(self, journal: Journal) -> None:
        """Let a person move the arm to where the next pass is welded from, if it is not there."""
        name = self._pass.station
        if name == self._at or len(self.arms) < 2:
            return
        if not self.context.ask(f"move the arm to station {name}, just as it stood for the scan"):
            raise WeldStopped("hold", f"the arm was not moved to station {name}")
        journal.record(RunEvent(STATION_EVENT, f"the arm is at station {name}"))
        self._at = name

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
        weldable, station = self.weldable.astype(float), self._pass.station
        return PlannedBeadMessage(**values, weldable=weldable, dry=dry, station=station)

    def _weld_stretch(self, welder: ArcWelder, bead: NextBead, begin: float, end: float) -> None:
        for at in (begin, begin + IGNITION_SHIFT):
            message, stopped = welder.weld(self._begun_planner.for_arc(bead, at, end), at, end)
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
        rows = arc.speed, arc.feed, arc.heat_input
        speed, feed, heat = (np.interp(s, arc.s, values) for values in rows)
        u, weave = (np.interp(s, bead.s, values) for values in (bead.tip[:, 0], bead.weave))
        self.world.weld(TorchTrace(s, u, speed, feed, heat, weave))
        self._laid, self._fresh = True, None

    def _finish_bead(self, bead: NextBead) -> None:
        """Count a bead as laid, though no arc may have burned on it."""
        planner = self._begun_planner
        set_area, heat = np.zeros_like(bead.s), bead.heat_input.copy()
        for arc in self._arcs:
            on = (bead.s > arc.begin - TRACE_STEP) & (bead.s < arc.end + TRACE_STEP)
            if len(arc.s):
                s = bead.s[on]
                along = [np.interp(s, arc.s, row) for row in (arc.feed, arc.speed, arc.heat_input)]
                set_area[on] += planner.area_of_arc(s, (arc.begin, arc.end), *along[:2])
                heat[on] = along[2]
        planner.done = bead.number
        planner.after_bead(bead, set_area, heat, self._part_of_pass())
        self._bead, self._arcs, self.done = None, [], self.done + 1

    def _look_is_due(self, looks: LookSchedule) -> bool:
        """Whether the station that welds the next pass looks before it."""
        if self._pass.station not in self._readable:
            return True
        if looks is LookSchedule.NONE or self._fresh == self._pass.station:
            return False
        layer, before = self.order.layer_of(self._pass.bead)
        is_cap = layer == len(self.order.counts) - 1
        return looks is LookSchedule.PASS or (
            before == 0 and (is_cap or looks is LookSchedule.LAYER)
        )

    def _look(self, journal: Journal) -> None:
        """Look at the groove as it now is, and take in what is seen."""
        name = self._at or self._pass.station
        arm, settings = self.arms[name], self.context.job.weld
        state = self.world.state
        points = self.stations.points_to_space(np.stack((state.u, state.w), axis=2))
        if self.world.period > 0:
            points = np.concatenate((points, points[:1]))
        surface = RaycastSurface(points.reshape(-1, 3), grid_triangles(*points.shape[:2]))
        u, toes_u = columns_over(self.toes_u, settings.margin), self.toes_u[arm.part.rows]
        seen, time = arm.look(surface, u, toes_u, settings, lambda: self.context.must_stop)
        planner = self._take_look(seen, name)
        learner, deviation = planner.learner, planner.deviation
        journal.record(
            LookMessage(
                self.done,
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
                name,
            )
        )
        for begin, end in _spans(arm.part.s, ~self._readable[name]):
            where = f"{1e3 * begin:.0f} to {1e3 * end:.0f} mm along the groove"
            what = f"{where}, or too short a stretch of it: no arc burns there"
            journal.record(RunEvent("not read", what))

    def over_all_sections(self, looks: Sequence[tuple[SurfaceLook, str]]) -> SurfaceLook:
        """What looks from stations show of the whole groove: of two at a section the later one."""
        n, (first, _) = len(self.stations.s), looks[0]
        w, sigma, read = (
            np.zeros((n, *rows.shape[1:]), rows.dtype)
            for rows in (first.w, first.sigma, first.read)
        )
        for seen, name in looks:
            part = self.arms[name].part
            new = seen.read | ~read[part.rows]
            rows = part.rows[new]
            w[rows], sigma[rows], read[rows] = seen.w[new], seen.sigma[new], seen.read[new]
        return SurfaceLook(first.u, w, sigma, read)

    def _take_look(self, seen: SurfaceLook, name: str) -> WeldPlanner:
        """Take in a look from a station; where none has read the groove before, it is bare."""
        part, n = self.arms[name].part, len(self.stations.s)
        whole = self.over_all_sections([(seen, name)])
        tilt = self.world.state.tilt
        bare = WeldState.of_groove(self.stations.s, seen.u, whole.w, self.toes_u, tilt)
        if self.planner is None:
            model = self.context.job.weld.bead
            self.planner = WeldPlanner(bare, self.order, self.context.wps, model)
        else:
            first = np.isin(np.arange(n), part.rows) & ~self._begun
            self.planner.begin_at(first, bare)
            u = np.tile(seen.u, (n, 1))
            self.planner.take_look(u, whole.w, whole.sigma, whole.read)
        self._begun |= whole.read
        s, weldable = part.s, seen.read.copy()
        for begin, end in _spans(s, seen.read):
            if end - begin < SHORTEST_ARC:
                weldable &= (s < begin) | (s > end)
        self._readable[name], self._laid, self._fresh = weldable, False, name
        return self.planner


def _tilt_of_gravity(stations: GrooveStations, gravity: Array) -> Array:
    """Angle of gravity in each section from straight into it, towards the brace; radians."""
    return np.asarray(np.arctan2(-(stations.across @ gravity), -(stations.up @ gravity)))


def _true_heights(scan: ScanContext, stations: GrooveStations, u: Array, T_j_r: Array) -> Array:
    """Heights of the true joint over the sections' columns, shape (n, m), metres."""
    if scan.joint is None:
        raise ConfigurationError("a simulated weld needs a [joint] table", key="joint")
    shape = len(stations.s), len(u)
    start = np.stack(np.broadcast_arrays(u, np.full(shape, RAY_HEIGHT)), axis=2)
    origins = transform_points(T_j_r, stations.points_to_space(start).reshape(-1, 3))
    directions = np.repeat(-stations.up @ T_j_r[:3, :3].T, len(u), axis=0)
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
