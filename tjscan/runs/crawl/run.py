"""Crawl along a joint as a job says."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import tomli_w

from tjscan.core.config import add_file_to_errors, table_to_dict
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import lock_and_clean_directory
from tjscan.crawler.control_cycle import CrawlDevices
from tjscan.crawler.crawler import (
    Crawler,
    CrawlPlan,
    CrawlStart,
    WeldOperator,
)
from tjscan.crawler.guards import Guards
from tjscan.crawler.hand_drive import HandDrive
from tjscan.crawler.joint_sensor import JointReader
from tjscan.crawler.joint_tracking.memory import RememberingTracker
from tjscan.crawler.journal import (
    CombinedCrawlJournal,
    CrawlJournal,
)
from tjscan.crawler.method import FollowingMethod
from tjscan.crawler.paper_method import PaperMethod
from tjscan.crawler.proximity import CornerPlaces, ProximityFilter
from tjscan.crawler.sizing import broken_rules
from tjscan.crawler.slip_aware import SlipAwareMethod
from tjscan.crawler.slip_calibration import read_slip_calibration
from tjscan.crawler.slip_estimator import SlipBelief
from tjscan.crawler.slip_model import SlipState
from tjscan.crawler.topics import (
    CRAWL_RECORDING,
    WARNING,
    record_crawl,
)
from tjscan.job.crawl.cell import CrawlCell, make_crawl_cell
from tjscan.job.crawl.job import CrawlJob
from tjscan.recording.header import JobSnapshot
from tjscan.recording.parts import next_recording_file
from tjscan.result.directory import CALIBRATION, JOB
from tjscan.runs.context import do_nothing_when_finished
from tjscan.runs.crawl.results import write_crawl_results
from tjscan.runs.directory import accept_edited_copies, empty_run_directory, write_job_copy

TO_SETTLE: Final = 4.0
"""Times 1 / gain, after which a tenth of what a reversal brings is left: (1 + 4) exp(-4)."""

TO_TURN: Final = 4.0
"""Times crab and least radius: as far as curvature alone brings the vehicle aside and back, so that
the mean of its slope is no longer outward."""


class WeldsAlways:
    """A `WeldOperator` of a simulation: everything is always ready."""

    def confirm_weld(self, number: int) -> bool:
        """Confirm at once."""
        return True


@dataclass(frozen=True)
class CrawlContext:
    """A crawl job with its file, and where its run reports to.

    Parameters
    ----------
    job : CrawlJob
    job_file : Path
        Where it was read from; a calibration is sought from there.
    journal : CrawlJournal
        Receives everything, once it is on disk.
    operator : WeldOperator
        Confirms each pass.
    finished : callable
        Is called with the directory once its results are written.
    hand : HandDrive, optional
        Who drives by hand before the crawl begins; nobody where left out.
    """

    job: CrawlJob
    job_file: Path
    journal: CrawlJournal = field(default_factory=CombinedCrawlJournal)
    operator: WeldOperator = field(default_factory=WeldsAlways)
    finished: Callable[[Path], object] = do_nothing_when_finished
    hand: HandDrive | None = None

    @property
    def first_belief(self) -> SlipBelief:
        """What is known of the vehicle's slip before the first reading.

        Raises
        ------
        ConfigurationError
            If the calibration that the job names can't be read, or is another vehicle's.
        """
        job, course = self.job, self.job.course
        if job.calibration is None:
            return SlipBelief.before_any_reading(
                job.slip, curvature=course.curvature, curvature_sigma=course.curvature_sigma
            )
        file = self.job_file.parent / job.calibration
        found = read_slip_calibration(file, job.vehicle.device_id)
        return found.belief_at_start(job.slip, course.curvature, course.curvature_sigma)

    def make_method(self, belief: SlipBelief | None = None) -> FollowingMethod:
        """Make the method that the job names, with what is known of slip."""
        job = self.job
        if job.method == "paper":
            return PaperMethod(job.vehicle.geometry, job.vehicle.tracks)
        known = belief or self.first_belief
        return SlipAwareMethod(job.vehicle.geometry, known, job.slip, job.steering)


def make_crawler(
    context: CrawlContext,
    cell: CrawlCell,
    method: FollowingMethod,
    journal: CrawlJournal,
    reader: JointReader | None = None,
) -> Crawler:
    """Make the crawler of a job in a cell whose devices are connected.

    Parameters
    ----------
    context : CrawlContext
    cell : CrawlCell
    method : FollowingMethod
    journal : CrawlJournal
    reader : JointReader, optional
        Which remembers the joint already; one that has seen nothing where left out.
    """
    job = context.job
    corners = CornerPlaces(job.vehicle.body_length, job.vehicle.body_width)
    return Crawler(
        CrawlDevices(
            cell.vehicle, cell.laser, cell.torch, reader or RememberingTracker(), cell.clock
        ),
        CrawlPlan(job.alignment, job.weld, job.passes),
        method,
        Guards(job.guards, ProximityFilter(job.proximity), corners),
        context.operator,
        journal,
        context.hand,
    )


def check_size(job: CrawlJob) -> None:
    """Refuse a vehicle that its job asks for more than its sizing allows; see `size_crawler`.

    Raises
    ------
    ConfigurationError
        If magnets, motors or the tightest turn break a rule. A turn may take what the motors have
        and the guard lets pass.
    """
    size = replace(job.size, torque=min(job.size.torque, job.guards.torque))
    for one in broken_rules(size, job.vehicle.tracks, job.steering.least_radius):
        raise ConfigurationError(
            f"{one.name} is {one.value:.3g} {one.unit}".rstrip()
            + f", and must be {one.rule}: {one.advice}. tjscan crawl size shows all",
            key="size",
        )


def short_way(job: CrawlJob, slip: SlipBelief | None) -> str:
    """What is to be said of passes too short to come back from a reversal; empty for others.

    At a reversal the slope against the joint turns round, and crab adds to it both ways: the
    heading must change by twice the crab, at the curvature of the least radius, and then bring back
    what the vehicle was carried aside meanwhile.

    Parameters
    ----------
    job : CrawlJob
    slip : SlipBelief or None
        What is known of slip; nothing is said where a method knows of none.
    """
    if slip is None:
        return ""
    crab = abs(float(slip.x[SlipState.CRAB])) + slip.sigma(SlipState.CRAB)
    way = job.weld.run_up + job.weld.length
    needed = TO_SETTLE / job.steering.gain + TO_TURN * crab * job.steering.least_radius
    if way >= needed:
        return ""
    return (
        f"the way of a pass, {1e3 * way:.0f} mm with its run-up, is shorter than the "
        f"{1e3 * needed:.0f} mm in which a vehicle that may crab by {1e3 * crab:.0f} mrad surely "
        "comes back after a reversal: each may carry it farther aside. Make weld.run_up_mm longer, "
        "or calibrate"
    )


def run_crawl(context: CrawlContext, directory: Path) -> None:
    """Crawl as a job says, into a new run directory.

    Raises
    ------
    TjscanError
        If the job is wrong, a guard stops the crawler or a device fails; the recording holds
        what happened until then, and the results are written from it.
    """
    with add_file_to_errors(context.job_file):
        check_size(context.job)
        method = context.make_method()
        cell = make_crawl_cell(context.job)
        make_crawl_directory(context, directory)
    crawl_into(context, directory, cell, method)


def make_crawl_directory(context: CrawlContext, directory: Path) -> None:
    """Make a run directory with the job in it, and the calibration that it names.

    Raises
    ------
    ConfigurationError
        If the directory holds something already.
    RecordingError
        If it can't be made.
    """
    job = context.job
    with empty_run_directory(directory) as draft:
        if job.calibration is not None:
            shutil.copyfile(context.job_file.parent / job.calibration, draft / CALIBRATION)
            job = job.model_copy(update={"calibration": CALIBRATION})
        write_job_copy(draft, tomli_w.dumps(table_to_dict(job)), context.job_file, "w")


def crawl_into(
    context: CrawlContext,
    directory: Path,
    cell: CrawlCell,
    method: FollowingMethod,
    start: CrawlStart | None = None,
    reader: JointReader | None = None,
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
    """
    origin = JobSnapshot((directory / JOB).read_text(encoding="utf-8"))
    file = next_recording_file(directory, CRAWL_RECORDING)
    with lock_and_clean_directory(directory):
        try:
            with record_crawl(file, origin, cell.simulated_place) as recording, cell:
                journal = CombinedCrawlJournal((recording, context.journal))
                accept_edited_copies(directory, journal.record_event)
                if short := short_way(context.job, method.slip):
                    journal.record_event(WARNING, short)
                make_crawler(context, cell, method, journal, reader).run(start)
        finally:
            write_crawl_results(directory, context.job)
            context.finished(directory)
