"""The study file: what is fixed, and what is varied."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from tjscan.core.config import StrictFileModel, add_file_to_errors, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.recording.header import flatten_to_dotted_keys
from tjscan.study.trial import BackendOfTask

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

    def settings_by_axis(self, seed_key: str) -> list[list[dict[str, Any]]]:
        """Lists of the settings that are varied; a study runs their product.

        Each list holds the settings of one axis, a setting being dotted keys and their values.

        Parameters
        ----------
        seed_key : str
            The key that sets a run's random numbers.

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
            axes.append([{seed_key: seed} for seed in range(1, self.seeds + 1)])
        keys = [key for axis in axes for key in axis[0]]
        for key in keys:
            if keys.count(key) > 1 or key in self.fixed_settings:
                raise ConfigurationError("occurs twice in the study", key=key)
        return axes


def read_study_file(file: Path, backend_of: BackendOfTask) -> StudyFile:
    """Read a study file; `backend_of` gives the backend of its task.

    Raises
    ------
    ConfigurationError
        If it can't be read, or a key is unknown, missing or of a wrong type or value.
    """
    study = validate_table(StudyFile, read_toml(file), file)
    with add_file_to_errors(file):
        study.settings_by_axis(backend_of(study.task).seed)
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
