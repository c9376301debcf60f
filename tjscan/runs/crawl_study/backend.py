"""Studies of crawls: from the study's keys to a resolved job, and to the report."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Any, Final

from tjscan.core.config import table_to_dict, validate_table
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.runs.crawl_study.outcome import CrawlOutcome
from tjscan.runs.crawl_study.run import run_study_crawl
from tjscan.study.backend import (
    ReportedQuantity,
    ResolvedRun,
    StudyBackend,
    blame_study_for_its_keys,
)
from tjscan.study.groups import group_rows_by_keys, varied_values_by_key
from tjscan.study.overview import group_rows_by_value, keys_to_show
from tjscan.study.report import write_overview_lines
from tjscan.study.row import StudyRow
from tjscan.study.trial import canonical_json

METHOD: Final = "method"


class CrawlStudyBackend(StudyBackend[CrawlOutcome]):
    """How crawls are resolved, executed and reported in a study; keys are those of the job file."""

    outcome = CrawlOutcome
    seed = "simulation.seed"
    measures = (
        ReportedQuantity("vehicle off the joint, rms / mm", lambda m: m.vehicle_rms_mm, ".2f"),
        ReportedQuantity("torch off its path, rms / mm", lambda m: m.torch_rms_mm, ".2f"),
        ReportedQuantity("the same, p95 / mm", lambda m: m.torch_p95_mm, ".2f"),
        ReportedQuantity("stated sigma / mm", lambda m: m.sigma_mm, ".2f"),
        ReportedQuantity("profiles read / %", lambda m: m.read_percent, ".1f"),
    )

    def resolve_run(self, job_file: Path, keys: Mapping[str, Any]) -> ResolvedRun:
        """Resolve and check the settings of one crawl; see `StudyBackend.resolve_run`."""
        with blame_study_for_its_keys(keys):
            job = read_crawl_job(job_file, dict(keys))
        if job.simulation is None or job.vehicle.driver_kind is not DriverKind.SIMULATED:
            raise ConfigurationError("a study simulates: its jobs need [simulation]")
        if job.calibration is not None:
            raise ConfigurationError(
                "a study's vehicles differ, and a calibration is of one: leave this key out",
                key="calibration",
            )
        return ResolvedRun(canonical_json(table_to_dict(job)), {})

    def execute_run(self, settings: str) -> CrawlOutcome:
        """Execute one crawl; see `StudyBackend.execute_run`."""
        return run_study_crawl(validate_table(CrawlJob, json.loads(settings)))

    def special_report_lines(
        self, folder: Path, rows: Sequence[StudyRow[CrawlOutcome]]
    ) -> Iterator[str]:
        """The methods beside each other, where a study varies them, before the usual lines."""
        if METHOD not in varied_values_by_key(rows):
            return
        keys = [key for key in keys_to_show(rows, self.seed) if key != METHOD]
        for measure in self.measures:
            yield from _methods_compared(rows, keys, measure)
        yield from write_overview_lines(folder, self, rows)


CRAWL_STUDY: Final = CrawlStudyBackend()


def _methods_compared(
    rows: Sequence[StudyRow[CrawlOutcome]],
    keys: Sequence[str],
    measure: ReportedQuantity[CrawlOutcome],
) -> Iterator[str]:
    """A table of one quantity: its mean over the complete crawls of each method."""
    methods = [str(method) for (method,) in group_rows_by_keys(rows, METHOD)]
    yield f"| {measure.name}: mean of complete crawls | {' | '.join(methods)} |"
    yield f"| --- |{' ---: |' * len(methods)}"
    groups = {"all": rows} | {
        f"{key} {word}": members.rows
        for key in keys
        for word, members in group_rows_by_value(rows, key).items()
    }
    for name, members in groups.items():
        found = group_rows_by_keys(members, METHOD)
        cells = []
        for method in methods:
            group = found.get((method,))
            mean = float("nan") if group is None else group.mean_of_complete(measure.value)
            share = "" if group is None else f" ({len(group.complete_rows)} of {len(group.rows)})"
            cells.append(("–" if isnan(mean) else f"{mean:{measure.form}}") + share)
        yield f"| {name} | {' | '.join(cells)} |"
    yield ""
