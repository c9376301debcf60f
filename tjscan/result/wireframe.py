"""A joint as a wireframe, to draw a scan on."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections, feature_edges
from tjscan.joint.geometry import cylindrical_to_j

LINES_ALONG_TUBE = 24
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
    for phi in np.linspace(0, 2 * np.pi, LINES_ALONG_TUBE, endpoint=False):
        start = float(joint.leg_surface.height(phi, joint.brace_radius))
        lines.append(cylindrical_to_j(np.full(2, phi), joint.brace_radius, np.array((start, top))))
    left, right = leg_rings(joint)
    spokes = slice(None, None, 180 // LINES_ALONG_TUBE)
    return [*lines, left, right, *np.stack((left[spokes], right[spokes]), axis=1)]


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


STEPS_AROUND_BRACE: Final = 144
"""Steps about the brace: within 0.06 mm of a circle of 228.6 mm radius, for the eye."""


def joint_ghost_mesh(joint: JointDefinition) -> tuple[Array, NDArray[np.intp]]:
    """Triangles of the leg's outside, and of the brace's groove and outside as far as it is near.

    Parameters
    ----------
    joint : JointDefinition
        As designed.

    Returns
    -------
    vertices : ndarray, shape (n, 3)
        In frame j, metres.
    triangles : ndarray of int, shape (m, 3)
    """
    phi = np.linspace(0, 2 * np.pi, STEPS_AROUND_BRACE, endpoint=False)
    groove = JointGrooveSections(joint, phi)
    edges = [cylindrical_to_j(phi, rz[:, 0], rz[:, 1]) for rz in (groove.p4, groove.p3, groove.p2)]
    top = cylindrical_to_j(phi, groove.p2[:, 0], np.full(STEPS_AROUND_BRACE, brace_top(joint)))
    strips = ([ring[:-1] for ring in leg_rings(joint)], [*edges, top])
    vertices, triangles, first = [], [], 0
    for rings in strips:
        for lower, upper in pairwise(rings):
            n = len(lower)
            here = first + np.arange(n)
            after = np.roll(here, -1)
            vertices += [lower, upper]
            triangles += [
                np.column_stack((here, after, here + n)),
                np.column_stack((after, after + n, here + n)),
            ]
            first += 2 * n
    return np.concatenate(vertices), np.concatenate(triangles)
