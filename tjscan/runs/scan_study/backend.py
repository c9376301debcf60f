"""Studies of scans: from the study's keys to a resolved job and joint, and to the report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from tjscan.core.config import read_toml, table_to_dict, validate_table
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.frames import Array
from tjscan.core.units import pose_to_rows_mm
from tjscan.job import JointSettings, ScanJob, read_scan_job
from tjscan.job.arm import sensor_mount_of_job
from tjscan.joint.file import JointFile
from tjscan.runs.scan_study.chapters import write_paper_comparison
from tjscan.runs.scan_study.outcome import ScanOutcome
from tjscan.runs.scan_study.paper import CASE, STEP
from tjscan.runs.scan_study.rules import DerivedKeySettings, joint_with_derived_dimensions
from tjscan.runs.scan_study.run import run_study_scan
from tjscan.runs.scan_study.settings import StudyScanSettings
from tjscan.runs.scan_study.start import teach_start_poses
from tjscan.study.backend import (
    ReportedQuantity,
    ResolvedRun,
    StudyBackend,
    blame_study_for_its_keys,
)
from tjscan.study.row import StudyRow

JOINT: Final = "joint."
RULE: Final = "rule."
JOINT_TABLES: Final = tuple(JointFile.model_fields)
START: Final = "rule.start_azimuth_deg"


class ScanStudyBackend(StudyBackend[ScanOutcome]):
    """How scans are resolved, executed and reported in a study.

    Keys are those of the job file, those of the joint's file below ``joint.``
    (``joint.brace.wall_mm``), and those of `DerivedKeySettings` below ``rule.``.
    """

    outcome = ScanOutcome
    seed = "simulation.seed"
    measures = (
        ReportedQuantity("profiles per section", lambda m: m.scans_per_section, ".2f"),
        ReportedQuantity("mean step error / %", lambda m: m.step_error_percent, "+.2f"),
        ReportedQuantity("mean corner error / mm", lambda m: m.corner_mean_mm, ".3f"),
    )

    def resolve_run(self, job_file: Path, keys: Mapping[str, Any]) -> ResolvedRun:
        """Resolve and check the settings of one scan; see `StudyBackend.resolve_run`."""
        job_keys, joint_keys, rules = _sorted_out(keys)
        with blame_study_for_its_keys(job_keys):
            job = read_scan_job(job_file, job_keys)
        if (
            job.joint is None
            or job.simulation is None
            or job.arm.driver_kind is not DriverKind.SIMULATED
        ):
            raise ConfigurationError("a study simulates: its jobs need [joint] and [simulation]")
        if job.station:
            raise ConfigurationError("a study's jobs scan from one place", key="station")
        mount = sensor_mount_of_job(job, job_file)
        if mount.deviations is not None:
            raise ConfigurationError(
                "holds the arm's kinematics too, and a study's runs take the sensor's pose alone",
                file=mount.file,
                key="calibration.file",
            )
        T_f_s = mount.T_f_s
        joint = _joint(job_file.parent / job.joint.file, joint_keys, rules)
        changed, followed = _followed(job, joint, rules, T_f_s)
        if job.calibration.file is not None:
            changed["calibration"] = {"T_f_s_mm": pose_to_rows_mm(T_f_s)}
        data = table_to_dict(job) | changed
        return ResolvedRun(
            StudyScanSettings(validate_table(ScanJob, data), joint).to_canonical_json_text(),
            followed,
        )

    def execute_run(self, settings: str) -> ScanOutcome:
        """Execute one scan; see `StudyBackend.execute_run`."""
        return run_study_scan(StudyScanSettings.from_json_text(settings))

    def special_report_lines(
        self, folder: Path, rows: Sequence[StudyRow[ScanOutcome]]
    ) -> Iterator[str]:
        """Report lines that compare with the paper; see `StudyBackend.special_report_lines`."""
        as_paper = all(CASE in row.inputs and STEP in row.inputs for row in rows)
        if as_paper and any(row.outcome.complete for row in rows):
            yield from write_paper_comparison(folder, rows)


SCAN_STUDY: Final = ScanStudyBackend()


def _sorted_out(
    keys: Mapping[str, Any],
) -> tuple[dict[str, Any], dict[str, Any], DerivedKeySettings]:
    """The keys of the job, those of the joint's file, and the rules."""
    job, joint, rule = {}, {}, {}
    for key, value in keys.items():
        table, _, inner = key.removeprefix(JOINT).partition(".")
        if key.startswith(RULE):
            rule[key.removeprefix(RULE)] = value
        elif key.startswith(JOINT) and inner and table in JOINT_TABLES:
            joint[key.removeprefix(JOINT)] = value
        elif key.startswith(JOINT) and table not in JointSettings.file_key_types():
            known = (*JOINT_TABLES, *JointSettings.file_key_types())
            raise ConfigurationError(
                f"unknown key; did you mean: {JOINT}{nearest_word(table, known)}?", key=key
            )
        else:
            job[key] = value
    with _below(RULE):
        return job, joint, validate_table(DerivedKeySettings, rule)


def _joint(file: Path, keys: Mapping[str, Any], rules: DerivedKeySettings) -> JointFile:
    if not file.is_file():
        raise ConfigurationError(f"there is no such file: {file}", key="joint.file")
    data = read_toml(file)
    for key, value in keys.items():
        table, _, name = key.partition(".")
        data[table] = {**data.get(table, {}), name: value}
    with _below(JOINT):
        joint = joint_with_derived_dimensions(validate_table(JointFile, data), rules)
        joint.definition(file.stem)  # refuses what can't be built
    return joint


def _followed(
    job: ScanJob, joint: JointFile, rules: DerivedKeySettings, T_f_s: Array
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What rules make of a job: whole tables that they change, and cells that show it."""
    tables: dict[str, Any] = {"scan": table_to_dict(job.scan)}
    cells: dict[str, Any] = {}
    if rules.leg_to_brace is not None:
        cells["joint.leg.outer_diameter_mm"] = joint.leg.outer_diameter_mm
    if rules.step_to_brace is not None:
        step = round(rules.step_to_brace * joint.brace.outer_diameter_mm, 1)
        tables["scan"]["step_mm"] = cells[STEP] = step
    if rules.start_azimuth_deg is not None:
        started = validate_table(ScanJob, table_to_dict(job) | tables)
        azimuth, changed = teach_start_poses(started, joint, rules, T_f_s)
        tables["scan"] |= changed.pop("scan")
        tables |= changed
        cells[START] = azimuth
    elif rules.carry_base or rules.centre_view:
        raise ConfigurationError("is needed for the other rules", key=START)
    return tables, cells


@contextmanager
def _below(table: str) -> Iterator[None]:
    """Name keys as the study does: below the table's name."""
    try:
        yield
    except ConfigurationError as error:
        key = table.removesuffix(".") if error.key is None else f"{table}{error.key}"
        raise ConfigurationError(error.message, key=key) from None
