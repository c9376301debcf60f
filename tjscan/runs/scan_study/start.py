"""The tables of a job whose start is taught from its joint's geometry."""

from __future__ import annotations

from typing import Any

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse_pose, pose_to_euler_zyx
from tjscan.core.units import pose_from_rows_mm
from tjscan.job import ScanJob
from tjscan.joint.file import JointFile
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.scan_study.rules import DerivedKeySettings
from tjscan.runs.scan_study.teaching import (
    TeachingInaccuracy,
    joint_pose_for_carried_base,
    plan_with_centred_groove,
    taught_sensor_poses,
    teaching_random_generator,
)
from tjscan.study.trial import canonical_json


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
        If base or view depend on how far the scan goes, and nothing says so.
    """
    if job.joint is None or job.simulation is None or job.simulation.arm is None:
        raise ConfigurationError("a taught start needs [joint] and [simulation]")
    definition, plan = joint.definition("joint"), job.scan
    which = canonical_json([joint.model_dump(mode="json"), plan.direction])
    random = teaching_random_generator(job.simulation.seed, which)
    azimuth_deg = round(float(random.uniform(-180, 180)), 3)  # drawn in any case: the rest stays
    if rules.start_azimuth_deg is not None and rules.start_azimuth_deg != "any":
        azimuth_deg = rules.start_azimuth_deg
    azimuth = float(np.radians(azimuth_deg))
    scan: dict[str, Any] = {}
    if (rules.carry_base or rules.centre_view) and plan.sections is None:
        raise ConfigurationError("is needed to know how far the scan goes", key="scan.sections")
    if rules.centre_view:
        window = (job.laser.near, job.laser.far)
        plan = plan_with_centred_groove(definition, azimuth, plan, window)
        scan = {
            "view_offset_mm": round(1e3 * plan.offset, 1),
            "standoff_mm": round(1e3 * plan.standoff, 1),
        }
    if job.simulation.T_f_s_mm is not None:  # an operator teaches with the laser that is there
        T_f_s = pose_from_rows_mm(job.simulation.T_f_s_mm)
    error = TeachingInaccuracy(1e-3 * rules.hand_mm, float(np.radians(rules.hand_deg)))
    T_j_s = taught_sensor_poses(definition, azimuth, plan, error, random)
    T_b_j = job.joint.T_w_j  # a study's jobs have no stations
    changed: dict[str, Any] = {}
    if rules.carry_base:
        q_home = np.array(job.simulation.arm.home)
        T_b_s_home = Kinematics.load(job.arm.model).forward(q_home) @ T_f_s
        T_b_j = joint_pose_for_carried_base(definition, azimuth, plan, T_b_s_home)
        changed["joint"] = {"file": job.joint.file} | _pose(T_b_j)
    first, second = (_pose(T_b_j @ T @ inverse_pose(T_f_s)) for T in T_j_s)
    return azimuth_deg, changed | {"scan": scan | {"first": first, "second": second}}


def _pose(T: Array) -> dict[str, Any]:
    """A pose as files write it, to a micrometre and a microdegree."""
    position, angles = pose_to_euler_zyx(T)
    return {
        "position_mm": np.round(1e3 * position, 3).tolist(),
        "euler_zyx_deg": np.round(np.degrees(angles), 6).tolist(),
    }
