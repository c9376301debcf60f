"""Rules of a study of scans: dimensions, start poses and views that follow from other keys."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from tjscan.core.config import StrictFileModel
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose,
    pose_to_euler_zyx,
    transform_points,
    unit_vector,
)
from tjscan.core.units import pose_from_rows_mm
from tjscan.job.files import ScanJob
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.file import CHECKED_AZIMUTHS, JointFile
from tjscan.joint.geometry import cylindrical_to_j, tangential_direction
from tjscan.robot.kinematics import Kinematics
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.target import ScanDirection
from tjscan.study.trial import canonical_json


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


LONGEST_MM = 20_000.0
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
    return joint if rules.room_mm is None else _joint_with_room(joint, rules.room_mm)


def _joint_with_room(joint: JointFile, room_mm: float) -> JointFile:
    """The joint with as much leg and brace as leaves room beyond the groove."""
    longest = {"length_mm": LONGEST_MM}
    leg, brace = joint.leg.model_copy(update=longest), joint.brace.model_copy(update=longest)
    long_joint = joint.model_copy(update={"leg": leg, "brace": brace})
    up, along = _groove_extent(long_joint.definition("joint"))
    leg = leg.model_copy(update={"length_mm": float(np.ceil(2 * (1e3 * along + room_mm)))})
    brace = brace.model_copy(update={"length_mm": float(np.ceil(1e3 * up + room_mm))})
    return joint.model_copy(update={"leg": leg, "brace": brace})


def _groove_extent(d: JointDefinition) -> tuple[float, float]:
    """How far the groove reaches up the brace and along the leg, metres from where axes cross."""
    s = JointGrooveSections(d, CHECKED_AZIMUTHS)
    foot = d.leg_surface.points_j(s.phi, d.brace_radius) @ d.leg_surface.axis
    root = cylindrical_to_j(s.phi, s.p4[:, 0], s.p4[:, 1]) @ d.leg_surface.axis
    return float(s.p2[:, 1].max()), float(np.abs((foot, root)).max())


TEACHING_STREAM: Final = 11
"""Keeps these random numbers apart from the arm's and the laser's."""

GROOVE_LENGTH_AZIMUTHS: Final = np.linspace(-2 * np.pi, 4 * np.pi, 4321)
"""Where the groove's length is tabulated: a turn, and one more either way."""


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


def ideal_sensor_pose(
    joint: JointDefinition, azimuth: float, plan: ScanPlan, error: Array | None = None
) -> Array:
    """Ideal pose of the sensor before the groove at an azimuth.

    Parameters
    ----------
    joint : JointDefinition
        The joint.
    azimuth : float
        In frame j, radians.
    plan : ScanPlan
        Direction, angles and stand-off.
    error : ndarray, shape (4, 4), optional
        What frame t is off by, in itself.

    Returns
    -------
    ndarray, shape (4, 4)
        T_j_s, in metres.
    """
    phi = np.array([azimuth])
    tangent = joint.leg_surface.tangent(phi, joint.brace_radius)[0]
    sections = JointGrooveSections(joint, phi)
    origin = joint.leg_surface.points_j(phi, joint.brace_radius)[0]
    x = tangent if plan.direction is ScanDirection.COUNTERCLOCKWISE else -tangent
    y = unit_vector(np.array([0.0, 0.0, 1.0]) - x[2] * x)
    T_j_t = pose(np.column_stack((x, y, np.cross(x, y))), origin)
    T_s_t = plan.target_pose_in_sensor(_work_angle(joint, sections.bevel[0], azimuth, tangent))
    return T_j_t @ (np.eye(4) if error is None else error) @ inverse_pose(T_s_t)


def _work_angle(joint: JointDefinition, bevel: Array, azimuth: float, tangent: Array) -> float:
    """β from bevel and leg in the plane square to the groove, eq. (16), radians."""
    y = unit_vector(np.array([0.0, 0.0, 1.0]) - tangent[2] * tangent)
    z = np.cross(tangent, y)
    around = tangential_direction(azimuth)
    up = np.array([bevel[0] * around[1], -bevel[0] * around[0], bevel[1]])
    surface = joint.leg_surface
    leg = np.cross(tangent, surface.normal(surface.points_j(azimuth, joint.brace_radius)))
    gamma_1 = np.arctan2(up @ y, up @ z)
    gamma_2 = np.arctan2(-(leg @ y), leg @ z)
    return float(0.5 * (gamma_1 - gamma_2))


def azimuth_further_along(
    joint: JointDefinition, azimuth: float, distance: float, direction: ScanDirection
) -> float:
    """Azimuth at a distance along the groove from another one.

    Parameters
    ----------
    joint : JointDefinition
        The joint.
    azimuth : float
        Radians, within a turn.
    distance : float
        Metres along the outer edge, not negative.
    direction : ScanDirection
        Which way round.
    """
    tangents = joint.leg_surface.azimuth_derivative(GROOVE_LENGTH_AZIMUTHS, joint.brace_radius)
    speed = np.linalg.norm(tangents, axis=1)
    length = cumulative_trapezoid(speed, GROOVE_LENGTH_AZIMUTHS, initial=0)
    signed = distance if direction is ScanDirection.COUNTERCLOCKWISE else -distance
    place = np.interp(azimuth, GROOVE_LENGTH_AZIMUTHS, length) + signed
    return float(np.interp(place, length, GROOVE_LENGTH_AZIMUTHS))


def azimuths_at_plan_shares(
    joint: JointDefinition, azimuth: float, plan: ScanPlan, shares: Iterable[float]
) -> list[float]:
    """Azimuths at shares (0 to 1) of the arc that a plan scans.

    Parameters
    ----------
    joint, azimuth, plan
        The joint, where its scan starts (radians), and what is scanned.
    shares : iterable of float
        From 0 at the first section to 1 at the last.

    Returns
    -------
    list of float
        Radians in frame j.
    """
    whole, way = ((plan.sections or 1) - 1) * plan.step, plan.direction
    return [azimuth_further_along(joint, azimuth, share * whole, way) for share in shares]


def plan_with_centred_groove(
    joint: JointDefinition, azimuth: float, plan: ScanPlan, window: tuple[float, float]
) -> ScanPlan:
    """Scan plan whose view has the groove in the middle of the laser's window.

    Parameters
    ----------
    joint, azimuth, plan
        The joint, where its scan starts (radians), and what is scanned.
    window : tuple of float
        Nearest and farthest z_s that the laser measures, metres.

    Returns
    -------
    ScanPlan
        With stand-off and offset changed so that p2, p3 and p4, over the whole arc, are evenly
        about the middle of the window and of the line.
    """
    azimuths = azimuths_at_plan_shares(joint, azimuth, plan, np.linspace(0, 1, 9))
    corners = np.concatenate([_corners_seen_s(joint, phi, plan) for phi in azimuths])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    standoff = plan.standoff + sum(window) / 2 - float(middle[2])
    return replace(plan, offset=plan.offset - float(middle[0]), standoff=standoff)


def _corners_seen_s(joint: JointDefinition, azimuth: float, plan: ScanPlan) -> Array:
    """p2, p3, p4 of an azimuth as the sensor ideally sees them, shape (3, 3), metres."""
    sections = JointGrooveSections(joint, [azimuth])
    rz = np.concatenate((sections.p2, sections.p3, sections.p4))
    T_s_j = inverse_pose(ideal_sensor_pose(joint, azimuth, plan))
    return transform_points(T_s_j, cylindrical_to_j(azimuth, rz[:, 0], rz[:, 1]))


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
    which = canonical_json([joint.model_dump(mode="json"), plan.direction])
    digest = int.from_bytes(hashlib.sha256(which.encode()).digest()[:8])  # other for every joint
    random = np.random.default_rng([job.simulation.seed, TEACHING_STREAM, digest])
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
        changed["joint"] = {"file": job.joint.file} | _pose_table(T_b_j)
    first, second = (_pose_table(T_b_j @ T @ inverse_pose(T_f_s)) for T in T_j_s)
    return azimuth_deg, changed | {"scan": scan | {"first": first, "second": second}}


def _pose_table(T: Array) -> dict[str, Any]:
    """A pose as files write it, to a micrometre and a microdegree."""
    position, angles = pose_to_euler_zyx(T)
    return {
        "position_mm": np.round(1e3 * position, 3).tolist(),
        "euler_zyx_deg": np.round(np.degrees(angles), 6).tolist(),
    }
