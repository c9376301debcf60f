"""Weld metal on a joint beside its root bead: tacks, seam caps and spatter, as solids."""

from __future__ import annotations

from typing import Final

import manifold3d
import numpy as np

from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition, SeamWeldCap, TackWeld
from tjscan.joint.edges import JointGrooveSections, leg_normal_rz
from tjscan.joint.geometry import cylindrical_to_j

TACK_BOW_RATIO: Final = 0.2
"""Height of a tack over the chord between its toes, by the chord's length (assumption)."""

TACK_RAMP_LENGTH: Final = 5e-3
"""Length over which a tack's ends rise, in metres (assumption)."""

DEPOSIT_SINK_DEPTH: Final = 1.5e-3
"""How deep weld metal dips into brace and leg, in metres: solids that only touch don't join."""

_TACK_STATIONS, _FACE_POINTS = 61, 12
_LEAST_RISE_HEIGHT = 0.1e-3


def tack_solid(definition: JointDefinition, tack: TackWeld, span: Array) -> manifold3d.Manifold:
    """A tack: its convex section between bevel and leg, swept along the root.

    Parameters
    ----------
    span : ndarray, shape (2,)
        First and last azimuth, as `tack_spans` gives them.
    """
    phi = np.linspace(span[0], span[1], _TACK_STATIONS)
    s = JointGrooveSections(definition, phi)
    along = np.linspace(0, tack.length, _TACK_STATIONS)
    ramp = np.clip(np.minimum(along, tack.length - along) / TACK_RAMP_LENGTH, 0, 1)
    rise = np.maximum(tack.height * np.sqrt(ramp * (2 - ramp)), _LEAST_RISE_HEIGHT)
    on_bevel = s.p3 + rise[:, None] * s.bevel
    rho = s.p4[:, 0] + rise / np.hypot(1, definition.leg_surface.slope(phi, s.p4[:, 0]))
    on_leg = np.column_stack((rho, definition.leg_surface.height(phi, rho)))
    chord = on_bevel - on_leg
    outward = chord[:, ::-1] * (1, -1)
    t = np.linspace(0, 1, _FACE_POINTS)[:, None, None]
    face = on_leg + t * chord + TACK_BOW_RATIO * 4 * t * (1 - t) * outward
    # Its ends go on into leg and bevel: corners that lie on a surface would leave slivers.
    face[0], face[-1] = 2 * face[0] - face[1], 2 * face[-1] - face[-2]
    into_leg = -DEPOSIT_SINK_DEPTH * leg_normal_rz(definition.leg_surface, phi, rho)
    into_brace = DEPOSIT_SINK_DEPTH * s.bevel[:, ::-1] * (-1, 1)
    up = np.array((0.0, DEPOSIT_SINK_DEPTH))
    # Under the land, then inside the brace: it fills the root opening.
    foot = s.p4 - 0.5 * (s.land - s.land_inner) + 2 * into_leg
    inner = s.land_inner + up + into_brace
    outline = np.stack((foot, on_leg + into_leg, *face, on_bevel + into_brace, inner), 1)
    return _solid_through_outlines(cylindrical_to_j(phi[:, None], outline[..., 0], outline[..., 1]))


def _solid_through_outlines(outline: Array) -> manifold3d.Manifold:
    """The solid between sections, shape (n, m, 3), closed at both ends by fans."""
    n, m = outline.shape[:2]
    index = np.arange(n * m).reshape(n, m)
    a, b = index[:-1], index[1:]
    c, d = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    sides = np.stack((a, b, c, b, d, c), axis=-1).reshape(-1, 3)
    centres = outline[[0, -1]].mean(axis=1)
    ends = [
        np.column_stack((ring, np.roll(ring, -turn), np.full(m, n * m + k)))
        for k, (ring, turn) in enumerate(((index[0], 1), (index[-1][::-1], 1)))
    ]
    vertices = np.concatenate((outline.reshape(-1, 3), centres))
    triangles = np.concatenate((sides, *ends)).astype(np.uint64)
    solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, triangles))
    if solid.volume() < 0:
        solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, triangles[:, ::-1].copy()))
    return solid


def seam_cap_solid(definition: JointDefinition, seam: SeamWeldCap) -> manifold3d.Manifold:
    """The cap of a seam weld along the leg, a prism about its axis."""
    half = 0.5 * seam.width / definition.leg_radius
    angle = seam.at + np.linspace(-half, half, 33)
    share = np.linspace(-1, 1, 33)
    base = _leg_radius(definition, angle)
    top = base + seam.height * (1 - share**2) - 1e-6
    bottom = base - min(DEPOSIT_SINK_DEPTH, 0.5 * definition.leg_wall)
    ring = [(r * np.cos(a), r * np.sin(a)) for r, a in zip(top, angle, strict=True)]
    back = [(r * np.cos(a), r * np.sin(a)) for r, a in zip(bottom, angle, strict=True)]
    section = manifold3d.CrossSection([np.array(ring + back[::-1])], manifold3d.FillRule.NonZero)
    length = definition.leg_length
    prism = manifold3d.Manifold.extrude(section, length).translate((0, 0, -length / 2))
    up = (-np.cos(definition.angle), 0.0, np.sin(definition.angle))
    axis = definition.leg_surface.axis
    return prism.transform(np.column_stack((up, (0.0, 1.0, 0.0), axis, np.zeros(3))))


def _leg_radius(definition: JointDefinition, clock: Array) -> Array:
    """Distance of the leg's surface from its axis at clock angles, shape (n,)."""
    section = getattr(definition.leg_surface, "section", None)
    if section is None:
        return np.full_like(clock, definition.leg_radius)
    return np.asarray(section.radius_in_direction(clock))


def spatter_solids(definition: JointDefinition) -> list[manifold3d.Manifold]:
    """Drops of weld metal beside and in the groove, half sunk into the surface."""
    table = definition.imperfections.spatter
    length = definition.leg_surface.arc_length(definition.brace_radius, 0, 2 * np.pi)
    rng = np.random.default_rng(table.seed)
    count = round(table.density * length)
    phi = rng.uniform(0, 2 * np.pi, count)
    s = JointGrooveSections(definition, phi)
    place = rng.uniform(-1, 1, count)
    depth = np.linalg.norm(s.p2 - s.p3, axis=1)
    # From -1 to -0.4 on the wall, to 0.3 on the bevel, then on the leg.
    wall = s.p2[:, 1] + (-0.4 - place) / 0.6 * table.reach
    on_wall = np.column_stack((definition.brace_wall_radius(phi, wall), wall))
    on_bevel = s.p2 + ((place + 0.4) / 0.7)[:, None] * (s.p3 - s.p2)
    rho = s.p4[:, 0] + (place - 0.3) / 0.7 * table.reach
    rho = np.minimum(rho, 0.98 * definition.leg_radius)
    on_leg = np.column_stack((rho, definition.leg_surface.height(phi, rho)))
    below_wall = np.where((place < 0.3)[:, None], on_bevel, on_leg)
    rz = np.where((place < -0.4)[:, None], on_wall, below_wall)
    radii = rng.uniform(*table.radius, count)
    clear = ~((place >= -0.4) & (place < 0.3) & (radii > 0.2 * depth))
    centres = cylindrical_to_j(phi, rz[:, 0], rz[:, 1])[clear]
    return [
        manifold3d.Manifold.sphere(float(radius), 16).translate(tuple(centre))
        for radius, centre in zip(radii[clear], centres, strict=True)
    ]
