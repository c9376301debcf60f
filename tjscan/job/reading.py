"""From a job file, and single keys in the place of its own, to a job."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

from tjscan.core.config import (
    StrictFileModel,
    add_file_to_errors,
    read_toml,
    validate_table,
)
from tjscan.core.errors import ConfigurationError
from tjscan.job.files import CalibrationJob, CellJob, LaserJob, ScanJob
from tjscan.job.kinds import kind_of_other_file
from tjscan.job.station import casefolded_name

EXCLUDED: Final = {"calibration.file": "T_f_s_mm", "calibration.T_f_s_mm": "file"}
"""What a replaced key leaves no room for in its table."""

J = TypeVar("J", bound=CellJob)
M = TypeVar("M", bound=StrictFileModel)


def read_scan_job(file: Path, overrides: dict[str, Any] | None = None) -> ScanJob:
    """Read the job of a scan, with single keys replaced.

    Parameters
    ----------
    file : Path
        The TOML file.
    overrides : dict, optional
        Dotted keys such as ``scan.step_mm`` and their values. One of two keys that exclude each
        other displaces the other.

    Raises
    ------
    ConfigurationError
        If the file can't be read, or a key is unknown, missing or of a wrong type or value.
    """
    return _read(ScanJob, file, overrides)


def read_calibration_job(file: Path, overrides: dict[str, Any] | None = None) -> CalibrationJob:
    """Read the job of a calibration, with single keys replaced; see `read_scan_job`."""
    return _read(CalibrationJob, file, overrides)


def _read(model: type[J], file: Path, overrides: dict[str, Any] | None) -> J:
    return _located(read_job_table(model, file, overrides), file.parent)


def read_job_table(model: type[M], file: Path, overrides: dict[str, Any] | None) -> M:
    """Read a job of any model, with single keys replaced; see `read_scan_job`."""
    data = read_toml(file)
    if (other := kind_of_other_file(data, model.model_fields)) is not None:
        raise ConfigurationError(f"is {other.name}: {other.use}", file=file)
    with add_file_to_errors(file):
        replace_keys(data, overrides or {})
        return validate_table(model, data, file)


def read_laser_job(file: Path, overrides: dict[str, Any] | None = None) -> LaserJob:
    """Read the tables of a laser and its reading alone, from a job of any kind or a file of these.

    Parameters
    ----------
    file, overrides
        As for `read_scan_job`.

    Raises
    ------
    ConfigurationError
        If the file can't be read, or a key of these tables is wrong.
    """
    data = read_toml(file)
    with add_file_to_errors(file):
        replace_keys(data, overrides or {})
        return validate_table(LaserJob, {k: data[k] for k in LaserJob.model_fields if k in data})


def replace_keys(data: dict[str, Any], overrides: dict[str, Any]) -> None:
    """Replace single keys of a file's tables, in place.

    Parameters
    ----------
    data : dict
        The tables.
    overrides : dict
        Dotted keys and their values.

    Raises
    ------
    ConfigurationError
        If there is no place for a key.
    """
    for key, value in overrides.items():
        *tables, last = key.split(".")
        table: Any = data
        for name in tables:
            table = _inner(table, name, key)
        if isinstance(table, list):
            raise ConfigurationError(
                f"is an array of tables; say which one: {'.'.join(tables)}.NAME.{last}", key=key
            )
        table[last] = value
        if key in EXCLUDED:
            table.pop(EXCLUDED[key], None)


def _inner(tables: Any, name: str, key: str) -> Any:
    """A table in a table; in an array of tables the one of that name, or number from 0."""
    if isinstance(tables, dict):
        return _table(tables.setdefault(name, {}), name, key)
    named = {
        casefolded_name(str(entry.get("name"))): entry
        for entry in tables
        if isinstance(entry, dict)
    }
    if (
        (found := named.get(casefolded_name(name))) is None
        and name.isdigit()
        and int(name) < len(tables)
    ):
        found = tables[int(name)]
    if found is None:
        known = f"; there are: {', '.join(named)}" if named else ""
        raise ConfigurationError(f"no table of it is called {name}{known}", key=key)
    return _table(found, name, key)


def _table(found: Any, name: str, key: str) -> Any:
    if not isinstance(found, dict | list):
        raise ConfigurationError(f"{name} is no table", key=key)
    return found


def _located(job: J, folder: Path) -> J:
    """Seek an arm's URDF and a recording from the job's folder, as other files that a job names."""
    if Path(job.arm.model).suffix == ".urdf":
        arm = replace(job.arm, model=str(folder / job.arm.model))
        job = job.model_copy(update={"arm": arm})
    if job.laser.recording is not None:
        # Absolute: the job is copied into its run directory, a recording is not.
        recording = str((folder / job.laser.recording).absolute())
        job = job.model_copy(update={"laser": replace(job.laser, recording=recording)})
    return job
