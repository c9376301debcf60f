"""Studies of tows: from the study's keys to a resolved job, and to the report."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from tjscan.core.config import table_to_dict, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.job.tow.checks import read_tow_job
from tjscan.job.tow.job import TowJob
from tjscan.runs.tow_study.outcome import TowOutcome
from tjscan.runs.tow_study.run import run_study_tow
from tjscan.study.backend import (
    ReportedQuantity,
    ResolvedRun,
    StudyBackend,
    blame_study_for_its_keys,
)
from tjscan.study.overview import keys_to_show
from tjscan.study.row import StudyRow
from tjscan.study.trial import canonical_json

PAPER: Final = {
    "objective f, mean of 100": "3.5 (V-C), 4.2 (V-D)",
    "plans a second": "22",
    "estimate, mean a joint / °": "< 6",
    "touches": "0, by eye",
}
"""What Suzuki et al. (2022) print of the same quantities."""


class TowStudyBackend(StudyBackend[TowOutcome]):
    """How tows are resolved, executed and reported in a study; keys are those of the job file."""

    outcome = TowOutcome
    seed = "simulation.seed"
    measures = (
        ReportedQuantity("seam welded / mm", lambda m: m.welded_mm, ".0f"),
        ReportedQuantity("waited / s", lambda m: m.waited_s, ".1f"),
        ReportedQuantity("plans a second", lambda m: m.plan_hz, ".0f"),
        ReportedQuantity("objective f, mean of 100", lambda m: m.objective, ".2f"),
        ReportedQuantity("towing speed asked, fastest / mm/s", lambda m: m.asked_mm_s, ".1f"),
        ReportedQuantity("force on the welder, mean / N", lambda m: m.force_mean_n, ".1f"),
        ReportedQuantity("force on the welder, largest / N", lambda m: m.force_max_n, ".1f"),
        ReportedQuantity("welder off its line / mm", lambda m: m.welder_off_mm, ".2f"),
        ReportedQuantity("estimate, mean a joint / °", lambda m: m.estimate_deg, ".2f"),
        ReportedQuantity("joint angle, largest / °", lambda m: m.bend_deg, ".1f"),
        ReportedQuantity("clearance of links, least / mm", lambda m: m.link_clearance_mm, ".0f"),
        ReportedQuantity("gap between vehicles / mm", lambda m: m.vehicle_gap_mm, ".0f"),
        ReportedQuantity("touches", lambda m: m.touches, ".0f"),
    )

    def resolve_run(self, job_file: Path, keys: Mapping[str, Any]) -> ResolvedRun:
        """Resolve and check the settings of one tow; see `StudyBackend.resolve_run`."""
        with blame_study_for_its_keys(keys):
            job = read_tow_job(job_file, dict(keys))
        if job.vehicles.driver != "simulated":
            raise ConfigurationError("a study simulates", key="vehicles.driver")
        return ResolvedRun(canonical_json(table_to_dict(job)), {})

    def execute_run(self, settings: str) -> TowOutcome:
        """Execute one tow; see `StudyBackend.execute_run`."""
        return run_study_tow(validate_table(TowJob, json.loads(settings)))

    def special_report_lines(
        self, folder: Path, rows: Sequence[StudyRow[TowOutcome]]
    ) -> Iterator[str]:
        """One table of all runs, the paper's figures first, in place of the usual lines."""
        usual = {
            key: Counter(row.inputs.get(key) for row in rows).most_common(1)[0][0]
            for key in keys_to_show(rows, self.seed)
        }
        quantities = [measure.name for measure in self.measures]
        yield f"| run | ended | {' | '.join(quantities)} |"
        yield f"| --- | --- |{' ---: |' * len(quantities)}"
        printed = [PAPER.get(name, "–") for name in quantities]
        yield f"| Suzuki et al. (2022) | | {' | '.join(printed)} |"
        for row in rows:
            name = ", ".join(
                f"{key} {row.inputs.get(key)}"
                for key, value in usual.items()
                if row.inputs.get(key) != value
            )
            cells = [_cell(measure, row.outcome) for measure in self.measures]
            yield f"| {name or 'as the job is'} | {row.outcome.reason} | {' | '.join(cells)} |"
        yield ""


TOW_STUDY: Final = TowStudyBackend()


def _cell(measure: ReportedQuantity[TowOutcome], outcome: TowOutcome) -> str:
    value = measure.value(outcome)
    return "–" if value is None else f"{value:{measure.form}}"
