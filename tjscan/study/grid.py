"""From a study file to its trials: every one resolved and checked before anything runs."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, Final

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.study.backend import study_backend_of_task
from tjscan.study.file import StudyFile
from tjscan.study.trial import Trial, Value, canonical_json

MOST_TRIALS: Final = 1_000_000
"""A study of more is a mistake in its file."""


def trials_of_study(study: StudyFile, study_file: Path) -> tuple[Trial, ...]:
    """All trials (runs to make) of a study, in the order of its table.

    Parameters
    ----------
    study : StudyFile
        The study.
    study_file : Path
        Where it was read from; its jobs are sought from there.

    Raises
    ------
    ConfigurationError
        For the first run that can't be, naming the key.
    """
    kind, axes = study_backend_of_task(study.task), study.varied_axes()
    jobs = [study_file.parent / name for name in study.base_jobs]
    count = len(jobs) * prod(map(len, axes))
    if count > MOST_TRIALS:
        raise ConfigurationError(
            f"makes {count} runs, {MOST_TRIALS} at most: vary less at once", file=study_file
        )
    trials: list[Trial] = []
    for job, *settings in product(jobs, *axes):
        varied: dict[str, Any] = {}
        for setting in settings:
            varied |= setting
        with add_file_to_errors(study_file):
            resolved = kind.resolve_run(job, study.fixed_settings | varied)
        named = {"job": job.stem} if len(jobs) > 1 else {}
        inputs = _cells(named | varied | dict(resolved.followed))
        trials.append(Trial(len(trials), inputs, study.task, resolved.settings))
    return tuple(trials)


def _cells(values: Mapping[str, Any]) -> dict[str, Value]:
    """Values as a table's cells; lists and tables become JSON."""
    return {
        key: value if isinstance(value, bool | int | float | str) else canonical_json(value)
        for key, value in values.items()
    }
