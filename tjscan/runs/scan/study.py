"""Studies of scans: from the study's keys to a resolved job, and to what came of its scan."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Literal, Self

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core import frames
from tjscan.core.config import StrictFileModel, read_toml, table_to_dict, validate_table
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.frames import Array, inverse_pose, pose, transform_points
from tjscan.core.units import pose_from_rows_mm, pose_to_rows_mm
from tjscan.job.cell import SensorMount, joint_scene, make_cell, sensor_mount_of_job
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.job.surroundings import JointSettings
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections, feature_edges
from tjscan.joint.file import CHECKED_AZIMUTHS, JointFile, groove_extent
from tjscan.recording.journal import CombinedJournal
from tjscan.result.section import absent_corners
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.scan.ideal_views import (
    azimuth_further_along,
    azimuths_at_plan_shares,
    ideal_sensor_pose,
    plan_with_centred_groove,
    pose_to_table,
)
from tjscan.runs.scan.results import flange_motion, summarise_scan
from tjscan.runs.scan.run import scan_in_cell
from tjscan.scanning.continuous.smoothing import finished_sections
from tjscan.scanning.journal import ScanResult
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import Substep
from tjscan.study import trial


class DerivedKeySettings(StrictFileModel):
    """Keys of a study from which others of the job and the joint are derived.

    Parameters
    ----------
    leg_to_brace : float, optional
        The leg's outer diameter as a multiple of the brace's.
    leg_wall_to_brace_wall : float, optional
        The leg's wall as a multiple of the brace's.
    room_mm : float, optional
        How far leg and brace run on beyond the groove.
    step_to_brace : float, optional
        The step as a share of the brace's outer diameter, in whole tenths of a millimetre.
    start_azimuth_deg : float or "any", optional
        Teach both start poses from the joint's geometry: the first at this azimuth of frame j,
        the second a step further on. "any" draws it, evenly, by the seed, for every joint.
    hand_mm, hand_deg : float
        How far off the taught poses are at most, along and about each axis of frame t in the
        groove; drawn evenly by the seed.
    carry_base : bool
        Carry the arm's base, as on a gantry, to where the arm in its home configuration looks
        at the middle of the arc to be scanned. Needs a taught start and `scan.sections`.
    centre_view : bool
        Choose stand-off and offset of the view so that the groove, from p2 to p4 and over the
        whole arc, is in the middle of the laser's window. Needs the same.
    """

    leg_to_brace: float | None = Field(default=None, ge=1, le=50)
    leg_wall_to_brace_wall: float | None = Field(default=None, gt=0, le=10)
    room_mm: float | None = Field(default=None, ge=20, le=5000)
    step_to_brace: float | None = Field(default=None, gt=0, le=1)
    start_azimuth_deg: float | Literal["any"] | None = None
    hand_mm: float = Field(default=3.0, ge=0, le=100)
    hand_deg: float = Field(default=5.0, ge=0, le=45)
    carry_base: bool = False
    centre_view: bool = False


LONGEST_TUBE_MM = 20_000.0
"""What a joint's file allows; used while the length needed is not known yet."""


def joint_with_derived_dimensions(joint: JointFile, rules: DerivedKeySettings) -> JointFile:
    """Joint file with the dimensions that the derived keys of a study give it.

    Parameters
    ----------
    joint : JointFile
        As its file has it, millimetres and degrees.
    rules : DerivedKeySettings
        What to change.

    Raises
    ------
    ConfigurationError
        If such a joint can't be built.
    """
    leg, brace = joint.leg, joint.brace
    if rules.leg_to_brace is not None:
        diameter = rules.leg_to_brace * brace.outer_diameter_mm
        leg = leg.model_copy(update={"outer_diameter_mm": diameter})
    if rules.leg_wall_to_brace_wall is not None:
        wall = rules.leg_wall_to_brace_wall * brace.wall_mm
        leg = leg.model_copy(update={"wall_mm": wall})
    joint = joint.model_copy(update={"leg": leg, "brace": brace})
    return joint if rules.room_mm is None else _cut_tubes_beside_groove(joint, rules.room_mm)


def _cut_tubes_beside_groove(joint: JointFile, room_mm: float) -> JointFile:
    """The joint with as much leg and brace as leaves room beyond the groove."""
    longest = {"length_mm": LONGEST_TUBE_MM}
    leg, brace = joint.leg.model_copy(update=longest), joint.brace.model_copy(update=longest)
    long_joint = joint.model_copy(update={"leg": leg, "brace": brace})
    definition = long_joint.definition("joint")
    up, along = groove_extent(definition, JointGrooveSections(definition, CHECKED_AZIMUTHS))
    leg = leg.model_copy(update={"length_mm": float(np.ceil(2 * (1e3 * along + room_mm)))})
    brace = brace.model_copy(update={"length_mm": float(np.ceil(1e3 * up + room_mm))})
    return joint.model_copy(update={"leg": leg, "brace": brace})


TEACHING_RANDOM_STREAM: Final = 11
"""Keeps these random numbers apart from the arm's and the laser's."""


def random_pose_error(shift: float, turn: float, rng: np.random.Generator) -> Array:
    """Draw by what frame t of a taught pose is off, as a pose in itself, shape (4, 4), metres.

    The operator watches the laser line on the steel: shift and turn are of frame t, which
    is in the groove, and not of the sensor an arm's length above it.

    Parameters
    ----------
    shift, turn : float
        Largest along and about each axis, metres and radians.
    rng : Generator
    """
    around = Rotation.from_rotvec(rng.uniform(-turn, turn, 3))
    return pose(around.as_matrix(), rng.uniform(-shift, shift, 3))


def teach_start_poses(
    job: ScanJob, joint: JointFile, rules: DerivedKeySettings, T_f_s: Array
) -> tuple[float, dict[str, Any]]:
    """Simulate the teaching of a job's start poses, with random errors from the job's seed.

    Parameters
    ----------
    job : ScanJob
        The job; its own start poses count for nothing.
    joint : JointFile
        Its joint.
    rules : DerivedKeySettings
        Where to start, how far off, and whether the base is carried there.
    T_f_s : ndarray, shape (4, 4)
        Pose of the sensor on the flange, as the job assumes it, metres.

    Returns
    -------
    float
        The azimuth of the first pose in degrees.
    dict
        What changes in the job's tables ``scan`` and ``joint``.

    Raises
    ------
    ConfigurationError
        If base or view depend on how far the scan goes, and nothing states it.
    """
    if job.joint is None or job.simulation is None or job.simulation.arm is None:
        raise ConfigurationError("a taught start needs [joint] and [simulation]")
    definition, plan = joint.definition("joint"), job.scan
    which = trial.canonical_json([joint.model_dump(mode="json"), plan.direction])
    digest = int.from_bytes(hashlib.sha256(which.encode()).digest()[:8])  # other for every joint
    random = np.random.default_rng([job.simulation.seed, TEACHING_RANDOM_STREAM, digest])
    azimuth_deg = round(float(random.uniform(-180, 180)), 3)  # drawn in any case: the rest stays
    if rules.start_azimuth_deg is not None and rules.start_azimuth_deg != "any":
        azimuth_deg = rules.start_azimuth_deg
    azimuth = float(np.radians(azimuth_deg))
    scan: dict[str, Any] = {}
    if (rules.carry_base or rules.centre_view) and (plan.sections, plan.length) == (None, None):
        why = "is needed, or length_mm, to know how far the scan goes"
        raise ConfigurationError(why, key="scan.sections")
    if rules.centre_view:
        window = (job.laser.near, job.laser.far)
        plan = plan_with_centred_groove(definition, azimuth, plan, window)
        scan["view_offset_mm"] = round(1e3 * plan.offset, 1)
        scan["standoff_mm"] = round(1e3 * plan.standoff, 1)
    if job.simulation.T_f_s_mm is not None:  # an operator teaches with the laser that is there
        T_f_s = pose_from_rows_mm(job.simulation.T_f_s_mm)
    off = 1e-3 * rules.hand_mm, float(np.radians(rules.hand_deg))
    further = azimuth_further_along(definition, azimuth, plan.step, plan.direction)
    T_j_s = [
        ideal_sensor_pose(definition, phi, plan, random_pose_error(*off, random))
        for phi in (azimuth, further)
    ]
    T_b_j = job.joint.T_w_j  # a study's jobs have no stations
    changed: dict[str, Any] = {}
    if rules.carry_base:
        q_home = np.array(job.simulation.arm.home)
        T_b_s_home = Kinematics.load(job.arm.model).forward(q_home) @ T_f_s
        # At home the arm looks at the middle of the arc.
        (middle,) = azimuths_at_plan_shares(definition, azimuth, plan, [0.5])
        T_b_j = T_b_s_home @ inverse_pose(ideal_sensor_pose(definition, middle, plan))
        changed["joint"] = {"file": job.joint.file} | pose_to_table(T_b_j)
    first, second = (pose_to_table(T_b_j @ T @ inverse_pose(T_f_s)) for T in T_j_s)
    return azimuth_deg, changed | {"scan": scan | {"first": first, "second": second}}


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
        return trial.canonical_json({"job": table_to_dict(self.job), "joint": joint})

    @classmethod
    def from_json_text(cls, text: str) -> Self:
        """Read the settings from the text that `to_canonical_json_text` gave."""
        data = json.loads(text)
        return cls(validate_table(ScanJob, data["job"]), validate_table(JointFile, data["joint"]))


FlangePath = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class ScanOutcome(trial.RunOutcome):
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
    stepwise : int
        Steps of a continuous scan from rest.
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
    stepwise: int = 0
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
    path: FlangePath = field(default=(), metadata=trial.HIDDEN_COLUMN_METADATA)

    def __post_init__(self) -> None:
        # JSON holds lists.
        object.__setattr__(self, "path", tuple((a, r, z) for a, r, z in self.path))


SUMMARY_COUNTS: Final = ("sections", "scans", "half_steps", "stepwise")
SUMMARY_FIELDS: Final = ("complete", "detail", *SUMMARY_COUNTS, "groove_length_mm", "motion_time_s")
"""Fields that an outcome takes from the scan's summary."""

MOST_CACHED_EDGES = 4
"""Joints whose edges a process keeps: trials of one joint follow each other."""


def scan_for_study(settings: StudyScanSettings) -> ScanOutcome:
    """Execute one scan of a study and return its outcome.

    Raises
    ------
    TjscanError
        If the settings are wrong or a device fails.
    """
    job, joint = settings.job, settings.joint.definition("joint")
    if job.joint is None or job.calibration.T_f_s_mm is None:
        raise ConfigurationError("a scan of a study holds its joint and its calibration")
    mount = SensorMount(pose_from_rows_mm(job.calibration.T_f_s_mm))
    cell = make_cell(job, mount, partial(joint_scene, job, joint))
    result = scan_in_cell(cell, job, CombinedJournal())
    return _outcome_of_scan(result, job.scan, frames.JointOrBaseFrame(job.joint.T_w_j), joint)


def _outcome_of_scan(
    result: ScanResult, plan: ScanPlan, frame: frames.JointOrBaseFrame, joint: JointDefinition
) -> ScanOutcome:
    result = replace(result, sections=finished_sections(result.sections))
    corners = np.array([transform_points(frame.T_r_b, s.points_b) for s in result.sections])
    absent = absent_corners([s.groove for s in result.sections])
    errors = corner_to_edge_distances(corners, _cached_feature_edges(joint), absent)
    summary = summarise_scan(result, plan, frame, errors)
    step, error, own = summary.step_mm, summary.corner_error_mm, summary.sections - 2
    known = {name: getattr(summary, name) for name in SUMMARY_FIELDS}
    for name, substep in (("prediction", Substep.PREDICTION), ("correction", Substep.CORRECTION)):
        moves = ((a, b) for a, b in pairwise(result.views) if b.substep is substep)
        known[f"travel_{name}_mm"], known[f"rotation_{name}_deg"] = flange_motion(moves)
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


def _flange_path(result: ScanResult, frame: frames.JointOrBaseFrame) -> FlangePath:
    """The flange's path in cylinder coordinates of frame j, degrees and mm, rounded for a plot."""
    flange = transform_points(frame.T_r_b, [view.T_b_f[:3, 3] for view in result.views])
    azimuth = np.degrees(np.unwrap(np.arctan2(flange[:, 1], flange[:, 0])))
    distance = 1e3 * np.hypot(flange[:, 0], flange[:, 1])
    points: Array = np.round(np.column_stack((azimuth, distance, 1e3 * flange[:, 2])), 3)
    return tuple((a, r, z) for a, r, z in points.tolist())


_cached_feature_edges = lru_cache(maxsize=MOST_CACHED_EDGES)(feature_edges)


STEP_KEY: Final = "scan.step_mm"
JOINT_PREFIX: Final = "joint."
DERIVED_RULE_PREFIX: Final = "rule."
JOINT_FILE_TABLES: Final = tuple(JointFile.model_fields)
AZIMUTH_KEY: Final = "rule.start_azimuth_deg"


class ScanStudyBackend(trial.StudyBackend[ScanOutcome]):
    """How scans are resolved, executed and reported in a study.

    Keys are from the job file, from the joint's file below ``joint.``
    (``joint.brace.wall_mm``), and from `DerivedKeySettings` below ``rule.``.
    """

    outcome = ScanOutcome
    seed = "simulation.seed"
    measures = (
        trial.ReportedQuantity("profiles per section", lambda m: m.scans_per_section, ".2f"),
        trial.ReportedQuantity("mean step error / %", lambda m: m.step_error_percent, "+.2f"),
        trial.ReportedQuantity("mean corner error / mm", lambda m: m.corner_mean_mm, ".3f"),
    )

    def resolve_run(self, job_file: Path, keys: Mapping[str, Any]) -> trial.ResolvedRun:
        """Resolve and check the settings of one scan; see `StudyBackend.resolve_run`."""
        job_keys, joint_keys, rules = _split_keys(keys)
        with trial.drop_file_from_study_key_errors(job_keys):
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
        changed, followed = _apply_derived_key_rules(job, joint, rules, mount.T_f_s)
        if job.calibration.file is not None:
            changed["calibration"] = {"T_f_s_mm": pose_to_rows_mm(mount.T_f_s)}
        resolved = validate_table(ScanJob, table_to_dict(job) | changed)
        return trial.ResolvedRun(
            StudyScanSettings(resolved, joint).to_canonical_json_text(), followed
        )

    def execute_run(self, settings: str) -> ScanOutcome:
        """Execute one scan; see `StudyBackend.execute_run`."""
        return scan_for_study(StudyScanSettings.from_json_text(settings))


SCAN_STUDY: Final = ScanStudyBackend()


def _split_keys(
    keys: Mapping[str, Any],
) -> tuple[dict[str, Any], dict[str, Any], DerivedKeySettings]:
    """The keys of the job, of the joint's file, and the rules."""
    job, joint, rule = {}, {}, {}
    for key, value in keys.items():
        table, _, inner = key.removeprefix(JOINT_PREFIX).partition(".")
        if key.startswith(DERIVED_RULE_PREFIX):
            rule[key.removeprefix(DERIVED_RULE_PREFIX)] = value
        elif key.startswith(JOINT_PREFIX) and inner and table in JOINT_FILE_TABLES:
            joint[key.removeprefix(JOINT_PREFIX)] = value
        elif key.startswith(JOINT_PREFIX) and table not in JointSettings.file_key_types():
            nearest = nearest_word(table, (*JOINT_FILE_TABLES, *JointSettings.file_key_types()))
            reason = f"unknown key; did you mean: {JOINT_PREFIX}{nearest}?"
            raise ConfigurationError(reason, key=key)
        else:
            job[key] = value
    with _prefix_error_keys(DERIVED_RULE_PREFIX):
        return job, joint, validate_table(DerivedKeySettings, rule)


def _read_joint_file(file: Path, keys: Mapping[str, Any], rules: DerivedKeySettings) -> JointFile:
    if not file.is_file():
        raise ConfigurationError(f"there is no such file: {file}", key="joint.file")
    data = read_toml(file)
    for key, value in keys.items():
        table, _, name = key.partition(".")
        data[table] = {**data.get(table, {}), name: value}
    with _prefix_error_keys(JOINT_PREFIX):
        joint = joint_with_derived_dimensions(validate_table(JointFile, data), rules)
        joint.definition(file.stem)  # refuses what can't be built
    return joint


def _apply_derived_key_rules(
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
        cells[AZIMUTH_KEY] = azimuth
    elif rules.carry_base or rules.centre_view:
        raise ConfigurationError("is needed for the other rules", key=AZIMUTH_KEY)
    return tables, cells


@contextmanager
def _prefix_error_keys(table: str) -> Iterator[None]:
    """Name keys as the study does: below the table's name."""
    try:
        yield
    except ConfigurationError as error:
        key = table.removesuffix(".") if error.key is None else f"{table}{error.key}"
        raise ConfigurationError(error.message, key=key) from None
