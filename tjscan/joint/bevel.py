"""The prepared brace end and the root bead, one radial half-plane per azimuth.

The land lies at the root opening from the leg, over the root face's share of the wall. From its
outer edge the bevel rises as a straight line to the brace's outer wall. The root bead closes
the groove with a face from the bevel to the leg; an open root has none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array, frozen_arrays
from tjscan.joint.definition import JointDefinition
from tjscan.joint.geometry import LegSurface, radial_direction, tangential_direction

WALL_CORRECTION_ROUNDS: Final = 12
"""Corrections of where a tilted wall is met; each is smaller by a fifth or less."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class JointGrooveSections:
    """Sections of a joint's designed groove in radial half-planes, one for each azimuth.

    Parameters
    ----------
    phi : ndarray, shape (n,)
        Azimuths in radians.
    dihedral : ndarray, shape (n,)
        Local dihedral angle at the brace's outer wall, in radians.
    groove_angle : ndarray, shape (n,)
        Prescribed angle between bevel and leg, in radians, in the section normal to the line
        along the land's outer edge.
    bevel : ndarray, shape (n, 2)
        Unit vectors up the bevel.
    land_inner, land : ndarray, shape (n, 2)
        Inner and outer edge of the land, as distance from the brace's axis and z, in metres.
    apex : ndarray, shape (n, 2)
        Where the bevel, drawn on, meets the leg.
    p2, p3, p4 : ndarray, shape (n, 2)
        The paper's corners (Fig. 3): top of the bevel, root corner on the bevel, root corner
        on the leg. Where the root is open p3 is the land's outer edge and p4 its foot on the leg.
    """

    phi: Array
    dihedral: Array
    groove_angle: Array
    bevel: Array
    land_inner: Array
    land: Array
    apex: Array
    p2: Array
    p3: Array
    p4: Array

    @property
    def root_width(self) -> Array:
        """Width of the root bead's face, or of an open root, in metres, shape (n,)."""
        return np.asarray(np.linalg.norm(self.p4 - self.p3, axis=1))

    @property
    def bevel_length(self) -> Array:
        """Length of the bevel from the land to the outer wall in metres, shape (n,)."""
        return np.asarray(np.linalg.norm(self.p2 - self.land, axis=1))


def groove_sections(definition: JointDefinition, phi: ArrayLike) -> JointGrooveSections:
    """Compute the sections of a joint's groove at azimuths, shape (n,), in radians."""
    phi = np.asarray(phi, dtype=float)
    leg = definition.leg_surface
    gapped = leg.offset_surface(definition.root_opening_at(phi))
    dihedral = leg.dihedral_angle(phi, definition.brace_radius)
    groove_angle = definition.groove_angle_at(dihedral)

    rho_inner = _bore(definition, gapped, phi)
    land_inner = _on(gapped, phi, rho_inner)
    land = _on(gapped, phi, rho_inner + definition.root_face)
    bevel = bevel_direction(gapped, phi, land[:, 0], groove_angle)
    p2 = _top(definition, phi, land, bevel)
    apex = leg.ray_intersections(phi, land, -bevel)
    if definition.imperfections.root.is_open:
        p4 = leg.ray_intersections(phi, land, -leg_normal_rz(gapped, phi, land[:, 0]))
        return JointGrooveSections(
            phi, dihedral, groove_angle, bevel, land_inner, land, apex, p2, land, p4
        )
    p3 = land + definition.root_bead * bevel
    # The bead's face is the base of an isosceles triangle between the bevel and the leg's
    # tangent at the apex, so it is about square to the bisector of the groove.
    p4 = leg.ray_intersections(phi, p3, _along(leg, phi, apex[:, 0]) - bevel)
    return JointGrooveSections(
        phi, dihedral, groove_angle, bevel, land_inner, land, apex, p2, p3, p4
    )


def bevel_direction(gapped: LegSurface, phi: Array, rho: Array, groove_angle: Array) -> Array:
    """Directions up the bevel in the radial half-planes, unit length, shape (n, 2).

    The line along the land's outer edge lies both in the bevel and in the surface at the root
    gap over the leg. Turning that surface's tangent plane about the line by the groove angle
    gives the bevel's tangent plane; where it cuts the half-plane is the direction sought.

    Parameters
    ----------
    gapped : LegSurface
        The surface at the root gap over the leg.
    phi, rho, groove_angle : ndarray, shape (n,)
        Azimuth, distance of the land's outer edge from the brace's axis, and angle between
        bevel and leg in the section normal to that edge.
    """
    tangent = gapped.tangent(phi, rho)
    normal = gapped.normal(gapped.points_j(phi, rho))
    outward = np.cross(tangent, normal)
    angle = groove_angle[:, None]
    up = np.cos(angle) * outward + np.sin(angle) * normal
    around = tangential_direction(phi)
    sideways = np.sum(up * around, axis=1) / np.sum(tangent * around, axis=1)
    in_half_plane = up - sideways[:, None] * tangent
    rho_part = np.sum(in_half_plane * radial_direction(phi), axis=1)
    return _unit(np.column_stack((rho_part, in_half_plane[:, 2])))


def leg_normal_rz(leg: LegSurface, phi: Array, rho: Array) -> Array:
    """Unit vectors out of the leg in the radial half-planes, square to its line there, (n, 2)."""
    return _along(leg, phi, rho)[:, ::-1] * (-1.0, 1.0)


def _bore(definition: JointDefinition, gapped: LegSurface, phi: Array) -> Array:
    """Distance from the brace's axis at which its bore meets the surface at the root opening."""
    rho = np.full_like(phi, definition.brace_inner_radius)
    if definition.imperfections.is_brace_nominal:
        return rho
    for _ in range(WALL_CORRECTION_ROUNDS):
        rho = definition.brace_wall_radius(phi, gapped.height(phi, rho)) - definition.brace_wall
    return rho


def _top(definition: JointDefinition, phi: Array, land: Array, bevel: Array) -> Array:
    """Where the bevel meets the brace's outer wall, (n, 2)."""
    top = land
    for _ in range(1 if definition.imperfections.is_brace_nominal else WALL_CORRECTION_ROUNDS):
        wall = definition.brace_wall_radius(phi, top[:, 1])
        top = land + ((wall - land[:, 0]) / bevel[:, 0])[:, None] * bevel
    return top


def _on(leg: LegSurface, phi: Array, rho: Array) -> Array:
    return np.column_stack((rho, leg.height(phi, rho)))


def _along(leg: LegSurface, phi: Array, rho: Array) -> Array:
    """Unit vectors along the leg in the radial half-planes, away from the brace, (n, 2)."""
    return _unit(np.column_stack((np.ones_like(phi), leg.slope(phi, rho))))


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))
