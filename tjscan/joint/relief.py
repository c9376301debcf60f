"""Texture of a joint's surfaces that is too fine for its solid: mill scale and scallops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.special import ndtri

from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition, MillScale
from tjscan.joint.edges import JointGrooveSections

ReliefHeight = Callable[[Array], Array]
"""Height over the solid's surface at points on it, shape (n, 3), in frame j: shape (n,), metres."""

ON_SURFACE_DISTANCE: Final = 0.1e-3
"""Points this near a surface of the joint lie on it, in metres."""

MILL_SCALE_WAVES: Final = 16
PATCH_RIM_SHARE: Final = 0.1
"""Share of a patch's size over which its rim falls."""


def make_relief_height_function(definition: JointDefinition) -> ReliefHeight | None:
    """Function of a joint's surface relief height; None if its surfaces are smooth."""
    scale, bevel = definition.imperfections.scale, definition.imperfections.bevel
    parts: list[ReliefHeight] = []
    if scale.thickness > 0:
        parts.append(_mill_scale_heights(definition, scale))
    if bevel.scallop_depth > 0:
        parts.append(_scallop_heights(definition))
    if not parts:
        return None
    return lambda points_j: np.asarray(sum(part(points_j) for part in parts))


def _mill_scale_heights(definition: JointDefinition, scale: MillScale) -> ReliefHeight:
    """Patches on the tubes' outer sides: where a sum of random waves is high.

    The sum is about Gaussian, so its quantile sets how much is covered.
    """
    rng = np.random.default_rng(scale.seed)
    ways = rng.standard_normal((MILL_SCALE_WAVES, 3))
    waves = np.pi / scale.patch * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    phases = rng.uniform(0, 2 * np.pi, MILL_SCALE_WAVES)
    limit = float(ndtri(1 - scale.coverage))
    leg = definition.leg_surface

    def height(points_j: Array) -> Array:
        field = np.sqrt(2 / MILL_SCALE_WAVES) * np.cos(points_j @ waves.T + phases).sum(axis=1)
        phi = np.arctan2(points_j[:, 1], points_j[:, 0])
        rho = np.hypot(points_j[:, 0], points_j[:, 1])
        wall = np.abs(rho - definition.brace_wall_radius(phi, points_j[:, 2])) < ON_SURFACE_DISTANCE
        tubes = wall | (np.abs(leg.signed_distances(points_j)) < ON_SURFACE_DISTANCE)
        share = np.clip((field - limit) / PATCH_RIM_SHARE + 0.5, 0, 1)
        return np.asarray(tubes * scale.thickness * share)

    return height


def _scallop_heights(definition: JointDefinition) -> ReliefHeight:
    """Arcs between sharp crests along the bevel, half above and half below its line."""
    cut = definition.imperfections.bevel

    def height(points_j: Array) -> Array:
        phi = np.arctan2(points_j[:, 1], points_j[:, 0])
        rz = np.column_stack((np.hypot(points_j[:, 0], points_j[:, 1]), points_j[:, 2]))
        s = JointGrooveSections(definition, phi)
        along = s.p2 - s.p3
        length = np.linalg.norm(along, axis=1)
        up = np.sum((rz - s.p3) * along, axis=1) / length
        off = np.sum((rz - s.p3) * along[:, ::-1] * (1, -1), axis=1) / length
        # With facets the bevel leaves the line between its ends by so much at most.
        reach = ON_SURFACE_DISTANCE + abs(np.tan(cut.facet_angle)) * length / 4
        on_bevel = (np.abs(off) < reach) & (up > 0) & (up < length)
        wave = 1 - 2 * np.abs(np.sin(np.pi * up / cut.scallop_length))
        return np.asarray(on_bevel * 0.5 * cut.scallop_depth * wave)

    return height
