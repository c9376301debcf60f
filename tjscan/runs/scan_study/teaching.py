"""Start poses as an operator teaches them, and an arm whose base is carried to the joint."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, inverse_pose, pose, transform_points, unit_vector
from tjscan.joint.bevel import groove_sections
from tjscan.joint.definition import JointDefinition
from tjscan.joint.geometry import cylindrical_to_j, tangential_direction
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.target import ScanDirection

STREAM: Final = 11
"""Keeps these random numbers apart from those of arm and laser."""

AZIMUTHS: Final = np.linspace(-2 * np.pi, 4 * np.pi, 4321)
"""Where the groove's length is tabulated: a turn, and one more either way."""


@dataclass(frozen=True, slots=True)
class TeachingInaccuracy:
    """Largest error of a taught pose along and about each axis of frame t.

    The operator watches the laser line on the steel: shift and turn are those of frame t, which
    lies in the groove, and not of the sensor an arm's length above it.

    Parameters
    ----------
    shift, turn : float
        Metres and radians.
    """

    shift: float
    turn: float

    def draw_random_pose_error(self, rng: np.random.Generator) -> Array:
        """Draw a random error of frame t, as a pose in itself, shape (4, 4), metres."""
        turn = Rotation.from_rotvec(rng.uniform(-self.turn, self.turn, 3))
        return pose(turn.as_matrix(), rng.uniform(-self.shift, self.shift, 3))


def teaching_random_generator(seed: int, joint: str) -> np.random.Generator:
    """Random generator for teaching errors: another for every joint, the same each time.

    Parameters
    ----------
    seed : int
        Of the job.
    joint : str
        The joint, as text.
    """
    digest = hashlib.sha256(joint.encode()).digest()
    return np.random.default_rng([seed, STREAM, int.from_bytes(digest[:8])])


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
    sections = groove_sections(joint, phi)
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
    outward = np.array([around[1], -around[0], 0.0])
    up = bevel[0] * outward + np.array([0.0, 0.0, bevel[1]])
    leg = np.cross(
        tangent, joint.leg_surface.normal(joint.leg_surface.points_j(azimuth, joint.brace_radius))
    )
    gamma_1 = np.arctan2(up @ y, up @ z)
    gamma_2 = np.arctan2(-(leg @ y), leg @ z)
    return float(0.5 * (gamma_1 - gamma_2))


def azimuth_further_along(
    joint: JointDefinition, azimuth: float, distance: float, direction: ScanDirection
) -> float:
    """Azimuth that lies a distance along the groove from another one.

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
    speed = np.linalg.norm(
        joint.leg_surface.azimuth_derivative(AZIMUTHS, joint.brace_radius), axis=1
    )
    length = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(AZIMUTHS))))
    signed = distance if direction is ScanDirection.COUNTERCLOCKWISE else -distance
    return float(np.interp(np.interp(azimuth, AZIMUTHS, length) + signed, length, AZIMUTHS))


def taught_sensor_poses(
    joint: JointDefinition,
    azimuth: float,
    plan: ScanPlan,
    error: TeachingInaccuracy,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Simulate both start poses of the sensor as an operator teaches them, a step apart.

    Parameters
    ----------
    joint : JointDefinition
        The joint.
    azimuth : float
        Of the first pose in frame j, radians.
    plan : ScanPlan
        Step, direction, angles and stand-off.
    error : TeachingInaccuracy
        How far off they are.
    rng : Generator
        Draws the errors.

    Returns
    -------
    first, second : ndarray, shape (4, 4)
        T_j_s, metres.
    """
    second = azimuth_further_along(joint, azimuth, plan.step, plan.direction)
    first_view, second_view = (
        ideal_sensor_pose(joint, phi, plan, error.draw_random_pose_error(rng))
        for phi in (azimuth, second)
    )
    return first_view, second_view


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
    whole = ((plan.sections or 1) - 1) * plan.step
    return [
        azimuth_further_along(joint, azimuth, share * whole, plan.direction) for share in shares
    ]


def joint_pose_for_carried_base(
    joint: JointDefinition, azimuth: float, plan: ScanPlan, T_b_s_home: Array
) -> Array:
    """Pose of the joint in the base frame when the base is carried, as on a gantry, to it.

    Parameters
    ----------
    joint, azimuth, plan
        The joint, where its scan starts (radians), and what is scanned.
    T_b_s_home : ndarray, shape (4, 4)
        The sensor's pose in the arm's home configuration.

    Returns
    -------
    ndarray, shape (4, 4)
        T_b_j: at home the arm looks at the middle of the arc.
    """
    (middle,) = azimuths_at_plan_shares(joint, azimuth, plan, [0.5])
    return T_b_s_home @ inverse_pose(ideal_sensor_pose(joint, middle, plan))


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
        With stand-off and offset changed so that p2, p3 and p4, over the whole arc, lie evenly
        about the middle of the window and of the line.
    """
    corners = np.concatenate(
        [
            _corners_s(joint, phi, plan)
            for phi in azimuths_at_plan_shares(joint, azimuth, plan, np.linspace(0, 1, 9))
        ]
    )
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return replace(
        plan,
        offset=plan.offset - float(middle[0]),
        standoff=plan.standoff + sum(window) / 2 - float(middle[2]),
    )


def _corners_s(joint: JointDefinition, azimuth: float, plan: ScanPlan) -> Array:
    """p2, p3, p4 of an azimuth as the sensor ideally sees them, shape (3, 3), metres."""
    sections = groove_sections(joint, [azimuth])
    rz = np.concatenate((sections.p2, sections.p3, sections.p4))
    T_s_j = inverse_pose(ideal_sensor_pose(joint, azimuth, plan))
    return transform_points(T_s_j, cylindrical_to_j(azimuth, rz[:, 0], rz[:, 1]))
