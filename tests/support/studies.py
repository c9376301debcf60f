"""Studies of the example, as tests need them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w
from cells import PAPER

from tjscan.runs.scan.study import StudyScanSettings
from tjscan.runs.tasks import study_backend_of_task
from tjscan.study.file import read_study_file, trials_of_study
from tjscan.study.trial import Trial

ANY_JOINT = PAPER.parent / "any-joint.toml"
Expand = Callable[..., tuple[Trial, ...]]


def expand_in(folder: Path) -> Expand:
    """Trials of a study that is written to a file first."""

    def trials(**tables: Any) -> tuple[Trial, ...]:
        file = folder / "study.toml"
        file.write_text(tomli_w.dumps({"job": str(PAPER), **tables}), encoding="utf-8")
        return trials_of_study(
            read_study_file(file, study_backend_of_task), file, study_backend_of_task
        )

    return trials


def settings_of(trial: Trial) -> StudyScanSettings:
    return StudyScanSettings.from_json_text(trial.settings)
