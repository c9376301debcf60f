"""A joint as a wireframe, to draw a scan on."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import feature_edges
from tjscan.joint.geometry import cylindrical_to_j

GENERATRICES = 24
"""Straight lines along each tube."""


def joint_wireframe(joint: JointDefinition) -> list[Array]:
    """Lines of a joint's wireframe: feature edges, rings and generatrices of brace and leg.

    Parameters
    ----------
    joint : JointDefinition
        As designed.

    Returns
    -------
    list of ndarray, shape (n, 3)
        Polylines in frame j, metres.
    """
    edges = feature_edges(joint, n=360)
    lines = [np.vstack((e.points_j, e.points_j[:1])) for e in (edges.p2, edges.p3, edges.p4)]
    turn = np.linspace(0, 2 * np.pi, 181)
    top = brace_top(joint)
    lines.append(cylindrical_to_j(turn, joint.brace_radius, np.full_like(turn, top)))
    for phi in np.linspace(0, 2 * np.pi, GENERATRICES, endpoint=False):
        start = float(joint.leg_surface.height(phi, joint.brace_radius))
        lines.append(cylindrical_to_j(np.full(2, phi), joint.brace_radius, np.array((start, top))))
    return lines + _leg_lines(joint)


def brace_top(joint: JointDefinition) -> float:
    """Height in frame j, metres, up to which a brace is drawn."""
    turn = np.linspace(0, 2 * np.pi, 181)
    foot = joint.leg_surface.height(turn, joint.brace_radius)
    return min(joint.brace_length, float(foot.max()) + 0.5 * joint.brace_radius)


def leg_rings(joint: JointDefinition) -> tuple[Array, Array]:
    """Closed rings, (n, 3) each, between which a leg is drawn: as far as the brace is wide."""
    turn = np.linspace(0, 2 * np.pi, 181)
    axis, side = joint.leg_surface.axis, np.array((0.0, 1.0, 0.0))
    up = np.cross(axis, side)
    ring = joint.leg_radius * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), up))
    reach = min(joint.leg_length / 2, 2 * joint.brace_radius)
    return ring - reach * axis, ring + reach * axis


def _leg_lines(joint: JointDefinition) -> list[Array]:
    """Rings and generatrices of the leg."""
    left, right = leg_rings(joint)
    spokes = slice(None, None, 180 // GENERATRICES)
    return [left, right, *np.stack((left[spokes], right[spokes]), axis=1)]
