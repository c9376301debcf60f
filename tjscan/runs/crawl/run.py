"""Run a crawl, go on with it after a stop, replay it, or calibrate a vehicle's slip by one."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count, islice, pairwise, takewhile
from pathlib import Path
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError, CrawlStopped, GrooveNotFound, VehicleFault
from tjscan.core.files import lock_and_clean_directory
from tjscan.crawler.control_cycle import LONGEST_PERIOD, CrawlDevices, HandDrive, JointReader
from tjscan.crawler.crawler import Crawler, CrawlPlan, CrawlStart, WeldOperator
from tjscan.crawler.guards import Guards, ProximityFilter, ProximitySensorPlaces
from tjscan.crawler.joint_sections import COASTING_TIME, LastView
from tjscan.crawler.joint_tracking.memory import RememberingTracker
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.crawler.journal import (
    BEND_EVENT,
    CRAWL_RECORDING,
    CRAWL_TOPICS,
    CYCLES_TOGETHER,
    SET_DOWN_EVENT,
    TORCH_EVENT,
    TRACE_TOPIC,
    WARNING_EVENT,
    CrawlCycle,
    CrawlRecording,
    cycle_messages,
    is_by_hand,
    read_crawl_messages,
)
from tjscan.crawler.method import FollowingMethod, OffsetEstimate
from tjscan.crawler.paper_joint import PaperJointReader
from tjscan.crawler.paper_method import PaperMethod
from tjscan.crawler.pass_record import PASS_END
from tjscan.crawler.phases import Phase
from tjscan.crawler.plan import PassSettings, with_rows
from tjscan.crawler.sizing import broken_rules
from tjscan.crawler.slip_aware import SlipAwareMethod
from tjscan.crawler.slip_calibration import (
    SlipCalibration,
    read_slip_calibration,
    write_slip_calibration,
)
from tjscan.crawler.slip_estimator import SlipEstimate, SlipStateIndex
from tjscan.crawler.torch_axes import SimulatedTorchAxes, TorchJog
from tjscan.crawler.torch_trace import TRACED_PHASES, TorchTracer
from tjscan.job.crawl.cell import CrawlCell, InterruptedWorld, SimulatedWeld, make_crawl_cell
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.planning.wps import read_wps
from tjscan.recording.foxglove import event_log_message
from tjscan.recording.journal import LOG_TOPIC, REPLAY_EVENT, Journal, RecordingWriter, RunEvent
from tjscan.recording.parts import recording_files
from tjscan.recording.topic import Topic
from tjscan.result.directory import CALIBRATION_FILE, JOB_FILE, job_label_of_run
from tjscan.runs.crawl.replan import CrawlPassPlanner
from tjscan.runs.crawl.results import RecordedCrawl, read_recorded_crawl, write_crawl_results
from tjscan.runs.run import (
    JobContext,
    WhenFinished,
    accept_edited_copies,
    check_replay,
    do_nothing,
    job_snapshot_of_file,
    make_vehicle_run_directory,
    nobody_objects,
    record_vehicle_run,
)
from tjscan.vehicle.vehicle import DEAD_MAN_TIME
from tjscan.welding.look import SurfaceLook
from tjscan.welding.replan import WeldPlanner

SETTLING_MULTIPLE: Final = 4.0
"""Times 1 / gain, after which a tenth of what a reversal brings is left: (1 + 4) exp(-4)."""

TURNING_MULTIPLE: Final = 4.0
"""Times crab and least radius: as far as curvature alone brings the vehicle aside and back, so that
the mean of its slope is no longer outward."""


WELD_OVERLAP: Final = 0.02
"""Metres by which a weld that goes on after a stop overlaps what was welded before."""

LARGEST_OVERSHOOT: Final = 1.0
"""Metres beyond a crawl's way at which its vehicle may be set down."""

SHUTTLE_LENGTH: Final = 0.8
"""Metres of the shuttle's way out."""

SHUTTLE_COUNT: Final = 3

SEEN_OFFSET: Final = 0.1e-3
"""Metres beside a joint that a person sees of a wire."""


class AutomaticWeldOperator:
    """A `WeldOperator` of a simulation: everything is always ready."""

    def confirm_weld(self, number: int, assumed: str, *, looks: bool = False) -> bool:
        """Confirm at once."""
        return True

    def confirm_torch(self) -> bool:
        """Confirm at once."""
        return True


@dataclass(frozen=True, slots=True)
class SeeingWeldOperator(AutomaticWeldOperator):
    """A `WeldOperator` of a simulation, who sees its torch, and jogs it over the joint.

    Parameters
    ----------
    world : SimulatedWeld
    jog : TorchJog
    """

    world: SimulatedWeld
    jog: TorchJog

    def confirm_torch(self) -> bool:
        """Jog the torch by what it is off; confirm once that is as little as is seen."""
        _, off = self.world.torch_beside_joint()
        before = self.jog.offset
        self.jog.move(-off)
        if self.jog.offset == before and abs(off) >= SEEN_OFFSET:
            raise CrawlStopped("torch", f"the torch is {1e3 * off:.1f} mm beside what it reaches")
        return abs(off) < SEEN_OFFSET


@dataclass(frozen=True)
class CrawlContext(JobContext[CrawlJob]):
    """A crawl job with its file, and where its run reports to; see `JobContext`.

    Parameters
    ----------
    operator : WeldOperator
        Confirms each pass.
    hand : HandDrive, optional
        Drives by hand before the crawl begins; none by default.
    jog : TorchJog
        Holds what a person adds to the torch's path; nothing by default.
    arc : bool
        Whether the power source that the job names may strike an arc.
    ask : callable
        Asks a person to strike an arc by hand, or to end it.
    """

    operator: WeldOperator = field(default_factory=AutomaticWeldOperator)
    hand: HandDrive | None = None
    jog: TorchJog = field(default_factory=lambda: TorchJog(0.0))
    arc: bool = False
    ask: Callable[[str], bool] = nobody_objects

    @property
    def calibration_file(self) -> Path | None:
        """The calibration that the job names, if it names one."""
        name = self.job.calibration
        return None if name is None else self.job_file.parent / name

    @property
    def wps_file(self) -> Path | None:
        """The welding procedure specification that the job names, if it names one."""
        name = self.job.weld.wps
        return None if name is None else self.job_file.parent / name

    def check_arc(self) -> None:
        """Refuse an arc that was not asked for in the very command.

        Raises
        ------
        ConfigurationError
            With what is missing.
        """
        if self.job.power is not None and not self.arc:
            raise ConfigurationError(
                "names a power source, and it strikes no arc without --arc in the command: add it, "
                "or leave [power] out",
                key="power",
            )

    def make_planner(self) -> CrawlPassPlanner | None:
        """Make what plans the passes; None if they are as the job states them."""
        if not self.job.weld.layers or self.wps_file is None:
            return None
        return CrawlPassPlanner(self.job, read_wps(self.wps_file))

    @property
    def initial_slip(self) -> SlipEstimate:
        """What is known of the vehicle's slip before the first reading.

        Raises
        ------
        ConfigurationError
            If the calibration that the job names can't be read, or is another vehicle's.
        """
        job, course = self.job, self.job.course
        curve, sigma = course.curvature, course.curvature_sigma
        if self.calibration_file is None:
            return SlipEstimate.before_any_reading(job.slip, curvature=curve, curvature_sigma=sigma)
        found = read_slip_calibration(self.calibration_file, job.vehicle.device_id)
        return found.estimate_at_start(job.slip, curve, sigma)

    def make_method(self, slip: SlipEstimate | None = None) -> FollowingMethod:
        """Make the method that the job names, with what is known of slip."""
        job, vehicle = self.job, self.job.vehicle
        if job.method == "paper":
            return PaperMethod(vehicle.geometry, vehicle.tracks, job.paper.laser_to_centre)
        known = slip or self.initial_slip
        return SlipAwareMethod(vehicle.geometry, known, job.slip, job.steering, vehicle.tracks)

    def make_reader(self) -> JointReader:
        """Make what reads the joint for that method; it has seen nothing yet."""
        return PaperJointReader() if self.job.method == "paper" else RememberingTracker()


def make_crawler(
    context: CrawlContext,
    cell: CrawlCell,
    method: FollowingMethod,
    journal: Journal,
    reader: JointReader | None = None,
    planner: CrawlPassPlanner | None = None,
    passes: Sequence[PassSettings] = (),
) -> Crawler:
    """Make the crawler of a job in a cell whose devices are connected.

    Parameters
    ----------
    context : CrawlContext
    cell : CrawlCell
    method : FollowingMethod
    journal : Journal
    reader : JointReader, optional
        Which remembers the joint already; one that has seen nothing if left out.
    planner : CrawlPassPlanner, optional
        Of the passes; they are as stated if left out.
    passes : sequence of PassSettings, optional
        In place of the job's: as those that were begun were planned.
    """
    job = context.job
    if planner is not None and cell.world is not None:
        planner.tell = cell.world.take_plan
    devices = CrawlDevices(
        cell.vehicle,
        cell.laser,
        cell.torch,
        reader or context.make_reader(),
        cell.clock,
        job.vehicle.tracks,
        context.jog,
        job.vehicle.laser_to_torch,
        cell.power,
        job.torch.aside,
    )
    plan = CrawlPlan(job.alignment, job.weld, tuple(passes) or job.passes, planner)
    corners = ProximitySensorPlaces(job.vehicle.body_length, job.vehicle.body_width)
    guards = Guards(job.guards, ProximityFilter(job.proximity), corners)
    return Crawler(devices, plan, method, guards, context.operator, journal, context.hand)


def check_sizing(job: CrawlJob) -> None:
    """Refuse a vehicle that its job asks for more than its sizing allows; see `size_crawler`.

    Raises
    ------
    ConfigurationError
        If magnets, motors or the tightest turn break a rule. A turn may take what the motors have
        and the guard lets pass.
    """
    size = replace(job.size, torque=min(job.size.torque, job.guards.torque))
    for one in broken_rules(size, job.vehicle.tracks, job.steering.least_radius):
        found = f"{one.name} is {one.value:.3g} {one.unit}".rstrip()
        rule = f"must be {one.rule}: {one.advice}. tjscan crawl size shows all"
        raise ConfigurationError(f"{found}, and {rule}", key="size")


def short_pass_warning(job: CrawlJob, slip: SlipEstimate | None) -> str:
    """A warning of passes too short to come back from a reversal; empty for others.

    At a reversal the slope against the joint turns round, and crab adds to it both ways: the
    heading must change by twice the crab, at the curvature of the least radius, and then bring back
    what the vehicle was carried aside meanwhile.

    Parameters
    ----------
    job : CrawlJob
    slip : SlipEstimate or None
        What is known of slip; no warning if a method knows of none.
    """
    if slip is None:
        return ""
    crab = abs(float(slip.x[SlipStateIndex.CRAB])) + slip.sigma(SlipStateIndex.CRAB)
    way = job.weld.run_up + job.weld.length
    needed = (
        SETTLING_MULTIPLE / job.steering.gain + TURNING_MULTIPLE * crab * job.steering.least_radius
    )
    if way >= needed:
        return ""
    return (
        f"the way of a pass, {1e3 * way:.0f} mm with its run-up, is shorter than the "
        f"{1e3 * needed:.0f} mm in which a vehicle that may crab by {1e3 * crab:.0f} mrad surely "
        "comes back after a reversal: each may carry it farther aside. Make weld.run_up_mm longer, "
        "or calibrate"
    )


def run_crawl(context: CrawlContext, directory: Path) -> None:
    """Crawl as a job states, into a new run directory.

    Raises
    ------
    TjscanError
        If the job is wrong, a guard stops the crawler or a device fails; the recording holds
        what happened until then, and the results are written from it.
    """
    with add_file_to_errors(context.job_file):
        context.check_arc()
        planner = context.make_planner()
    cell, method = _prepare_crawl(context, directory)
    _record_crawl(context, directory, cell, method, planner=planner)


def _prepare_crawl(context: CrawlContext, directory: Path) -> tuple[CrawlCell, FollowingMethod]:
    """Make cell and method of a job that is sound, and the run directory."""
    with add_file_to_errors(context.job_file):
        check_sizing(context.job)
        if context.wps_file is not None:
            read_wps(context.wps_file)
        method = context.make_method()
        cell = make_crawl_cell(context.job, ask=context.ask)
        make_vehicle_run_directory(directory, context)
    return cell, method


def _record_crawl(
    context: CrawlContext,
    directory: Path,
    cell: CrawlCell,
    method: FollowingMethod,
    start: CrawlStart | None = None,
    reader: JointReader | None = None,
    planner: CrawlPassPlanner | None = None,
    passes: Sequence[PassSettings] = (),
) -> None:
    """Crawl, record, and write the results, however it ended.

    Parameters
    ----------
    context : CrawlContext
    directory : Path
        Which holds the job already.
    cell : CrawlCell
    method : FollowingMethod
    start : CrawlStart, optional
        Where an interrupted crawl left off.
    reader : JointReader, optional
        Which remembers the joint already.
    planner, passes : optional
        As of `make_crawler`.
    """
    record = partial(CrawlRecording, truth=cell.simulated_place)
    results = partial(write_crawl_results, job=context.job)
    with record_vehicle_run(context, directory, CRAWL_RECORDING, record, results) as journal, cell:
        accept_edited_copies(directory, journal)
        if short := short_pass_warning(context.job, method.slip):
            journal.record(RunEvent(WARNING_EVENT, short))
        make_crawler(context, cell, method, journal, reader, planner, passes).run(start)


def resume_crawl(
    context: CrawlContext, overlap: float = WELD_OVERLAP, place: float | None = None
) -> None:
    """Go on with an interrupted crawl, in its run directory.

    Parameters
    ----------
    context : CrawlContext
        The job as the run directory holds it.
    overlap : float, optional
        By which the weld overlaps what was welded before the stop, metres.
    place : float, optional
        Place of the torch along the joint, metres, if the vehicle was moved since. By default it
        must be where it was, as far as the laser can see; the recording must show
        hull beside the joint.

    Raises
    ------
    ConfigurationError
        If there is nothing to go on with, no such place, or nothing shows where it was.
    CrawlStopped
        If the laser shows that the vehicle was moved; and as `run_crawl` raises.
    """
    directory = context.job_file.parent
    found = read_recorded_crawl(directory)
    if found.details_of(REPLAY_EVENT):
        reason = "is a replay: nothing was welded there. Resume the crawl itself"
        raise ConfigurationError(reason, file=directory)
    start = find_start_after_stop(found.cycles, context.job, overlap, directory)
    last, left = found.cycles[-1], None
    if place is None:
        # One that waits to go on, and is refused, may be at the place that it was moved to.
        view = LastView.of_recording(found.crawling_cycles, stopped=found.was_stopped)
        if view is None:
            raise ConfigurationError(
                "no recorded profile shows the joint with enough hull beside it, so it can't be "
                "checked whether the vehicle was moved: state with --place where the torch is",
                file=directory,
            )
        start, slip = replace(start, last_view=view), slip_after_stop(found, context.job)
    else:
        weld = context.job.weld
        first, end = -weld.run_up - LARGEST_OVERSHOOT, weld.length + LARGEST_OVERSHOOT
        if not first <= place <= end:
            raise ConfigurationError(
                f"--place is {1e3 * place:g} mm along the joint, from where the weld begins; it "
                f"must be between {1e3 * first:g} and {1e3 * end:g}"
            )
        start = replace(start, travel=place, was_set_down=True)
        slip = slip_after_set_down(found, context.job, place)
    passes = tuple(
        one if planned is None else with_rows(one, planned.table)
        for one, planned in zip(context.job.passes, map(found.planned.get, count(1)), strict=False)
    )
    if found.places:
        arcs = tuple((passes[number - 1], way) for number, way in found.true_arcs)
        pose_w = np.array(found.places[-1][1].pose_w)
        left = InterruptedWorld(pose_w, last.state.time, arcs, start.passes_done)
    with add_file_to_errors(context.job_file):
        check_sizing(context.job)
        context.check_arc()
        cell = make_crawl_cell(context.job, left, context.ask)
        planner = context.make_planner()
    method, reader = context.make_method(slip), context.make_reader()
    context.jog.move(last.jog)
    readings = _read_again(found, reader, planner)
    if planner is None:
        deque(readings, maxlen=0)
    else:
        planner.replay(tuple(found.planned), readings)
        if cell.world is not None and start.arc_from > 0:
            cell.world.take_plan(passes[start.passes_done])
    _record_crawl(context, directory, cell, method, start, reader, planner, passes)


def _read_again(
    found: RecordedCrawl, reader: JointReader, planner: CrawlPassPlanner | None
) -> Iterator[tuple[CrawlCycle, JointPlacement | None]]:
    """Recorded cycles, each with where a reader finds the joint if its profile shows it.

    Where the planner that replays them then knows beads to end, nothing is read, as in the crawl.
    """
    for cycle in found.cycles:
        placement = None
        at_bead_end = planner is not None and planner.at_bead_end(
            cycle.travel + planner.job.vehicle.laser_to_torch
        )
        if cycle.profile is not None and not at_bead_end:
            with suppress(GrooveNotFound):
                placement = reader.read(cycle.profile, cycle.travel)
        yield cycle, placement


def look_at_finished_weld(directory: Path) -> tuple[WeldPlanner, SurfaceLook]:
    """What the way back from the last pass shows, and the groove that it lies in.

    Raises
    ------
    ConfigurationError
        If its passes were not planned from looks, or not all are welded.
    LookRefused
        If the way back shows nothing of the weld.
    """
    file = directory / JOB_FILE
    context, found = CrawlContext(read_crawl_job(file), file), read_recorded_crawl(directory)
    planner, welded, length = context.make_planner(), found.passes, context.job.weld.length
    whole = len(welded) == len(context.job.passes) and all(one.is_whole(length) for one in welded)
    if planner is None or not whole:
        reason = "its passes were not planned from looks, or not all are welded: nothing to inspect"
        raise ConfigurationError(reason, file=directory)
    readings = _read_again(found, context.make_reader(), planner)
    planner.replay(tuple(found.planned), readings)
    return planner.take_look(len(welded))


def slip_after_stop(found: RecordedCrawl, job: CrawlJob) -> SlipEstimate | None:
    """What is known of slip when a crawl goes on after a stop, or after its program was killed.

    None if its method knows of none, or it never crawled. An earlier version recorded the
    estimate now and then only: the way since the last one counts as unseen, too.
    """
    crawled = found.crawling_cycles
    if not crawled or (slip := crawled[-1].slip) is None:
        return None
    last = crawled[-1]
    way = abs(last.state.odometry.speed) * (DEAD_MAN_TIME if found.was_stopped else COASTING_TIME)
    since = takewhile(lambda cycle: cycle.slip is slip, reversed(crawled))
    way += sum(abs(after.travel - cycle.travel) for after, cycle in pairwise(since))
    return slip.with_unseen_travel(way, job.steering.least_radius)


def slip_after_set_down(found: RecordedCrawl, job: CrawlJob, place: float) -> SlipEstimate | None:
    """What is known of slip when the vehicle was set down at a place; see `slip_after_stop`."""
    crawled = found.crawling_cycles
    if not crawled or (slip := crawled[-1].slip) is None:
        return None
    return slip.at_new_start(job.slip, moved=place - crawled[-1].travel)


def find_start_after_stop(
    cycles: Sequence[CrawlCycle], job: CrawlJob, overlap: float, directory: Path
) -> CrawlStart:
    """Where a crawl goes on after a stop.

    Raises
    ------
    ConfigurationError
        If the arc never burned, every pass is welded, or the job has fewer passes than were begun.
    """
    begun = max((cycle.number for cycle in cycles), default=0)
    if begun > len(job.passes):
        raise ConfigurationError(
            f"pass {begun} was begun, and the job has {len(job.passes)} left: give it back the "
            "passes that were run",
            file=directory / JOB_FILE,
            key="pass",
        )
    cut = next((cycle for cycle in reversed(cycles) if cycle.arc), None)
    if cut is None:
        reason = "no pass was begun: there is nothing to go on with. Start a new crawl"
        raise ConfigurationError(reason, file=directory)
    whole = cut.travel >= job.weld.length - abs(cut.state.odometry.speed) * PASS_END
    done = cut.number if whole else cut.number - 1
    if done >= len(job.passes):
        raise ConfigurationError("every pass is welded: nothing is left to do", file=directory)
    arc_from = 0.0 if whole else max(cut.travel - overlap, 0.0)
    # One that only waited to go on may have been given another place, and was not let go there.
    last = next(cycle for cycle in reversed(cycles) if cycle.phase is not Phase.MANUAL)
    return CrawlStart(done, last.travel, arc_from)


def calibrate_slip(context: CrawlContext, directory: Path) -> SlipCalibration:
    """Shuttle along a joint, and write what was learned of slip into a new run directory.

    Parameters
    ----------
    context : CrawlContext
        Its job's method must be the slip-aware one.
    directory : Path
        To make.

    Raises
    ------
    ConfigurationError
        If the job is wrong.
    VehicleFault, LaserFault
        If the crawler was stopped; there is no calibration then.
    """
    with add_file_to_errors(context.job_file):
        if context.job.calibration is not None:
            reason = "a calibration begins from nothing: leave this key out"
            raise ConfigurationError(reason, key="calibration")
    method = _shuttle(context, directory)
    if method.slip is None:
        raise ConfigurationError("this method learns no slip", key="method")
    found = SlipCalibration.from_estimate(method.slip, context.job.vehicle.device_id)
    write_slip_calibration(directory / CALIBRATION_FILE, found, job_label_of_run(directory))
    return found


def _shuttle(context: CrawlContext, directory: Path, *, registers: bool = False) -> FollowingMethod:
    """Shuttle along a joint, into a new run directory, and rest until the torch is registered."""
    with add_file_to_errors(context.job_file):
        if context.job.method != "slip-aware":
            raise ConfigurationError("the paper's method learns no slip", key="method")
    cell, method = _prepare_crawl(context, directory)
    cell = replace(cell, power=None)  # nothing is welded
    if cell.world is not None and isinstance(cell.world.torch, SimulatedTorchAxes):
        context = replace(context, operator=SeeingWeldOperator(cell.world, context.jog))
    record = partial(CrawlRecording, truth=cell.simulated_place)
    with record_vehicle_run(context, directory, CRAWL_RECORDING, record) as journal, cell:
        crawler = make_crawler(context, cell, method, journal)
        crawler.shuttle(SHUTTLE_LENGTH, SHUTTLE_COUNT)
        if registers:
            crawler.rest_until_registered(float(context.job.passes[0].table.height[0]))
    return method


def register_torch(context: CrawlContext, directory: Path) -> OffsetEstimate:
    """Shuttle along a joint, and find how far the torch is beside the laser's zero.

    A person jogs the torch over the middle of the joint. The estimate tells where the joint is
    below the torch, so what was jogged is what was wrong.

    Parameters
    ----------
    context : CrawlContext
        Its job's method must be the slip-aware one.
    directory : Path
        To make.

    Returns
    -------
    OffsetEstimate
        What `torch.aside_mm` should be, and the standard deviation of that by the estimate.

    Raises
    ------
    ConfigurationError
        If the job is wrong.
    CrawlStopped, VehicleFault, LaserFault
        If the crawler was stopped, or the estimate is too unsure to weld by.
    """
    torch, allowed = context.job.torch, context.job.guards.torch_sigma
    with add_file_to_errors(context.job_file):
        if torch.driver == "none":
            reason = "a torch without an axis can't be jogged over the joint: name another driver"
            raise ConfigurationError(reason, key="torch.driver")
    context.jog.limit = torch.reach - abs(torch.aside)
    sigma = _shuttle(context, directory, registers=True).torch.sigma
    if sigma > allowed:
        raise VehicleFault(
            f"the torch's place is known to {1e3 * sigma:.1f} mm, and no arc is struck above "
            f"guards.torch_sigma_mm = {1e3 * allowed:g}: name a calibration in the job, or clear "
            "a longer way, and register again"
        )
    return OffsetEstimate(torch.aside - context.jog.offset, sigma)


REPLAYABLE_KEYS: Final = ("method", "slip.", "course.")
"""Keys of what an estimator makes of a crawl, not of how it was done."""

TimedMessage = tuple[int, Topic[Any], Any]


def replay_crawl(
    directory: Path, overrides: dict[str, Any], out: Path, finished: WhenFinished = do_nothing
) -> None:
    """Feed what a crawl measured through another estimator, and write a run directory of it.

    The estimator gets the recorded odometry, commands and readings. The vehicle and the torch
    moved as they did, and a simulation's truth is the crawl's: deviations are what this
    estimator makes of the recorded motion.

    Parameters
    ----------
    directory : Path
        Of the crawl, whole, cut short or resumed; it stays as it is.
    overrides : dict
        Dotted keys and values, from `REPLAYABLE_KEYS` only.
    out : Path
        The directory to make.
    finished : callable
        Is called with it once its results are written.

    Raises
    ------
    ConfigurationError
        If there is no crawl, or a key is about how it was done.
    RecordingError
        If its recording is damaged, or the new directory can't be written.
    """
    job_file = directory / JOB_FILE
    check_replay(directory, out, overrides, REPLAYABLE_KEYS, "crawl")
    context = CrawlContext(read_crawl_job(job_file, overrides), job_file, finished=finished)
    parts = recording_files(directory, CRAWL_RECORDING)
    with add_file_to_errors(job_file):
        method = context.make_method()
    # Read to their ends before anything is made: what is no crawl, or damaged, is refused.
    places = [_place_of_set_down(part) for part in parts]
    make_vehicle_run_directory(out, context)
    origin = job_snapshot_of_file(out / JOB_FILE)
    with lock_and_clean_directory(out):
        for number, part in enumerate(parts):
            if number:
                found, place = read_recorded_crawl(out), places[number]
                slip = slip_after_stop(found, context.job)
                if place is not None:
                    slip = slip_after_set_down(found, context.job, place)
                method = context.make_method(slip)
            with RecordingWriter(out / part.name, CRAWL_TOPICS, origin) as recording:
                replayed = _replayed_messages(part, method, f"{directory}")
                while messages := list(islice(replayed, CYCLES_TOGETHER)):
                    recording.write_timed(messages)
        write_crawl_results(out)
    finished(out)


def _place_of_set_down(part: Path) -> float | None:
    """Read a part of a recording to its end: where its operator set it down; None if he did not."""
    place, is_set_down = None, False
    for entry in read_crawl_messages(part):
        if entry.topic is LOG_TOPIC:
            is_set_down |= entry.message.name == SET_DOWN_EVENT
        elif place is None and isinstance(entry.message, CrawlCycle):
            place = entry.message.travel
    return place if is_set_down else None


def _replayed_messages(part: Path, method: FollowingMethod, source: str) -> Iterator[TimedMessage]:
    """Messages of a part of a recording, its estimates made by a method.

    Its estimate of slip is in the cycles in which the part has one, and in every
    `CYCLES_TOGETHER`th of a part that has none.
    """
    time: float | None = None
    without_slip, tracer = 0, TorchTracer(method)
    for entry in read_crawl_messages(part):
        cycle = entry.message
        if not isinstance(cycle, CrawlCycle):
            is_event = entry.topic is LOG_TOPIC
            if is_event and cycle.name in TRACED_PHASES and (trace := tracer.finish()) is not None:
                yield entry.time, TRACE_TOPIC, trace
                event = event_log_message(entry.time, Log.Level.INFO, TORCH_EVENT, trace.text)
                yield entry.time, LOG_TOPIC, event
            if is_event and cycle.name == BEND_EVENT:
                method.follow_bend()
            if entry.topic is not TRACE_TOPIC and not (is_event and cycle.name == TORCH_EVENT):
                yield entry.time, entry.topic, cycle
            continue
        if time is None:
            detail = f"estimated again from {source}; nothing moved"
            event = event_log_message(entry.time, Log.Level.INFO, REPLAY_EVENT, detail)
            yield entry.time, LOG_TOPIC, event
        period = 0.0 if time is None else cycle.state.time - time
        time = cycle.state.time
        if is_by_hand(cycle.phase, cycle.commanded):
            method.forget_place()
        elif 0 < period <= LONGEST_PERIOD:  # in longer ones it did not move
            method.move(cycle.state, period, cycle.commanded)
        if cycle.was_read:
            method.read(cycle.d, cycle.d_sigma)
        if cycle.arc:
            tracer.add(cycle.number, cycle.travel, cycle.torch_y - cycle.path)
        is_due = cycle.slip is not None or without_slip >= CYCLES_TOGETHER
        slip = method.slip if is_due else None
        without_slip = 1 if slip is not None else without_slip + 1
        estimated = replace(cycle, torch=method.torch, slip=slip)
        ahead, sigma = method.laser_to_centre
        estimated = replace(estimated, laser_to_centre=ahead, laser_to_centre_sigma=sigma)
        yield from cycle_messages(entry.time, estimated)
