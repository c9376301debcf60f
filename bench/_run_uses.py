"""What may be done with a run directory of a scan, a crawl or a tow, and what comes of it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from _corpus import EXAMPLES
from _fuzz import section_ends
from _processes import LASER_FAULTS

from tjscan.core.errors import ConfigurationError
from tjscan.crawler.journal import CRAWL_RECORDING
from tjscan.job.crawl.job import read_crawl_job
from tjscan.job.files import read_scan_job
from tjscan.job.tow.job import read_tow_job
from tjscan.recording.journal import RunEvent
from tjscan.recording.reader import RecordingDamage
from tjscan.report.data import read_report_data
from tjscan.result.chapter import ReportChapter
from tjscan.result.directory import (
    BUDGET_FILE,
    CLOUD_FILE,
    JOB_FILE,
    RECORDING_FILE,
    SCAN_PICTURE,
    SECTIONS_FILE,
    SUMMARY_FILE,
)
from tjscan.result.table import read_sections_csv
from tjscan.runs.crawl.report import crawl_chapter
from tjscan.runs.crawl.results import PASSES_FILE, WELD_LOG_FILE, read_passes
from tjscan.runs.crawl.run import CrawlContext, replay_crawl, resume_crawl, run_crawl
from tjscan.runs.scan.reprocess import reprocess_run
from tjscan.runs.scan.run import ScanContext, resume_scan, run_scan
from tjscan.runs.tow.report import tow_chapter
from tjscan.runs.tow.results import (
    PLANS_FILE,
    TOW_KEY_FIGURES_FILE,
    read_recorded_tow,
    read_tow_key_figures,
)
from tjscan.runs.tow.run import TowContext, replay_tow, resume_tow, run_tow
from tjscan.scanning.journal import StopReason
from tjscan.scanning.recording import read_recorded_scan
from tjscan.towing.journal import TOW_RECORDING

SCANNED: Final = 3
"""Sections of the scan."""
NO_FAULTS: Final = dict.fromkeys(
    (
        *(f"simulation.laser.{name}" for name in (*LASER_FAULTS, "resolution_mm")),
        *("simulation.arm.repeatability_mm", "simulation.arm.repeatability_deg"),
    ),
    0.0,
)
WELD: Final = 0.03
CRAWL: Final[dict[str, Any]] = {
    "alignment.length_mm": 50,
    "alignment.longest_mm": 100,
    "alignment.offset_mm": 20,
    "alignment.offset_sigma_mm": 20,
    "alignment.in_view_s": 0.1,
    "alignment.speed_mm_s": 40,
    "guards.torch_sigma_mm": 20,
    "weld.length_m": WELD,
    "weld.run_up_mm": 30,
    "pass": [{"speed_mm_s": 20}, {"speed_mm_s": 20}],
    "simulation.vehicle.start_mm": [-30.0, 1.0],
    "simulation.joint.tacks": [],
}
"""What makes the example's crawl a short one."""
TOW: Final[dict[str, Any]] = {
    "seam.points_mm": [[2600, -300], [2600, -260]],
    "seam.speed_mm_min": 1200,
    "following.patience_s": 1,
}
"""What makes the example's tow one of 40 mm."""

KILLED_AT: Final = 0.7
"""Share of a crawl's or tow's recording that is there when its program is killed."""
ORDINARY: Final = ("Simulated", "A replay", "The way of a pass")
"""How findings begin that every run of these, or every replay, has."""
SHORTFALL_MM: Final = 2.0
"""By which a pass may be shorter than asked."""
SAME: Final = 1e-6
"""Metres or radians: half of the last digit that a table states, and what rounding leaves."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a use.

    Parameters
    ----------
    result : object
        Of data classes, sequences, arrays, numbers and texts.
    said : frozenset of str
        What a user is told to be missing, wrong or changed.
    """

    result: Any
    said: frozenset[str] = frozenset()

    def same_result(self, other: Outcome) -> bool:
        """Whether another outcome has the same result, but for rounding."""
        return _same(self.result, other.result)


Use = Callable[[Path, bool], Outcome]
"""Takes a run directory, and whether its recording may be cut."""


@dataclass(frozen=True, slots=True)
class SoundRun:
    """A run directory, and what may be done with it.

    Parameters
    ----------
    directory : Path
    recording : str
        Name of its recording.
    uses : tuple of callable
    """

    directory: Path
    recording: str
    uses: tuple[Use, ...]


@dataclass(slots=True)
class _Events:
    """A journal of scans, crawls and tows that keeps the events `changed`."""

    changes: list[str] = field(default_factory=list)

    def record(self, message: object) -> None:
        if isinstance(message, RunEvent) and message.name == "changed":
            self.changes.append(message.detail)


def make_scans(folder: Path) -> tuple[SoundRun, SoundRun]:
    """A finished scan, noise off, and the same as if it had been killed behind a section."""
    whole, file = folder / "scan", EXAMPLES / "paper.toml"
    run_scan(ScanContext(read_scan_job(file, {"scan.sections": SCANNED, **NO_FAULTS}), file), whole)
    killed = _without(whole, SECTIONS_FILE, CLOUD_FILE, SCAN_PICTURE, SUMMARY_FILE, BUDGET_FILE)
    data = (killed / RECORDING_FILE).read_bytes()
    (killed / RECORDING_FILE).write_bytes(data[: section_ends(data)[1]])
    return (
        SoundRun(whole, RECORDING_FILE, (read_scan, reprocess_scan, go_on_scanning)),
        SoundRun(killed, RECORDING_FILE, (reprocess_scan, go_on_scanning)),
    )


def make_crawls(folder: Path) -> tuple[SoundRun, SoundRun]:
    """A finished crawl, and the same as if it had been killed in its second pass."""
    whole, file = folder / "crawl", EXAMPLES / "crawl.toml"
    run_crawl(CrawlContext(read_crawl_job(file, CRAWL), file), whole)
    recording = f"{CRAWL_RECORDING}.mcap"
    killed = _cut_off(_without(whole, PASSES_FILE, WELD_LOG_FILE), recording)
    return (
        SoundRun(whole, recording, (read_crawl, read_crawl_table, replay_crawled, go_on_crawling)),
        SoundRun(killed, recording, (read_crawl, replay_crawled, go_on_crawling)),
    )


def make_tows(folder: Path) -> tuple[SoundRun, SoundRun]:
    """A finished tow, and the same as if it had been killed on its way."""
    whole, file = folder / "tow", EXAMPLES / "tow-simulation.toml"
    run_tow(TowContext(read_tow_job(file, TOW), file), whole)
    recording = f"{TOW_RECORDING}.mcap"
    killed = _cut_off(_without(whole, PLANS_FILE, TOW_KEY_FIGURES_FILE), recording)
    return (
        SoundRun(whole, recording, (read_tow, read_tow_table, replay_towed, go_on_towing)),
        SoundRun(killed, recording, (read_tow, replay_towed, go_on_towing)),
    )


def read_scan(run: Path, cut: bool) -> Outcome:
    """What a report reads of a scan."""
    damages: list[RecordingDamage] = []
    found, scan = read_report_data(run), read_recorded_scan(run, damages.append)
    views = [(view.T_b_f, view.T_b_s, view.q, view.profile.z_s) for view in scan.views]
    details = [event.detail for event in scan.events]
    said = {damage.reason for damage in damages}
    said |= {"cut"} if scan.stop is StopReason.CUT else set()
    result = (found.summary, found.sections, found.shape.points, details, views)
    return Outcome(result, frozenset(said))


def reprocess_scan(run: Path, cut: bool) -> Outcome:
    """Sections of a scan that is read again."""
    with _beside(run) as out:
        (station,) = reprocess_run(run, {}, out).stations
        points = _points(out)
    lacking = not (station.is_whole and station.summary.complete)
    return Outcome(points, frozenset({f"{len(points)} sections"} if lacking else ()))


def go_on_scanning(run: Path, cut: bool) -> Outcome:
    """Sections of a scan that goes on; wherever it was cut off, it comes to the same."""
    events = _Events()
    resume_scan(ScanContext(read_scan_job(run / JOB_FILE), run / JOB_FILE, events))
    return Outcome(_points(run), frozenset(events.changes))


def read_crawl(run: Path, cut: bool) -> Outcome:
    """What a report reads of a crawl."""
    chapter = crawl_chapter(run)
    return Outcome((chapter.facts, chapter.charts), _lacks(chapter))


def read_crawl_table(run: Path, cut: bool) -> Outcome:
    """Table of passes of a crawl."""
    return Outcome(read_passes(run))


def replay_crawled(run: Path, cut: bool) -> Outcome:
    """Passes of a crawl that is replayed."""
    with _beside(run) as out:
        replay_crawl(run, {}, out)
        return Outcome(read_passes(out), _lacks(crawl_chapter(out)))


def go_on_crawling(run: Path, cut: bool) -> Outcome:
    """Passes of a crawl that goes on; cut off at another moment it must get whole, no more."""
    events = _Events()
    with _nothing_left_to_do():
        resume_crawl(CrawlContext(read_crawl_job(run / JOB_FILE), run / JOB_FILE, events))
    rows = read_passes(run)
    whole = [float(row["length_mm"]) >= 1e3 * WELD - SHORTFALL_MM for row in rows]
    return Outcome((whole, None if cut else rows), frozenset(events.changes))


def read_tow(run: Path, cut: bool) -> Outcome:
    """What a report reads of a tow."""
    chapter = tow_chapter(run)
    return Outcome((chapter.facts, chapter.charts), _lacks(chapter))


def read_tow_table(run: Path, cut: bool) -> Outcome:
    """Figures of a tow."""
    return Outcome(tuple(read_tow_key_figures(run).items()))


def replay_towed(run: Path, cut: bool) -> Outcome:
    """Plans of a tow that is planned anew."""
    with _beside(run) as out:
        replay_tow(run, {}, out)
        return Outcome(_angles(out), _lacks(tow_chapter(out)))


def go_on_towing(run: Path, cut: bool) -> Outcome:
    """Whether a tow that goes on gets whole, and where it was not cut, by which plans."""
    events = _Events()
    with _nothing_left_to_do():
        resume_tow(TowContext(read_tow_job(run / JOB_FILE), run / JOB_FILE, events))
    done = read_recorded_tow(run).complete
    return Outcome((done, None if cut else _angles(run)), frozenset(events.changes))


def _without(whole: Path, *results: str) -> Path:
    killed = whole.with_name(f"killed {whole.name}")
    shutil.copytree(whole, killed)
    for name in results:
        (killed / name).unlink(missing_ok=True)
    return killed


def _cut_off(run: Path, recording: str) -> Path:
    data = (run / recording).read_bytes()
    (run / recording).write_bytes(data[: int(KILLED_AT * len(data))])
    return run


@contextmanager
def _beside(run: Path) -> Iterator[Path]:
    """Where to write what is made of a run; nothing is left there."""
    out = run.with_name(f"{run.name}-again")
    try:
        yield out
    finally:
        shutil.rmtree(out, ignore_errors=True)


@contextmanager
def _nothing_left_to_do() -> Iterator[None]:
    """Take a run that is whole as it is."""
    try:
        yield
    except ConfigurationError as error:
        if "nothing is left to do" not in str(error):
            raise


def _lacks(chapter: ReportChapter) -> frozenset[str]:
    """What is said to be missing or wrong in a run."""
    return frozenset(words for words in chapter.findings if not words.startswith(ORDINARY))


def _points(run: Path) -> Any:
    return np.array([section.points for section in read_sections_csv(run / SECTIONS_FILE)])


def _angles(run: Path) -> Any:
    return np.array([cycle.plan.angles for cycle in read_recorded_tow(run).cycles])


def _same(one: Any, other: Any) -> bool:
    if is_dataclass(one) and type(one) is type(other):
        return all(_same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, np.ndarray | float):
        one, other = np.asarray(one), np.asarray(other)
        return one.shape == other.shape and bool(
            np.allclose(one, other, rtol=0, atol=SAME, equal_nan=True)
        )
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other)
