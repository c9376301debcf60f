"""From a study file to its tasks: every one resolved and checked before anything runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, Final

from tjscan.core.config import naming, read_toml, validate, written
from tjscan.core.devices import Kind
from tjscan.core.errors import ConfigurationError, nearest
from tjscan.core.frames import Array
from tjscan.core.units import pose_to_rows
from tjscan.job import JobFile, JointTable, read_job
from tjscan.job.cell import mount_of
from tjscan.joint.file import JointFile
from tjscan.study.file import StudyFile
from tjscan.study.rules import RuleTable, ruled_joint
from tjscan.study.start import taught_start
from tjscan.study.task import Task, Value, canonical

MOST_SCANS: Final = 1_000_000
"""A study of more is a mistake in its file."""

JOINT: Final = "joint."
RULE: Final = "rule."
JOINT_TABLES: Final = tuple(JointFile.model_fields)
STEP: Final = "scan.step_mm"
START: Final = "rule.start_azimuth_deg"


def tasks_of(study: StudyFile, study_file: Path) -> tuple[Task, ...]:
    """All scans of a study, in the order of its table.

    Parameters
    ----------
    study : StudyFile
        The study.
    study_file : Path
        Where it was read from; its jobs are sought from there.

    Raises
    ------
    ConfigurationError
        For the first scan whose job or joint can't be, naming the key.
    """
    jobs = [study_file.parent / name for name in study.jobs]
    count = len(jobs) * prod(len(axis) for axis in study.axes())
    if count > MOST_SCANS:
        raise ConfigurationError(
            f"makes {count} scans, {MOST_SCANS} at most: vary less at once", file=study_file
        )
    tasks: list[Task] = []
    for job, *settings in product(jobs, *study.axes()):
        varied: dict[str, Any] = {"job": job.stem} if len(jobs) > 1 else {}
        for setting in settings:
            varied |= setting
        keys = study.fixed_keys | {k: v for k, v in varied.items() if k != "job"}
        with naming(study_file):
            tasks.append(_task(len(tasks), varied, job, keys))
    return tuple(tasks)


def _task(index: int, varied: dict[str, Any], file: Path, keys: dict[str, Any]) -> Task:
    job_keys, joint_keys, rules = _sorted_out(keys)
    job = _job(file, job_keys)
    if job.joint is None or job.simulation is None or job.arm.kind is not Kind.SIMULATED:
        raise ConfigurationError("a study simulates: its jobs need [joint] and [simulation]")
    if job.station:
        raise ConfigurationError("a study's jobs scan from one place", key="station")
    T_f_s = mount_of(job, file).T_f_s
    joint = _joint(file.parent / job.joint.file, joint_keys, rules)
    changed, followed = _followed(job, joint, rules, T_f_s)
    if job.calibration.file is not None:
        changed["calibration"] = {"T_f_s_mm": pose_to_rows(T_f_s)}
    data = written(job) | changed
    return Task.of(index, _cells(varied | followed), validate(JobFile, data), joint)


def _job(file: Path, keys: dict[str, Any]) -> JobFile:
    """A job with the study's keys; what is wrong with one of these is the study's to mend."""
    try:
        return read_job(file, keys)
    except ConfigurationError as error:
        blamed = error.key or ""
        if any(key == blamed or key.startswith(f"{blamed}.") for key in keys):
            raise ConfigurationError(error.message, key=error.key) from None
        raise


def _sorted_out(keys: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any], RuleTable]:
    """The keys of the job, those of the joint's file, and the rules."""
    job, joint, rule = {}, {}, {}
    for key, value in keys.items():
        table, _, inner = key.removeprefix(JOINT).partition(".")
        if key.startswith(RULE):
            rule[key.removeprefix(RULE)] = value
        elif key.startswith(JOINT) and inner and table in JOINT_TABLES:
            joint[key.removeprefix(JOINT)] = value
        elif key.startswith(JOINT) and table not in JointTable.file_fields():
            known = (*JOINT_TABLES, *JointTable.file_fields())
            raise ConfigurationError(
                f"unknown key; did you mean: {JOINT}{nearest(table, known)}?", key=key
            )
        else:
            job[key] = value
    with _below(RULE):
        return job, joint, validate(RuleTable, rule)


def _joint(file: Path, keys: Mapping[str, Any], rules: RuleTable) -> JointFile:
    if not file.is_file():
        raise ConfigurationError(f"there is no such file: {file}", key="joint.file")
    data = read_toml(file)
    for key, value in keys.items():
        table, _, name = key.partition(".")
        data[table] = {**data.get(table, {}), name: value}
    with _below(JOINT):
        joint = ruled_joint(validate(JointFile, data), rules)
        joint.definition(file.stem)  # refuses what can't be built
    return joint


def _followed(
    job: JobFile, joint: JointFile, rules: RuleTable, T_f_s: Array
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What rules make of a job: whole tables that they change, and cells that tell it."""
    tables: dict[str, Any] = {"scan": written(job.scan)}
    cells: dict[str, Any] = {}
    if rules.leg_to_brace is not None:
        cells["joint.leg.outer_diameter_mm"] = joint.leg.outer_diameter_mm
    if rules.step_to_brace is not None:
        step = round(rules.step_to_brace * joint.brace.outer_diameter_mm, 1)
        tables["scan"]["step_mm"] = cells[STEP] = step
    if rules.start_azimuth_deg is not None:
        started = validate(JobFile, written(job) | tables)
        azimuth, changed = taught_start(started, joint, rules, T_f_s)
        tables["scan"] |= changed.pop("scan")
        tables |= changed
        cells[START] = azimuth
    elif rules.carry_base or rules.centre_view:
        raise ConfigurationError("is needed for the other rules", key=START)
    return tables, cells


def _cells(values: Mapping[str, Any]) -> dict[str, Value]:
    """Values as a table's cells; lists and tables become JSON."""
    return {
        key: value if isinstance(value, bool | int | float | str) else canonical(value)
        for key, value in values.items()
    }


@contextmanager
def _below(table: str) -> Iterator[None]:
    """Name keys as the study does: below the table's name."""
    try:
        yield
    except ConfigurationError as error:
        key = table.removesuffix(".") if error.key is None else f"{table}{error.key}"
        raise ConfigurationError(error.message, key=key) from None
