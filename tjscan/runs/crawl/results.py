"""What a crawl leaves behind: ``passes.csv`` and ``weld-log.json``."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from itertools import groupby
from math import isnan
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.files import write_files_atomically
from tjscan.core.frames import Array
from tjscan.core.sourced import NumberSource, mean_of_numbers, number_entry, value_entry
from tjscan.core.units import MM, MM_S, NO_UNIT
from tjscan.crawler.journal import (
    CRAWL_RECORDING,
    ArcReading,
    CrawlCycle,
    PlannedPass,
    SimulatedPlace,
    read_crawl,
)
from tjscan.crawler.pass_record import PassRecord, pass_records, root_mean_square
from tjscan.crawler.phases import Phase
from tjscan.crawler.torch_trace import TorchTrace
from tjscan.job.crawl.job import CrawlJob
from tjscan.laser.profile import Profile
from tjscan.recording.journal import RunEvent
from tjscan.recording.parts import recording_files
from tjscan.result.directory import job_label_of_run
from tjscan.runs.run import read_result_file, write_result_table
from tjscan.runs.weld.results import STRETCH_UNITS

PASSES_FILE: Final = "passes.csv"
WELD_LOG_FILE: Final = "weld-log.json"

ARC_UNITS: Final = {name: STRETCH_UNITS[name] for name in ("current", "voltage", "feed", "gas")}
"""Means that a pass's log has of its power source, and their units."""

PASS_COLUMNS: Final[dict[str, Callable[[PassRecord], object]]] = {
    "pass": lambda one: one.number,
    "length_mm": lambda one: f"{1e3 * one.length:.2f}",
    "speed_mm_s": lambda one: f"{1e3 * one.speed:.3f}",
    "vehicle_offset_rms_mm": lambda one: f"{1e3 * root_mean_square(one.offset):.3f}",
    "torch_off_rms_mm": lambda one: _mm_if_known(root_mean_square(one.torch_off)),
    "torch_off_max_mm": lambda one: _mm_if_known(one.torch_off_max),
    "torch_sigma_rms_mm": lambda one: _mm_if_known(root_mean_square(one.torch_sigma)),
    "torch_jog_mm": lambda one: f"{1e3 * one.jog:.2f}",
    "true_deviation_rms_mm": lambda one: _mm_if_known(root_mean_square(one.true_deviation)),
    "offset_error_rms_mm": lambda one: _mm_if_known(root_mean_square(one.offset_error)),
    "profiles_read_percent": lambda one: f"{100 * one.read_share:.1f}",
    "stops": lambda one: one.stops,
}
"""Columns of ``passes.csv``, and their cells."""


def _mm_if_known(length: float) -> str:
    return "" if isnan(length) else f"{1e3 * length:.3f}"


def _rounded_mm(length: float) -> float | None:
    return None if isnan(length) else round(1e3 * length, 3)


@dataclass(frozen=True, slots=True)
class RecordedCrawl:
    """What a crawl recorded, sorted.

    Parameters
    ----------
    cycles : tuple of CrawlCycle
    passes : tuple of PassRecord
    events : tuple of RunEvent
    places : tuple of (CrawlCycle, SimulatedPlace)
        Where a simulated vehicle truly was; empty for a real one.
    planned : mapping of int to PlannedPass
        Passes that were planned from looks, as they were planned last, by their numbers.
    readings : tuple of ArcReading
        Of the power source.
    was_stopped : bool
        Whether what crawled last ends with a stop; else its program was killed. One that only
        waited to go on, and was refused or interrupted, does not count.
    """

    cycles: tuple[CrawlCycle, ...]
    passes: tuple[PassRecord, ...]
    events: tuple[RunEvent, ...]
    places: tuple[tuple[CrawlCycle, SimulatedPlace], ...]
    was_stopped: bool
    planned: Mapping[int, PlannedPass] = field(default_factory=dict)
    readings: tuple[ArcReading, ...] = ()

    @property
    def true_arcs(self) -> Iterator[tuple[int, Array]]:
        """Number of the pass, and the torch's true way in a simulation, of each arc.

        The way has shape (k, 3): seconds, place along the joint, and to the right of it, metres.
        """
        before: list[tuple[CrawlCycle, SimulatedPlace]] = []
        for (arc, number), group in groupby(self.places, lambda one: (one[0].arc, one[0].number)):
            one = list(group)
            if arc:  # struck where the place before was recorded
                way = [(c.state.time, p.torch[0], p.torch[1] + c.torch_y) for c, p in before + one]
                yield number, np.array(way)
            before = one[-1:]

    def details_of(self, event_name: str) -> list[str]:
        """Details of all events of a name."""
        return [event.detail for event in self.events if event.name == event_name]

    @property
    def crawling_cycles(self) -> list[CrawlCycle]:
        """The cycles but for those in which it was driven by hand or waited to go on."""
        return [cycle for cycle in self.cycles if cycle.phase is not Phase.MANUAL]

    @property
    def profiles(self) -> list[tuple[CrawlCycle, Profile]]:
        """The recorded profiles, each with its cycle."""
        return [(cycle, cycle.profile) for cycle in self.cycles if cycle.profile is not None]


def read_recorded_crawl(directory: Path) -> RecordedCrawl:
    """Read what a crawl recorded, over all its parts; raises as `read_crawl` does."""
    cycles: list[CrawlCycle] = []
    places: list[tuple[CrawlCycle, SimulatedPlace]] = []
    events: list[RunEvent] = []
    traces: list[TorchTrace] = []
    planned: dict[int, PlannedPass] = {}
    readings: list[ArcReading] = []
    was_stopped = False
    for entry in read_crawl(directory):
        if isinstance(entry, CrawlCycle):
            cycles.append(entry)
            was_stopped &= entry.phase is Phase.MANUAL
        elif isinstance(entry, RunEvent):
            events.append(entry)
            if entry.name == Phase.STOP and cycles:
                was_stopped |= cycles[-1].phase is not Phase.MANUAL
        elif isinstance(entry, TorchTrace):
            traces.append(entry)
        elif isinstance(entry, PlannedPass):
            planned[entry.number] = entry
        elif isinstance(entry, ArcReading):
            readings.append(entry)
        elif cycles:
            places.append((cycles[-1], entry))
    return RecordedCrawl(
        tuple(cycles),
        pass_records(cycles, places, traces),
        tuple(events),
        tuple(places),
        was_stopped,
        planned,
        tuple(readings),
    )


def write_crawl_results(directory: Path, job: CrawlJob | None = None) -> None:
    """Write the results of a crawl from its recording, whole or cut off.

    Parameters
    ----------
    directory : Path
        Of the run.
    job : CrawlJob, optional
        Of the weld; without it nothing was welded, and there is no log.

    Raises
    ------
    RecordingError
        If a file can't be written, or the recording is damaged.
    """
    recorded = read_recorded_crawl(directory)
    with write_files_atomically(directory) as draft:
        write_result_table(draft / PASSES_FILE, directory, PASS_COLUMNS, recorded.passes)
        if job is not None:
            log = json.dumps(weld_log(directory, job, recorded), indent=2)
            (draft / WELD_LOG_FILE).write_text(log + "\n", encoding="utf-8")


def read_passes(directory: Path) -> tuple[dict[str, str], ...]:
    """Rows of a run's ``passes.csv``, as text.

    Raises
    ------
    ConfigurationError
        If there is none.
    """
    return read_result_file(
        directory / PASSES_FILE,
        "the passes of a crawl",
        lambda text: tuple(csv.DictReader(x for x in text.splitlines() if x[:1] != "#")),
    )


def weld_log(directory: Path, job: CrawlJob, recorded: RecordedCrawl) -> dict[str, Any]:
    """The log of a weld as files of ISO 3834 ask for it: who, how, when, how fast, how far off."""
    weld = job.weld
    return {
        "joint": weld.joint,
        "welder": weld.welder,
        "job": job_label_of_run(directory),
        "bends_assumed": _bends_assumed(recorded),
        "recordings": [
            {"file": file.name, "sha256": sha256(file.read_bytes()).hexdigest()}
            for file in recording_files(directory, CRAWL_RECORDING)
        ],
        "passes": [
            {
                "pass": one.number,
                "procedure": job.passes[one.number - 1].procedure or weld.procedure,
                "arcs_mm": [[round(1e3 * place, 2) for place in arc] for arc in one.arcs],
                "seconds": round(one.seconds, 2),
                "length_mm": round(1e3 * one.length, 2),
                "travel_speed_mm_s": round(1e3 * one.speed, 3),
                "torch_off_rms_mm": _rounded_mm(root_mean_square(one.torch_off)),
                "torch_off_max_mm": _rounded_mm(one.torch_off_max),
                "torch_sigma_rms_mm": _rounded_mm(root_mean_square(one.torch_sigma)),
                "torch_jog_mm": round(1e3 * one.jog, 2),
                "stops": one.stops,
                **_look_and_arc(recorded, one.number),
            }
            for one in recorded.passes
        ],
        "stops": [
            {"time": event.time.isoformat(timespec="milliseconds"), "reason": event.detail}
            for event in recorded.events
            if event.name == Phase.STOP
        ],
    }


def _bends_assumed(recorded: RecordedCrawl) -> list[dict[str, Any]]:
    """Where the joint was taken to bend at last, with how far aside: no person stated it."""
    known = [(one.travel, one.slip) for one in recorded.cycles if one.slip is not None]
    return [
        {
            name: value_entry(number, NumberSource.BELIEVED, MM)
            for name, number in (
                ("from", travel + start),
                ("to", travel + end),
                ("aside", aside),
                ("aside_sigma", sigma),
            )
        }
        for travel, slip in known[-1:]
        for start, end, aside, sigma in slip.bends
    ]


def _look_and_arc(recorded: RecordedCrawl, number: int) -> dict[str, Any]:
    """What a pass was planned from, and what its power source reported; each with its source."""
    found: dict[str, Any] = {}
    believed, measured = NumberSource.BELIEVED, NumberSource.MEASURED
    if (planned := recorded.planned.get(number)) is not None:
        seen = NumberSource.SIMULATED if recorded.places else measured
        closed = None if planned.closed is None else float(planned.closed.mean())
        found["look_before"] = {
            "read": value_entry(1 - planned.unread, seen, NO_UNIT),
            "torch_deviation": value_entry(planned.deviation, seen, MM),
            "torch_deviation_sigma": value_entry(planned.deviation_sigma, believed, MM),
            "deposition_gain": value_entry(planned.gain, believed, NO_UNIT),
            "torch_offset": value_entry(planned.torch_offset, believed, MM),
            "shrinkage_factor": value_entry(planned.shrinkage, believed, NO_UNIT),
            "closed": value_entry(closed, seen, MM),
            "speed_least": value_entry(planned.speed.min(), NumberSource.SET, MM_S),
            "speed_most": value_entry(planned.speed.max(), NumberSource.SET, MM_S),
            "feed_mean": value_entry(planned.feed.mean(), NumberSource.SET, ARC_UNITS["feed"]),
            "at_a_limit_of_the_wps": value_entry(planned.at_limit, believed, NO_UNIT),
        }
    if readings := [one for one in recorded.readings if one.number == number]:
        found["arc"] = {
            name: number_entry(mean_of_numbers([getattr(one, name) for one in readings]), unit)
            for name, unit in ARC_UNITS.items()
        }
        raised = float(np.mean([one.raised for one in readings]))
        found["arc"]["raised"] = value_entry(raised, NumberSource.SET, MM)
    return found
