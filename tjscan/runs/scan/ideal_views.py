"""Where the sensor ideally looks at a joint's groove from, by the joint's definition.

What teaches start poses for the program does so: studies, and the search for places of a joint.
No scan knows any of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Final

import numpy as np
from scipy.integrate import cumulative_trapezoid

from tjscan.core import frames
from tjscan.core.frames import Array, inverse_pose, pose, transform_points
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.geometry import cylindrical_to_j, tangential_direction
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.target import ScanDirection

GROOVE_LENGTH_AZIMUTHS: Final = np.linspace(-2 * np.pi, 4 * np.pi, 4321)
"""Where the groove's length is tabulated: a turn, and one more either way."""


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
    y = frames.unit_vector(np.array([0.0, 0.0, 1.0]) - x[2] * x)
    T_j_t = pose(np.column_stack((x, y, np.cross(x, y))), origin)
    T_s_t = plan.target_pose_in_sensor(_work_angle(joint, sections.bevel[0], azimuth, tangent))
    return T_j_t @ (np.eye(4) if error is None else error) @ inverse_pose(T_s_t)


def _work_angle(joint: JointDefinition, bevel: Array, azimuth: float, tangent: Array) -> float:
    """β from bevel and leg in the plane square to the groove, eq. (16), radians."""
    y = frames.unit_vector(np.array([0.0, 0.0, 1.0]) - tangent[2] * tangent)
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
    more = plan.length if plan.sections is None else (plan.sections - 2) * plan.step
    whole, way = plan.step + (more or 0.0), plan.direction
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
    corners = np.concatenate([_ideal_corners_s(joint, phi, plan) for phi in azimuths])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    standoff = plan.standoff + sum(window) / 2 - float(middle[2])
    return replace(plan, offset=plan.offset - float(middle[0]), standoff=standoff)


def _ideal_corners_s(joint: JointDefinition, azimuth: float, plan: ScanPlan) -> Array:
    """p2, p3, p4 of an azimuth as the sensor ideally sees them, shape (3, 3), metres."""
    sections = JointGrooveSections(joint, [azimuth])
    rz = np.concatenate((sections.p2, sections.p3, sections.p4))
    T_s_j = inverse_pose(ideal_sensor_pose(joint, azimuth, plan))
    return transform_points(T_s_j, cylindrical_to_j(azimuth, rz[:, 0], rz[:, 1]))


def pose_to_table(T: Array) -> dict[str, Any]:
    """A pose as files write it, to a micrometre and a microdegree."""
    position, angles = frames.pose_to_euler_zyx(T)
    return {
        "position_mm": np.round(1e3 * position, 3).tolist(),
        "euler_zyx_deg": np.round(np.degrees(angles), 6).tolist(),
    }
