"""What the report of a run shows of its scan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from tjscan.core.devices import DriverKind
from tjscan.core.manifest import check_files_unaltered
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.recording.journal import RunEvent
from tjscan.recording.reader import RecordingDamage
from tjscan.result.chapter import ReportChapter, ReportChart
from tjscan.result.directory import JOB_FILE, RECORDING_FILE, SUMMARY_FILE
from tjscan.result.summary import check_recording_complete, read_summary
from tjscan.runs.run import RUN_INPUT_FILES
from tjscan.scanning.journal import ScanEvent
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ScannedSection

EVENTS_WITHOUT_WARNING: Final = (
    ScanEvent.STOP,
    ScanEvent.RESUMED,
    ScanEvent.PAUSED,
    ScanEvent.CLOCK,
    "arm",
)
"""Events that are no warning."""

EVENTS_COUNTED_IN_SUMMARY: Final = (ScanEvent.HALF_STEP,)
"""Events that the summary counts: the report reads them there."""


def scan_chapter(directory: Path) -> ReportChapter:
    """Make a scan's chapter of a report; see `tjscan.result.chapter.ChapterWriter`."""
    if not (directory / RECORDING_FILE).is_file():
        return ReportChapter()
    damages: list[RecordingDamage] = []
    check_files_unaltered(*(directory / name for name in RUN_INPUT_FILES))
    job = read_scan_job(directory / JOB_FILE)
    log = read_recorded_scan(directory, damages.append)
    check_recording_complete(directory, read_summary(directory / SUMMARY_FILE), len(log.sections))
    started = "" if log.started is None else f"{log.started:%Y-%m-%d %H:%M} UTC"
    arm, laser = (f"{one.device_id} ({one.driver})" for one in (job.arm, job.laser))
    devices = f"arm {arm}, laser {laser}"
    return ReportChapter(
        facts=(("scanned", started), ("devices", devices), ("job", _scan_in_words(job))),
        findings=(*map(str, damages), *_scan_findings(job, log.events)),
        charts=tuple(_scan_charts([log.sections[i] for i in sorted(log.sections)], job)),
        events=log.events,
        profiles=MappingProxyType({i: one.view.profile for i, one in log.sections.items()}),
        settings=job.groove,
    )


def _scan_in_words(job: ScanJob) -> str:
    scan = job.scan
    until = "to the end of the arm's reach"
    if scan.length is not None:
        until = f"over {1e3 * scan.length:g} mm"
    if scan.sections is not None:
        until = f"{scan.sections} sections"
    how = f"steps of {1e3 * scan.spacing:g} mm"
    if scan.mode == "continuous":
        how = f"a section every {1e3 * scan.spacing:g} mm, in motion at {1e3 * scan.speed:g} mm/s"
    return (
        f"{scan.direction}, {until}, {how}, pull angle {np.degrees(scan.pull_angle):g}°, "
        f"stand-off {1e3 * scan.standoff:g} mm"
    )


def _scan_findings(job: ScanJob, events: Sequence[RunEvent]) -> Iterator[str]:
    for name, count in Counter(event.name for event in events).items():
        if name not in (*EVENTS_WITHOUT_WARNING, *EVENTS_COUNTED_IN_SUMMARY):
            times = "" if count == 1 else f", {count} times"
            yield f"An event was recorded: {name}{times}. See the events."
    kinds = {job.arm.driver_kind, job.laser.driver_kind}
    if kinds == {DriverKind.REPLAYED}:
        yield "Replayed from a recording: nothing moved."
    elif DriverKind.REPLAYED in kinds:
        yield "The profiles were replayed from a recording while the arm moved."
    elif DriverKind.SIMULATED in kinds:
        yield "Simulated: no real arm and laser saw this groove."


def _scan_charts(sections: Sequence[ScannedSection], job: ScanJob) -> Iterator[ReportChart]:
    """Length of every step, and when each section was finished, or how fast it was passed."""
    index = np.array([section.view.index for section in sections], dtype=float)
    origins = np.array([section.T_b_g[:3, 3] for section in sections]).reshape(-1, 3)
    steps = 1e3 * np.linalg.norm(np.diff(origins, axis=0), axis=1)
    title, asked = "distance from the section before", 1e3 * job.scan.spacing
    yield ReportChart(title, "section", "step / mm", index[1:], steps, asked)
    times = np.array([section.view.time - sections[0].view.time for section in sections])
    if job.scan.mode == "continuous":
        with np.errstate(divide="ignore", invalid="ignore"):
            speed, asked = steps / np.diff(times), 1e3 * job.scan.speed
        yield ReportChart(
            "speed along the groove", "section", "speed / mm/s", index[1:], speed, asked
        )
        return
    yield ReportChart("time of each section", "section", "arm's clock / s", index, times)
