"""Crawl along a joint as a job says, or go on with a crawl that was interrupted."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import tomli_w

from tjscan.core.config import add_file_to_errors, table_to_dict
from tjscan.core.errors import ConfigurationError, GrooveNotFound
from tjscan.core.files import lock_and_clean_directory
from tjscan.crawler.crawler import (
    CrawlDevices,
    Crawler,
    CrawlPlan,
    CrawlStart,
    JointReader,
    WeldOperator,
)
from tjscan.crawler.guards import Guards
from tjscan.crawler.joint_memory import RememberingTracker
from tjscan.crawler.journal import (
    CombinedCrawlJournal,
    CrawlCycle,
    CrawlJournal,
)
from tjscan.crawler.method import FollowingMethod
from tjscan.crawler.paper_method import PaperMethod
from tjscan.crawler.proximity import CornerPlaces, ProximityFilter
from tjscan.crawler.slip_aware import SlipAwareMethod
from tjscan.crawler.slip_calibration import read_slip_calibration
from tjscan.crawler.slip_estimator import SlipBelief
from tjscan.crawler.topics import (
    CRAWL_RECORDING,
    REPLAY,
    record_crawl,
)
from tjscan.job.crawl_cell import CrawlCell, LeftWorld, make_crawl_cell
from tjscan.job.crawl_job import CrawlJob
from tjscan.laser.profile import Profile
from tjscan.recording.header import JobSnapshot
from tjscan.recording.writer import next_recording_file
from tjscan.result.directory import CALIBRATION, JOB
from tjscan.runs.context import do_nothing_when_finished
from tjscan.runs.crawl_results import read_recorded_crawl, write_crawl_results
from tjscan.runs.directory import empty_run_directory, write_job_copy

OVERLAP: Final = 0.02
"""Metres by which a weld that goes on after a stop overlaps what was welded before."""


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
    """

    job: CrawlJob
    job_file: Path
    journal: CrawlJournal = field(default_factory=CombinedCrawlJournal)
    operator: WeldOperator = field(default_factory=WeldsAlways)
    finished: Callable[[Path], object] = do_nothing_when_finished

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
        CrawlDevices(cell.vehicle, cell.laser, cell.torch, reader or RememberingTracker()),
        CrawlPlan(job.alignment, job.weld, job.passes),
        method,
        Guards(job.guards, ProximityFilter(job.proximity), corners),
        context.operator,
        journal,
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
        method = context.make_method()
        cell = make_crawl_cell(context.job)
        make_crawl_directory(context, directory)
    _crawl(context, directory, cell, method)


def resume_crawl(context: CrawlContext, overlap: float = OVERLAP) -> None:
    """Go on with an interrupted crawl, in its run directory.

    Parameters
    ----------
    context : CrawlContext
        The job as the run directory holds it.
    overlap : float, optional
        By which the weld overlaps what was welded before the stop, metres.

    Raises
    ------
    ConfigurationError
        If there is nothing to go on with.
    """
    directory = context.job_file.parent
    found = read_recorded_crawl(directory)
    if any(event.name == REPLAY for event in found.events):
        raise ConfigurationError(
            "is a replay: nothing was welded there. Resume the crawl itself", file=directory
        )
    start = start_after_stop(found.cycles, context.job, overlap, directory)
    last, left = found.cycles[-1], None
    if found.places:
        arcs = [one.true_travel for one in found.passes if len(one.true_travel)]
        pose_w = np.array(found.places[-1][1].pose_w)
        left = LeftWorld(pose_w, last.state.time, tuple((arc.min(), arc.max()) for arc in arcs))
    with add_file_to_errors(context.job_file):
        cell = make_crawl_cell(context.job, left)
    method = context.make_method(last.slip)
    _crawl(context, directory, cell, method, start, reader_that_saw(found.profiles))


def reader_that_saw(profiles: Iterable[tuple[CrawlCycle, Profile]]) -> RememberingTracker:
    """Make the reader of a crawl that goes on: it remembers what the recorded profiles show."""
    reader = RememberingTracker()
    for cycle, profile in profiles:
        with suppress(GrooveNotFound):
            reader.read(profile, cycle.travel)
    return reader


def start_after_stop(
    cycles: Sequence[CrawlCycle], job: CrawlJob, overlap: float, directory: Path
) -> CrawlStart:
    """Where a crawl goes on after a stop.

    Raises
    ------
    ConfigurationError
        If the arc never burned, or every pass is welded.
    """
    burned = [cycle for cycle in cycles if cycle.arc]
    if not burned:
        raise ConfigurationError(
            "no pass was begun: there is nothing to go on with. Start a new crawl", file=directory
        )
    cut = burned[-1]
    end = job.weld.length
    whole = cut.travel >= end - abs(cut.state.odometry.speed) * 0.1
    done = cut.number if whole else cut.number - 1
    if done >= len(job.passes):
        raise ConfigurationError("every pass is welded: nothing is left to do", file=directory)
    arc_from = 0.0 if whole else max(cut.travel - overlap, 0.0)
    return CrawlStart(done, cycles[-1].travel, arc_from)


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


def _crawl(
    context: CrawlContext,
    directory: Path,
    cell: CrawlCell,
    method: FollowingMethod,
    start: CrawlStart | None = None,
    reader: JointReader | None = None,
) -> None:
    """Crawl, record, and write the results, however it ended."""
    origin = JobSnapshot((directory / JOB).read_text(encoding="utf-8"))
    file = next_recording_file(directory, CRAWL_RECORDING)
    with lock_and_clean_directory(directory):
        try:
            with record_crawl(file, origin, cell.simulated_place) as recording, cell:
                journal = CombinedCrawlJournal((recording, context.journal))
                make_crawler(context, cell, method, journal, reader).run(start)
        finally:
            write_crawl_results(directory, context.job)
            context.finished(directory)
