"""The study file, and the trials that it makes."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from math import prod
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field

from tjscan.core.config import StrictFileModel, add_file_to_errors, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.recording.header import flatten_to_dotted_keys
from tjscan.study.trial import BackendOfTask, Trial, Value, canonical_json

Names = Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
Tables = Annotated[tuple[dict[str, Any], ...], Field(strict=False)]


class StudyFile(StrictFileModel):
    """A study file: base jobs, and the settings that are fixed or varied.

    Parameters
    ----------
    task : str
        Which algorithm runs; it determines which keys there are.
    job : str or tuple of str
        The base job, or several.
    seeds : int, optional
        How many seeds of the random numbers every setting is run with.
    fixed, grid, together
        Dotted keys: with the value of every run; with values whose combinations are all run;
        and tables of such lists that go together, entry by entry.
    """

    task: str = "scan"
    job: str | Names
    seeds: int | None = Field(default=None, ge=1, le=100_000)
    fixed: dict[str, Any] = Field(default_factory=dict)
    grid: dict[str, Any] = Field(default_factory=dict)
    together: Tables = ()

    @property
    def fixed_settings(self) -> dict[str, Any]:
        """Dotted keys and values that are the same in every run."""
        return flatten_to_dotted_keys(self.fixed)

    def settings_by_axis(self, backend_of: BackendOfTask) -> list[list[dict[str, Any]]]:
        """Lists of the settings that are varied; a study runs their product.

        Each list holds the settings of one axis, a setting being dotted keys and their values.

        Parameters
        ----------
        backend_of : callable
            Gives the backend of the study's task.

        Raises
        ------
        ConfigurationError
            If an axis has no values, values are no list, a key occurs twice, or lists that go
            together differ in length.
        """
        grid = flatten_to_dotted_keys(self.grid)
        axes = [[{key: value} for value in _swept_values(key, grid[key])] for key in grid]
        axes += [_settings_that_go_together(flatten_to_dotted_keys(one)) for one in self.together]
        if self.seeds is not None:
            key = backend_of(self.task).seed
            axes.append([{key: seed} for seed in range(1, self.seeds + 1)])
        keys = [key for axis in axes for key in axis[0]]
        for key in keys:
            if keys.count(key) > 1 or key in self.fixed_settings:
                raise ConfigurationError("occurs twice in the study", key=key)
        return axes


def read_study_file(file: Path, backend_of: BackendOfTask) -> StudyFile:
    """Read a study file; for `backend_of` see `StudyFile.settings_by_axis`.

    Raises
    ------
    ConfigurationError
        If it can't be read, or a key is unknown, missing or of a wrong type or value.
    """
    study = validate_table(StudyFile, read_toml(file), file)
    with add_file_to_errors(file):
        study.settings_by_axis(backend_of)
    return study


def _swept_values(key: str, values: Any) -> list[Any]:
    if not isinstance(values, list) or not values:
        raise ConfigurationError(f"is swept by a list of values (found {values!r})", key=key)
    return values


def _settings_that_go_together(table: dict[str, Any]) -> list[dict[str, Any]]:
    columns = {key: _swept_values(key, values) for key, values in table.items()}
    lengths = {key: len(values) for key, values in columns.items()}
    if len(set(lengths.values())) != 1:
        raise ConfigurationError(f"lists that go together are equally long (found {lengths})")
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


MOST_STUDY_TRIALS: Final = 1_000_000
"""A study of more is a mistake in its file."""


def trials_of_study(
    study: StudyFile, study_file: Path, backend_of: BackendOfTask
) -> tuple[Trial, ...]:
    """All trials (runs to make) of a study, in the order of its table.

    Parameters
    ----------
    study : StudyFile
        The study.
    study_file : Path
        The file that it was read from; its jobs are sought from there.
    backend_of : callable
        Gives the backend of the study's task.

    Raises
    ------
    ConfigurationError
        For the first run that can't be, naming the key.
    """
    kind, axes = backend_of(study.task), study.settings_by_axis(backend_of)
    names = (study.job,) if isinstance(study.job, str) else study.job
    jobs = [study_file.parent / name for name in names]
    count = len(jobs) * prod(map(len, axes))
    if count > MOST_STUDY_TRIALS:
        reason = f"makes {count} runs, {MOST_STUDY_TRIALS} at most: vary less at once"
        raise ConfigurationError(reason, file=study_file)
    trials: list[Trial] = []
    for job, *settings in product(jobs, *axes):
        varied = {key: value for setting in settings for key, value in setting.items()}
        with add_file_to_errors(study_file):
            resolved = kind.resolve_run(job, study.fixed_settings | varied)
        named = {"job": job.stem} if len(jobs) > 1 else {}
        inputs = _table_cells(named | varied | dict(resolved.followed))
        trials.append(Trial(len(trials), inputs, study.task, resolved.settings))
    return tuple(trials)


def plan_study(file: Path, backend_of: BackendOfTask) -> tuple[Trial, ...]:
    """All trials of a study file; raises as `read_study_file` and `trials_of_study` do."""
    return trials_of_study(read_study_file(file, backend_of), file, backend_of)


def _table_cells(values: Mapping[str, Any]) -> dict[str, Value]:
    """Values as a table's cells; lists and tables become JSON."""
    return {
        key: value if isinstance(value, bool | int | float | str) else canonical_json(value)
        for key, value in values.items()
    }
