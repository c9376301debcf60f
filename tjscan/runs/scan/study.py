"""Studies of scans: from the study's keys to a resolved job, and to what came of its scan."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.config import read_toml, table_to_dict, validate_table
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.frames import Array, JointOrBaseFrame, transform_points
from tjscan.core.units import pose_from_rows_mm, pose_to_rows_mm
from tjscan.job.arm import sensor_mount_of_job
from tjscan.job.cell import make_scan_cell
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.job.surroundings import JointSettings
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import feature_edges
from tjscan.joint.file import JointFile
from tjscan.recording.journal import CombinedJournal
from tjscan.result.section import absent_corners
from tjscan.runs.scan.results import flange_way, summarise_scan
from tjscan.runs.scan.run import scan_in_cell
from tjscan.runs.scan.study_rules import (
    DerivedKeySettings,
    joint_with_derived_dimensions,
    teach_start_poses,
)
from tjscan.scanning.journal import ScanResult
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import Substep
from tjscan.study.backend import (
    ReportedQuantity,
    ResolvedRun,
    StudyBackend,
    drop_file_from_study_key_errors,
)
from tjscan.study.trial import HIDDEN_FIELD, RunOutcome, canonical_json


@dataclass(frozen=True, slots=True)
class StudyScanSettings:
    """Complete settings of one scan of a study: its job and its joint.

    Parameters
    ----------
    job : ScanJob
        The resolved job.
    joint : JointFile
        Its joint.
    """

    job: ScanJob
    joint: JointFile

    def to_canonical_json_text(self) -> str:
        """The settings as canonical JSON text."""
        joint = self.joint.model_dump(mode="json")
        return canonical_json({"job": table_to_dict(self.job), "joint": joint})

    @classmethod
    def from_json_text(cls, text: str) -> Self:
        """Read the settings from the text that `to_canonical_json_text` gave."""
        data = json.loads(text)
        return cls(validate_table(ScanJob, data["job"]), validate_table(JointFile, data["joint"]))


FlangePath = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class ScanOutcome(RunOutcome):
    """Outcome of one scan of a study. Lengths in millimetres, angles in degrees.

    Travel, rotation and time run from the second taught pose on.

    Parameters
    ----------
    complete, reason, detail
        As in `RunOutcome`.
    sections, scans : int
        Finished sections and profiles taken, the two taught ones included.
    scans_per_section : float
        Profiles per section, of those that were not taught.
    half_steps : int
        How often a section was tried again at half the step.
    groove_length_mm : float
        Of the chain of groove origins.
    step_nominal_mm, step_mean_mm, step_std_mm : float
        The step asked for, and the steps made.
    step_error_percent : float
        Of the mean step, with its sign.
    travel_mm, travel_prediction_mm, travel_correction_mm : float
        Of the flange, in all and of the moves into either kind of view.
    rotation_deg, rotation_prediction_deg, rotation_correction_deg : float
        The same for what it turned.
    motion_time_s : float
        On the arm's clock.
    corner_mean_mm, corner_p95_mm : float
        Distance of p2, p3, p4 from the joint's edges.
    path : tuple of tuple of float
        Where the flange went, a point per view: azimuth in degrees and, in millimetres,
        distance from the brace's axis and height along it. No column of the table.
    """

    sections: int = 0
    scans: int = 0
    scans_per_section: float | None = None
    half_steps: int = 0
    groove_length_mm: float | None = None
    step_nominal_mm: float | None = None
    step_mean_mm: float | None = None
    step_std_mm: float | None = None
    step_error_percent: float | None = None
    travel_mm: float | None = None
    travel_prediction_mm: float | None = None
    travel_correction_mm: float | None = None
    rotation_deg: float | None = None
    rotation_prediction_deg: float | None = None
    rotation_correction_deg: float | None = None
    motion_time_s: float | None = None
    corner_mean_mm: float | None = None
    corner_p95_mm: float | None = None
    path: FlangePath = field(default=(), metadata=HIDDEN_FIELD)

    def __post_init__(self) -> None:
        # JSON holds lists.
        object.__setattr__(self, "path", tuple((a, r, z) for a, r, z in self.path))


SUMMARY_COUNTS: Final = ("sections", "scans", "half_steps")
SUMMARY_FIELDS: Final = ("complete", "detail", *SUMMARY_COUNTS, "groove_length_mm", "motion_time_s")
"""Fields of an outcome that are those of the scan's summary."""

EDGES_KEPT = 4
"""Joints whose edges a process keeps: trials of one joint follow each other."""


def run_study_scan(settings: StudyScanSettings) -> ScanOutcome:
    """Execute one scan of a study and return its outcome.

    Raises
    ------
    TjscanError
        If the settings are wrong or a device fails.
    """
    job, joint = settings.job, settings.joint.definition("joint")
    if job.joint is None or job.calibration.T_f_s_mm is None:
        raise ConfigurationError("a scan of a study holds its joint and its calibration")
    cell = make_scan_cell(job, pose_from_rows_mm(job.calibration.T_f_s_mm), joint)
    result = scan_in_cell(cell, job, CombinedJournal())
    return _outcome_of_scan(result, job.scan, JointOrBaseFrame(job.joint.T_w_j), joint)


def _outcome_of_scan(
    result: ScanResult, plan: ScanPlan, frame: JointOrBaseFrame, joint: JointDefinition
) -> ScanOutcome:
    corners = np.array([transform_points(frame.T_r_b, s.points_b) for s in result.sections])
    absent = absent_corners([s.groove for s in result.sections])
    errors = corner_to_edge_distances(corners, _cached_feature_edges(joint), absent)
    summary = summarise_scan(result, plan, frame, errors)
    step, error, own = summary.step_mm, summary.corner_error_mm, summary.sections - 2
    known = {name: getattr(summary, name) for name in SUMMARY_FIELDS}
    for name, substep in (("prediction", Substep.PREDICTION), ("correction", Substep.CORRECTION)):
        moves = ((a, b) for a, b in pairwise(result.views) if b.substep is substep)
        known[f"travel_{name}_mm"], known[f"rotation_{name}_deg"] = flange_way(moves)
    return ScanOutcome(
        **known,
        reason=summary.stopped_because,
        scans_per_section=(summary.scans - 2) / own if own > 0 else None,
        step_nominal_mm=step.nominal,
        step_mean_mm=step.mean,
        step_std_mm=step.std,
        step_error_percent=None if step.mean is None else 100 * (step.mean / step.nominal - 1),
        travel_mm=summary.flange_travel_mm,
        rotation_deg=summary.flange_rotation_deg,
        corner_mean_mm=None if error is None else error.mean,
        corner_p95_mm=None if error is None else error.p95,
        path=_flange_path(result, frame),
    )


def _flange_path(result: ScanResult, frame: JointOrBaseFrame) -> FlangePath:
    """The flange's path in cylinder coordinates of frame j, degrees and mm, rounded for a plot."""
    flange = transform_points(frame.T_r_b, [view.T_b_f[:3, 3] for view in result.views])
    azimuth = np.degrees(np.unwrap(np.arctan2(flange[:, 1], flange[:, 0])))
    distance = 1e3 * np.hypot(flange[:, 0], flange[:, 1])
    points: Array = np.round(np.column_stack((azimuth, distance, 1e3 * flange[:, 2])), 3)
    return tuple((a, r, z) for a, r, z in points.tolist())


_cached_feature_edges = lru_cache(maxsize=EDGES_KEPT)(feature_edges)


STEP_KEY: Final = "scan.step_mm"
JOINT_PREFIX: Final = "joint."
RULE_PREFIX: Final = "rule."
JOINT_TABLES: Final = tuple(JointFile.model_fields)
START_KEY: Final = "rule.start_azimuth_deg"


class ScanStudyBackend(StudyBackend[ScanOutcome]):
    """How scans are resolved, executed and reported in a study.

    Keys are from the job file, from the joint's file below ``joint.``
    (``joint.brace.wall_mm``), and from `DerivedKeySettings` below ``rule.``.
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
        job_keys, joint_keys, rules = _sort_keys(keys)
        with drop_file_from_study_key_errors(job_keys):
            job = read_scan_job(job_file, job_keys)
        simulates = job.simulation is not None and job.arm.driver_kind is DriverKind.SIMULATED
        if job.joint is None or not simulates:
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
        joint = _read_joint_file(job_file.parent / job.joint.file, joint_keys, rules)
        changed, followed = _apply_rules(job, joint, rules, mount.T_f_s)
        if job.calibration.file is not None:
            changed["calibration"] = {"T_f_s_mm": pose_to_rows_mm(mount.T_f_s)}
        resolved = validate_table(ScanJob, table_to_dict(job) | changed)
        return ResolvedRun(StudyScanSettings(resolved, joint).to_canonical_json_text(), followed)

    def execute_run(self, settings: str) -> ScanOutcome:
        """Execute one scan; see `StudyBackend.execute_run`."""
        return run_study_scan(StudyScanSettings.from_json_text(settings))


SCAN_STUDY: Final = ScanStudyBackend()


def _sort_keys(
    keys: Mapping[str, Any],
) -> tuple[dict[str, Any], dict[str, Any], DerivedKeySettings]:
    """The keys of the job, of the joint's file, and the rules."""
    job, joint, rule = {}, {}, {}
    for key, value in keys.items():
        table, _, inner = key.removeprefix(JOINT_PREFIX).partition(".")
        if key.startswith(RULE_PREFIX):
            rule[key.removeprefix(RULE_PREFIX)] = value
        elif key.startswith(JOINT_PREFIX) and inner and table in JOINT_TABLES:
            joint[key.removeprefix(JOINT_PREFIX)] = value
        elif key.startswith(JOINT_PREFIX) and table not in JointSettings.file_key_types():
            nearest = nearest_word(table, (*JOINT_TABLES, *JointSettings.file_key_types()))
            reason = f"unknown key; did you mean: {JOINT_PREFIX}{nearest}?"
            raise ConfigurationError(reason, key=key)
        else:
            job[key] = value
    with _put_keys_below(RULE_PREFIX):
        return job, joint, validate_table(DerivedKeySettings, rule)


def _read_joint_file(file: Path, keys: Mapping[str, Any], rules: DerivedKeySettings) -> JointFile:
    if not file.is_file():
        raise ConfigurationError(f"there is no such file: {file}", key="joint.file")
    data = read_toml(file)
    for key, value in keys.items():
        table, _, name = key.partition(".")
        data[table] = {**data.get(table, {}), name: value}
    with _put_keys_below(JOINT_PREFIX):
        joint = joint_with_derived_dimensions(validate_table(JointFile, data), rules)
        joint.definition(file.stem)  # refuses what can't be built
    return joint


def _apply_rules(
    job: ScanJob, joint: JointFile, rules: DerivedKeySettings, T_f_s: Array
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What rules make of a job: whole tables that they change, and cells that show it."""
    tables: dict[str, Any] = {"scan": table_to_dict(job.scan)}
    cells: dict[str, Any] = {}
    if rules.leg_to_brace is not None:
        cells["joint.leg.outer_diameter_mm"] = joint.leg.outer_diameter_mm
    if rules.step_to_brace is not None:
        step = round(rules.step_to_brace * joint.brace.outer_diameter_mm, 1)
        tables["scan"]["step_mm"] = cells[STEP_KEY] = step
    if rules.start_azimuth_deg is not None:
        started = validate_table(ScanJob, table_to_dict(job) | tables)
        azimuth, changed = teach_start_poses(started, joint, rules, T_f_s)
        tables["scan"] |= changed.pop("scan")
        tables |= changed
        cells[START_KEY] = azimuth
    elif rules.carry_base or rules.centre_view:
        raise ConfigurationError("is needed for the other rules", key=START_KEY)
    return tables, cells


@contextmanager
def _put_keys_below(table: str) -> Iterator[None]:
    """Name keys as the study does: below the table's name."""
    try:
        yield
    except ConfigurationError as error:
        key = table.removesuffix(".") if error.key is None else f"{table}{error.key}"
        raise ConfigurationError(error.message, key=key) from None
