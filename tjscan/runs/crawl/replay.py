"""What another estimator makes of a recorded crawl; nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from foxglove_schemas_protobuf.Log_pb2 import Log

from tjscan.core.config import add_file_to_errors
from tjscan.core.files import lock_and_clean_directory
from tjscan.crawler.control_cycle import LONGEST_PERIOD
from tjscan.crawler.journal import SET_DOWN, CrawlCycle, is_by_hand
from tjscan.crawler.method import FollowingMethod
from tjscan.crawler.topics import CRAWL_RECORDING, CYCLE, CYCLES_TOGETHER, LOG, REPLAY, SLIP, TOPICS
from tjscan.job.crawl.job import read_crawl_job
from tjscan.recording.foxglove import event_log_message
from tjscan.recording.header import JobSnapshot
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import Topic
from tjscan.recording.writer import RecordingWriter
from tjscan.result.directory import JOB_FILE
from tjscan.runs.crawl.results import read_recorded_crawl, write_passes
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
            with RecordingWriter(out / part.name, TOPICS, origin) as recording:
                for messages in _in_chunks(_replayed(part, method, f"{directory}")):
                    recording.write_timed(messages)
        write_passes(out)
    finished(out)


def _was_set_down(part: Path) -> bool:
    """Read a part of a recording to its end: whether it begins at its operator's place."""
    events = [entry.message for entry in read_messages(part, TOPICS) if entry.topic is LOG]
    return any(
        event.name == SET_DOWN
        or (event.name == "place" and event.message.endswith("as the operator says"))  # once so
        for event in events
    )


def _replayed(part: Path, method: FollowingMethod, source: str) -> Iterator[TimedMessage]:
    """Messages of a part of a recording, its estimates made by a method.

    Its estimate of slip follows each one in the part, or every `CYCLES_TOGETHER` cycles if the
    part holds none.
    """
    time: float | None = None
    without_slip, is_due = 0, False
    for entry in read_messages(part, TOPICS):
        if entry.topic is SLIP:
            is_due = True
            continue
        if entry.topic is not CYCLE:
            yield entry.time, entry.topic, entry.message
            continue
        cycle: CrawlCycle = entry.message
        if time is None:
            event = event_log_message(
                entry.time, Log.Level.INFO, REPLAY, f"estimated anew from {source}; nothing moved"
            )
            yield entry.time, LOG, event
        period = 0.0 if time is None else cycle.state.time - time
        time = cycle.state.time
        if is_by_hand(cycle.phase, cycle.commanded):
            method.set_down_anew()
        elif 0 < period <= LONGEST_PERIOD:  # in longer ones it did not move
            method.move(cycle.state.odometry, period, cycle.commanded)
        if cycle.was_read:
            method.read(cycle.d, cycle.d_sigma)
        if method.slip is not None and (is_due or without_slip >= CYCLES_TOGETHER):
            yield entry.time, SLIP, method.slip
            without_slip, is_due = 0, False
        yield entry.time, CYCLE, replace(cycle, torch=method.torch)
        without_slip += 1


def _in_chunks(messages: Iterator[TimedMessage]) -> Iterator[list[TimedMessage]]:
    """Messages, as many together as a crawl writes at once."""
    chunk: list[TimedMessage] = []
    for message in messages:
        chunk.append(message)
        if len(chunk) >= CYCLES_TOGETHER:
            yield chunk
            chunk = []
    if chunk:
        yield chunk
