"""Go on with a crawl that was interrupted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError, GrooveNotFound
from tjscan.crawler.crawler import CrawlStart
from tjscan.crawler.joint_tracking.memory import RememberingTracker
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.last_view import GOES_ON, LastView
from tjscan.crawler.pass_record import END
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import SlipBelief
from tjscan.crawler.topics import REPLAY
from tjscan.job.crawl.cell import InterruptedWorld, make_crawl_cell
from tjscan.job.crawl.job import CrawlJob
from tjscan.laser.profile import Profile
from tjscan.result.directory import JOB
from tjscan.runs.crawl.results import RecordedCrawl, read_recorded_crawl
from tjscan.runs.crawl.run import CrawlContext, check_size, crawl_into
from tjscan.vehicle.vehicle import DEAD_MAN

OVERLAP: Final = 0.02
"""Metres by which a weld that goes on after a stop overlaps what was welded before."""

OFF_WAY: Final = 1.0
"""Metres beyond a crawl's way at which its vehicle may be set down."""


def resume_crawl(
    context: CrawlContext, overlap: float = OVERLAP, place: float | None = None
) -> None:
    """Go on with an interrupted crawl, in its run directory.

    Parameters
    ----------
    context : CrawlContext
        The job as the run directory holds it.
    overlap : float, optional
        By which the weld overlaps what was welded before the stop, metres.
    place : float, optional
        Where the torch stands along the joint, metres, if the vehicle was moved since. Where left
        out, it must stand where it stood, as far as the laser can tell; the recording must show
        hull beside the joint.

    Raises
    ------
    ConfigurationError
        If there is nothing to go on with, no such place, or nothing shows where it stood.
    CrawlStopped
        If the laser shows that the vehicle was moved; and as `run_crawl` raises.
    """
    directory = context.job_file.parent
    found = read_recorded_crawl(directory)
    if any(event.name == REPLAY for event in found.events):
        raise ConfigurationError(
            "is a replay: nothing was welded there. Resume the crawl itself", file=directory
        )
    start = start_after_stop(found.cycles, context.job, overlap, directory)
    last, left = found.cycles[-1], None
    # One that waits to go on, and is refused, may stand where it was moved to.
    crawled = [cycle for cycle in found.cycles if cycle.phase is not Phase.MANUAL]
    if place is None:
        view = LastView.of_recording(crawled, found.profiles, stopped=found.was_stopped)
        if view is None:
            raise ConfigurationError(
                "no recorded profile shows the joint with enough hull beside it, so nobody can "
                "look whether the vehicle was moved since: say with --place where the torch stands",
                file=directory,
            )
        start, belief = replace(start, last_view=view), belief_after_stop(found, context.job)
    else:
        check_place(place, context.job)
        start = replace(start, travel=place, was_set_down=True)
        belief = belief_where_set_down(found, context.job)
    if found.places:
        arcs = [one.true_travel for one in found.passes if len(one.true_travel)]
        pose_w = np.array(found.places[-1][1].pose_w)
        left = InterruptedWorld(
            pose_w, last.state.time, tuple((arc.min(), arc.max()) for arc in arcs)
        )
    with add_file_to_errors(context.job_file):
        check_size(context.job)
        cell = make_crawl_cell(context.job, left)
    method = context.make_method(belief)
    crawl_into(context, directory, cell, method, start, reader_that_saw(found.profiles))


def belief_after_stop(found: RecordedCrawl, job: CrawlJob) -> SlipBelief | None:
    """What is known of slip where a crawl goes on that was stopped, or whose program was killed.

    None where its method knows of none, or it never crawled. An earlier version recorded the
    belief now and then only: the way since the last one counts as unseen, too.
    """
    crawled = [cycle for cycle in found.cycles if cycle.phase is not Phase.MANUAL]
    if not crawled or (slip := crawled[-1].slip) is None:
        return None
    last = crawled[-1]
    way = abs(last.state.odometry.speed) * (DEAD_MAN if found.was_stopped else GOES_ON)
    since = takewhile(lambda cycle: cycle.slip is slip, reversed(crawled))
    way += sum(abs(after.travel - cycle.travel) for after, cycle in pairwise(since))
    return slip.after_unseen_way(way, job.steering.least_radius)


def belief_where_set_down(found: RecordedCrawl, job: CrawlJob) -> SlipBelief | None:
    """What is known of slip where the vehicle was set down anew; see `belief_after_stop`."""
    crawled = [cycle for cycle in found.cycles if cycle.phase is not Phase.MANUAL]
    slip = crawled[-1].slip if crawled else None
    return None if slip is None else slip.at_new_start(job.slip)


def check_place(place: float, job: CrawlJob) -> None:
    """Refuse a place from which a crawl can't go on: more than a metre off its way.

    Raises
    ------
    ConfigurationError
        If it is one.
    """
    first, last = -job.weld.run_up - OFF_WAY, job.weld.length + OFF_WAY
    if not first <= place <= last:
        raise ConfigurationError(
            f"--place is {1e3 * place:g} mm along the joint, from where the weld begins; it must "
            f"lie between {1e3 * first:g} and {1e3 * last:g}"
        )


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
        If the arc never burned, every pass is welded, or the job has fewer passes than were begun.
    """
    begun = max((cycle.number for cycle in cycles), default=0)
    if begun > len(job.passes):
        raise ConfigurationError(
            f"pass {begun} was begun, and the job has {len(job.passes)} left: give it back the "
            "passes that were run",
            file=directory / JOB,
            key="pass",
        )
    burned = [cycle for cycle in cycles if cycle.arc]
    if not burned:
        raise ConfigurationError(
            "no pass was begun: there is nothing to go on with. Start a new crawl", file=directory
        )
    cut = burned[-1]
    end = job.weld.length
    whole = cut.travel >= end - abs(cut.state.odometry.speed) * END
    done = cut.number if whole else cut.number - 1
    if done >= len(job.passes):
        raise ConfigurationError("every pass is welded: nothing is left to do", file=directory)
    arc_from = 0.0 if whole else max(cut.travel - overlap, 0.0)
    # One that only waited to go on may have been told another place, and was not let go there.
    crawled = [cycle for cycle in cycles if cycle.phase is not Phase.MANUAL]
    return CrawlStart(done, crawled[-1].travel, arc_from)
