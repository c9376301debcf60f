"""What another estimator makes of a recorded crawl; nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, Final

from foxglove_schemas_protobuf.Log_pb2 import Log

from tjscan.core.config import add_file_to_errors
from tjscan.core.files import lock_and_clean_directory
from tjscan.crawler.control_cycle import LONGEST_PERIOD
from tjscan.crawler.journal import SET_DOWN_EVENT, CrawlCycle, is_by_hand
from tjscan.crawler.method import FollowingMethod
from tjscan.crawler.topics import (
    CRAWL_RECORDING,
    CRAWL_TOPICS,
    CYCLES_TOGETHER,
    REPLAY_EVENT,
    cycle_messages,
    read_crawl_messages,
)
from tjscan.job.crawl.job import read_crawl_job
from tjscan.recording.foxglove import event_log_message
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import LOG_TOPIC
from tjscan.recording.parts import recording_files
from tjscan.recording.topic import Topic
from tjscan.recording.writer import RecordingWriter
from tjscan.result.directory import JOB_FILE
from tjscan.runs.crawl.results import read_recorded_crawl, write_crawl_results
from tjscan.runs.crawl.run import CrawlContext, slip_after_set_down, slip_after_stop
from tjscan.runs.run import check_replay, do_nothing_when_finished, make_vehicle_run_directory

REPLAYABLE_KEYS: Final = ("method", "slip.", "course.")
"""Keys of what an estimator makes of a crawl, not of how it was done."""

TimedMessage = tuple[int, Topic[Any], Any]


def replay_crawl(
    directory: Path,
    overrides: dict[str, Any],
    out: Path,
    finished: Callable[[Path], object] = do_nothing_when_finished,
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
    set_down = [_was_set_down(part) for part in parts]
    make_vehicle_run_directory(out, context.job, job_file, context.calibration_file)
    origin = JobSnapshot((out / JOB_FILE).read_text(encoding="utf-8"))
    with lock_and_clean_directory(out):
        for number, part in enumerate(parts):
            if number:
                known = slip_after_set_down if set_down[number] else slip_after_stop
                method = context.make_method(known(read_recorded_crawl(out), context.job))
            with RecordingWriter(out / part.name, CRAWL_TOPICS, origin) as recording:
                replayed = _replayed(part, method, f"{directory}")
                while messages := list(islice(replayed, CYCLES_TOGETHER)):
                    recording.write_timed(messages)
        write_crawl_results(out)
    finished(out)


def _was_set_down(part: Path) -> bool:
    """Read a part of a recording to its end: whether it begins where its operator set it down."""
    events = [entry.message for entry in read_crawl_messages(part) if entry.topic is LOG_TOPIC]
    return any(event.name == SET_DOWN_EVENT for event in events)


def _replayed(part: Path, method: FollowingMethod, source: str) -> Iterator[TimedMessage]:
    """Messages of a part of a recording, its estimates made by a method.

    Its estimate of slip is in the cycles in which the part has one, and in every
    `CYCLES_TOGETHER`th of a part that has none.
    """
    time: float | None = None
    without_slip = 0
    for entry in read_crawl_messages(part):
        cycle = entry.message
        if not isinstance(cycle, CrawlCycle):
            yield entry.time, entry.topic, cycle
            continue
        if time is None:
            detail = f"estimated anew from {source}; nothing moved"
            event = event_log_message(entry.time, Log.Level.INFO, REPLAY_EVENT, detail)
            yield entry.time, LOG_TOPIC, event
        period = 0.0 if time is None else cycle.state.time - time
        time = cycle.state.time
        if is_by_hand(cycle.phase, cycle.commanded):
            method.set_down_anew()
        elif 0 < period <= LONGEST_PERIOD:  # in longer ones it did not move
            method.move(cycle.state.odometry, period, cycle.commanded)
        if cycle.was_read:
            method.read(cycle.d, cycle.d_sigma)
        is_due = cycle.slip is not None or without_slip >= CYCLES_TOGETHER
        slip = method.slip if is_due else None
        without_slip = 1 if slip is not None else without_slip + 1
        yield from cycle_messages(entry.time, replace(cycle, torch=method.torch, slip=slip))
