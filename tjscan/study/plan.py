"""The plan of a study: a million runs as the few lines that they are made from.

A run is worked out from its index, where it is needed: here for its row, and in the process that
runs it for its settings. The plan holds the files that the jobs name, so that no other is needed.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import prod
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, Final, cast, overload

from tjscan.core import files
from tjscan.core.config import add_file_to_errors, read_toml, table_to_dict, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.units import STRICT_TABLE
from tjscan.core.version import PROGRAM_VERSION
from tjscan.study.file import StudyFile, read_study_file
from tjscan.study.trial import (
    BackendOfTask,
    ResolvedRun,
    StudyBackend,
    Trial,
    Value,
    canonical_json,
)

MOST_STUDY_TRIALS: Final = 1_000_000
"""A study of more is a mistake in its file."""

MOST_TRIALS_CHECKED: Final = 1000
"""Runs that are resolved before the first one is made; of more, each value of every axis is."""

MOST_VALUES_CHECKED: Final = 200
"""Of an axis of a larger study, and of runs besides, evenly spaced."""

NAMED_FILE_SUFFIXES: Final = (".toml", ".urdf")
"""Of files that a job names."""

MOST_NAMED_FILE_BYTES: Final = 1_000_000
"""A larger file is none that a job names."""


@dataclass(frozen=True)
class StudyPlan(Sequence[Trial]):
    """All trials of a study, in the order of its table, each made when it is asked for.

    Parameters
    ----------
    study : dict
        The study as its file has it.
    seed_key : str
        The key that sets a run's random numbers.
    jobs : tuple of str
        The base jobs, among the files.
    files : mapping
        Texts of the jobs and of what they name, by their paths from the folder of all.
    """

    study: Mapping[str, Any]
    seed_key: str
    jobs: tuple[str, ...]
    files: Mapping[str, str]

    def __reduce__(self) -> tuple[type[StudyPlan], tuple[object, ...]]:
        """Leave out what is worked out again where it is needed."""
        return StudyPlan, (self.study, self.seed_key, self.jobs, self.files)

    @cached_property
    def file(self) -> StudyFile:
        """The study as its file has it, checked."""
        return validate_table(StudyFile, self.study)

    @cached_property
    def _axes(self) -> list[list[dict[str, Any]]]:
        return self.file.settings_by_axis(self.seed_key)

    @cached_property
    def _digest(self) -> str:
        content = [PROGRAM_VERSION, self.file.task, self.file.fixed_settings, dict(self.files)]
        return hashlib.sha256(canonical_json(content).encode()).hexdigest()

    @cached_property
    def _job_names(self) -> tuple[str, ...]:
        """The jobs in the table: their names, and their folders too if names are alike."""
        stems = tuple(Path(job).stem for job in self.jobs)
        paths = tuple(Path(job).with_suffix("").as_posix() for job in self.jobs)
        return stems if len(set(stems)) == len(stems) else paths

    def __len__(self) -> int:
        return len(self.jobs) * prod(map(len, self._axes))

    @overload
    def __getitem__(self, index: int) -> Trial: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Trial]: ...
    def __getitem__(self, index: int | slice) -> Trial | Sequence[Trial]:
        """The trial with an index; the last axis runs fastest."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not 0 <= index < len(self):
            raise IndexError(index)
        varied: dict[str, Any] = {}
        rest = index
        for axis in reversed(self._axes):
            rest, place = divmod(rest, len(axis))
            varied = axis[place] | varied
        job = self.jobs[rest]
        named = {"job": self._job_names[rest]} if len(self.jobs) > 1 else {}
        identity = canonical_json([self._digest, job, varied])
        key = hashlib.sha256(identity.encode()).hexdigest()[:32]
        return Trial(index, key, job, varied, table_cells(named | varied))

    def resolve(self, trial: Trial, kind: StudyBackend[Any], folder: Path) -> ResolvedRun:
        """Resolve and check a trial's settings, with the plan's files in a folder.

        Raises
        ------
        ConfigurationError
            If such a run can't be, naming the key.
        """
        return kind.resolve_run(folder / trial.job, self.file.fixed_settings | dict(trial.varied))

    @property
    def checked_indices(self) -> Iterator[int]:
        """Trials that show whether all can be: all of a small study, else each value once."""
        count = len(self)
        if count <= MOST_TRIALS_CHECKED:
            yield from range(count)
            return
        yield from _evenly_spaced(count)
        stride = 1
        for axis in (*reversed(self._axes), list(self.jobs)):
            yield from (stride * place for place in _evenly_spaced(len(axis)))
            stride *= len(axis)

    def to_json(self) -> str:
        """The plan as JSON."""
        fields = ("study", "seed_key", "jobs", "files")
        return canonical_json({name: getattr(self, name) for name in fields})


def _evenly_spaced(count: int) -> Iterator[int]:
    most = min(count, MOST_VALUES_CHECKED)
    return (place * (count - 1) // max(most - 1, 1) for place in range(most))


def plan_study(file: Path, backend_of: BackendOfTask) -> StudyPlan:
    """Plan the runs of a study file, and check that they can be.

    Parameters
    ----------
    file : Path
        The study; its jobs are sought from there.
    backend_of : callable
        Gives the backend of its task.

    Raises
    ------
    ConfigurationError
        As `read_study_file` does, and for the first run that can't be, naming the key.
    """
    study = read_study_file(file, backend_of)
    kind = backend_of(study.task)
    names = (study.job,) if isinstance(study.job, str) else study.job
    jobs = [(file.parent / name).absolute() for name in names]
    if len(set(jobs)) < len(jobs):
        raise ConfigurationError("a job is there twice", file=file, key="job")
    swept = [value for axis in study.settings_by_axis(kind.seed) for value in axis]
    paths = {Path(os.path.normpath(path)) for job in jobs for path in _files_of(job, study, swept)}
    root = Path(os.path.commonpath([path.parent for path in paths]))
    texts = {
        path.relative_to(root).as_posix(): _with_relative_paths(
            _read_text(path), paths, path.parent
        )
        for path in sorted(paths)
    }
    table = canonical_json(table_to_dict(study))
    plan = StudyPlan(
        json.loads(_with_relative_paths(table, paths.difference(jobs), jobs[0].parent)),
        kind.seed,
        tuple(Path(os.path.normpath(job)).relative_to(root).as_posix() for job in jobs),
        texts,
    )
    if len(plan) > MOST_STUDY_TRIALS:
        reason = f"makes {len(plan)} runs, {MOST_STUDY_TRIALS} at most: vary less at once"
        raise ConfigurationError(reason, file=file)
    with add_file_to_errors(file):
        for index in plan.checked_indices:
            plan.resolve(plan[index], kind, root)
    return plan


def read_plan(file: Path) -> StudyPlan:
    """Read a plan from its file.

    Raises
    ------
    ConfigurationError
        If there is none, or it is something else.
    """
    from pydantic import ConfigDict, TypeAdapter, ValidationError, with_config

    try:
        content = files.read_small_file(file, MOST_PLAN_BYTES, "the plan of a study")
        strict = with_config(cast(ConfigDict, STRICT_TABLE))(StudyPlan)
        plan = TypeAdapter(strict).validate_json(content)
        len(plan)
    except OSError:
        raise ConfigurationError("there is no study", file=file.parent) from None
    except ValidationError:
        reason = "is no plan of a study, or one of an older tjscan: begin the study again"
        raise ConfigurationError(reason, file=file) from None
    except (ConfigurationError, RecursionError) as error:
        raise ConfigurationError(f"is no plan of a study: {error}", file=file) from None
    outside = any(Path(name).is_absolute() or ".." in Path(name).parts for name in plan.files)
    if outside or not set(plan.jobs) <= set(plan.files):
        reason = "is no plan of a study: a file of it is missing, or outside of its folder"
        raise ConfigurationError(reason, file=file)
    return plan


MOST_PLAN_BYTES: Final = 100_000_000
"""A larger file is no plan."""


@lru_cache(maxsize=2)
def folder_of_files(texts: frozenset[tuple[str, str]]) -> Path:
    """A folder that holds files until the process ends.

    Parameters
    ----------
    texts : frozenset of (str, str)
        Paths and texts.
    """
    folder = Path(mkdtemp(prefix="tjscan-study-"))
    atexit.register(rmtree, folder, ignore_errors=True)
    for name, text in texts:
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    return folder


def _files_of(job: Path, study: StudyFile, swept: Sequence[Mapping[str, Any]]) -> Iterator[Path]:
    """A job, and the files that it or the study's keys name."""
    yield job
    for text in _texts_in([read_toml(job), study.fixed, swept]):
        named = job.parent / text
        if named.suffix in NAMED_FILE_SUFFIXES and named.is_file():
            if named.suffix == ".urdf" and "<mesh" in _read_text(named):
                if not Path(text).is_absolute():
                    reason = f"{text} has meshes beside it: in a study give its absolute path"
                    raise ConfigurationError(reason, file=job, key="arm.model")
                continue
            yield named


def _with_relative_paths(text: str, paths: Iterable[Path], folder: Path) -> str:
    """The text of a file or table with absolute paths of copied files as seen from a folder."""
    for path in paths:
        for quote in "\"'":
            seen = Path(os.path.relpath(path, folder)).as_posix()
            text = text.replace(f"{quote}{path}{quote}", f"{quote}{seen}{quote}")
    return text


def _texts_in(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        yield from _texts_in(list(value.values()))
    elif isinstance(value, Sequence):
        for inner in value:
            yield from _texts_in(inner)


def _read_text(file: Path) -> str:
    try:
        return files.read_small_file(file, MOST_NAMED_FILE_BYTES, "a configuration").decode()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"can't be read: {error}", file=file) from None


def table_cells(values: Mapping[str, Any]) -> dict[str, Value]:
    """Values as a table's cells; lists and tables become JSON."""
    return {
        key: value if isinstance(value, bool | int | float | str) else canonical_json(value)
        for key, value in values.items()
    }
