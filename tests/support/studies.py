"""Studies of the example, as tests need them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w
from cells import PAPER

from tjscan.runs.scan.study import StudyScanSettings
from tjscan.runs.tasks import study_backend_of_task
from tjscan.study.plan import StudyPlan, folder_of_files, plan_study
from tjscan.study.trial import ResolvedRun, Trial

ANY_JOINT = PAPER.parent / "any-joint.toml"
Expand = Callable[..., StudyPlan]


def expand_in(folder: Path) -> Expand:
    """Trials of a study that is written to a file first."""

    def trials(**tables: Any) -> StudyPlan:
        file = folder / "study.toml"
        file.write_text(tomli_w.dumps({"job": str(PAPER), **tables}), encoding="utf-8")
        return plan_study(file, study_backend_of_task)

    return trials


def resolved_of(plan: StudyPlan, trial: Trial) -> ResolvedRun:
    folder = folder_of_files(frozenset(plan.files.items()))
    return plan.resolve(trial, study_backend_of_task(plan.file.task), folder)


def settings_of(plan: StudyPlan, trial: Trial) -> StudyScanSettings:
    resolved = resolved_of(plan, trial)
    return StudyScanSettings.from_json_text(resolved.settings)
