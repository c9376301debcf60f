"""The designed joint as a few triangles, behind what was measured."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.joint.bevel import groove_sections
from tjscan.joint.definition import JointDefinition
from tjscan.joint.geometry import cylindrical_to_j
from tjscan.result.wireframe import brace_top, leg_rings

AROUND: Final = 144
"""Steps about the brace: within 0.06 mm of a circle of 228.6 mm radius, for the eye."""


def ghost_of_joint(joint: JointDefinition) -> tuple[Array, NDArray[np.intp]]:
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
    phi = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    groove = groove_sections(joint, phi)
    edges = [cylindrical_to_j(phi, rz[:, 0], rz[:, 1]) for rz in (groove.p4, groove.p3, groove.p2)]
    top = cylindrical_to_j(phi, groove.p2[:, 0], np.full(AROUND, brace_top(joint)))
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
