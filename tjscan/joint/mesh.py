"""A joint as a watertight solid of triangles: leg tube, bevelled brace and root bead in one."""

from __future__ import annotations

from typing import Final

import manifold3d
import numpy as np
from numpy.typing import NDArray

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, array_dataclass
from tjscan.joint.definition import JointDefinition, interpolate_around_joint
from tjscan.joint.deposits import seam_cap_solid, spatter_solids, tack_solid
from tjscan.joint.edges import JointGrooveSections, leg_normal_rz, tack_spans
from tjscan.joint.geometry import OvalLegSurface, cylindrical_to_j, tangential_direction

MOST_CHORD_ERROR: Final = 2e-6
"""Largest distance, in metres, of the triangles near the groove from the true surfaces."""

MOST_BORE_CHORD_ERROR: Final = 50e-6
"""The same for the leg's bore, which no laser sees."""

FEWEST_MESH_AZIMUTHS: Final = 1440

BEVEL_STRIPS, BEAD_STRIPS = 8, 4
"""Bevel and bead twist on their way round. Cut into strips, flat triangles follow them."""

BEAD_FACE_STRIPS = 12
"""Strips of a curved bead's face, whose edges lie on the true one."""

BEAD_SINK_DEPTH: Final = 2e-3
"""How deep bead and brace dip into the leg's wall, in metres, if the wall allows it."""


@array_dataclass
class TriangleMesh:
    """Triangles, counter-clockwise seen from outside.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In frame j, in metres.
    triangles : ndarray of int32, shape (m, 3)
        Indices of their corners.
    """

    vertices: Array
    triangles: NDArray[np.int32]


def build_joint_mesh(definition: JointDefinition) -> TriangleMesh:
    """Build the solid of a joint.

    Near the groove its triangles are within `MOST_CHORD_ERROR` of the true surfaces.

    Raises
    ------
    ConfigurationError
        If the parts don't join into one solid.
    """
    d = definition
    outer = _leg_rod(d, d.leg_radius, d.leg_length, MOST_CHORD_ERROR)
    bore = _leg_rod(d, d.leg_radius - d.leg_wall, 1.1 * d.leg_length, MOST_BORE_CHORD_ERROR)
    solid = outer - bore + _brace_and_bead(definition)
    built = definition.imperfections
    spans = tack_spans(definition)
    added = [tack_solid(definition, t, span) for t, span in zip(built.tacks, spans, strict=True)]
    solid = _unite(solid, added + [seam_cap_solid(definition, seam) for seam in built.seams])
    # Each tack across an open root joins two rings again.
    genus = 1 + len(built.tacks) * built.root.is_open
    if solid.status() != manifold3d.Error.NoError or solid.genus() != genus:
        raise ConfigurationError(f"{definition.name} does not join into one solid", key="brace")
    mesh = _unite(solid, spatter_solids(definition)).to_mesh64()
    return TriangleMesh(mesh.vert_properties[:, :3], mesh.tri_verts.astype(np.int32))


def _unite(solid: manifold3d.Manifold, parts: list[manifold3d.Manifold]) -> manifold3d.Manifold:
    """The union of a solid with others."""
    if not parts:
        return solid
    return manifold3d.Manifold.batch_boolean([solid, *parts], manifold3d.OpType.Add)


def brace_vertex_azimuths(definition: JointDefinition) -> Array:
    """Azimuths of the brace's vertices in radians, growing, shape (n,).

    They are even, and closer where triangles would leave an edge, or the faces between, by more
    than `MOST_CHORD_ERROR`: the groove's table has kinks.
    """
    phi = np.linspace(0, 2 * np.pi, FEWEST_MESH_AZIMUTHS, endpoint=False)
    while True:
        middle = _azimuths_between(phi)
        coarse = _chord_errors(definition, phi, middle) > MOST_CHORD_ERROR
        if not coarse.any():
            return phi
        phi = np.sort(np.concatenate((phi, middle[coarse])))


def largest_chord_error(definition: JointDefinition) -> float:
    """Largest distance in metres of the mesh near the groove from the true surfaces."""
    phi = brace_vertex_azimuths(definition)
    radius, segments = (
        definition.leg_radius,
        _prism_sides(definition.leg_radius, MOST_CHORD_ERROR),
    )
    leg = float(radius * (1 - np.cos(np.pi / segments)))
    return max(leg, float(_chord_errors(definition, phi, _azimuths_between(phi)).max()))


def _azimuths_between(phi: Array) -> Array:
    """Azimuths halfway to the next ones, the last one's being the first."""
    return np.asarray(phi + np.diff(phi, append=phi[0] + 2 * np.pi) / 2)


def _chord_errors(definition: JointDefinition, phi: Array, middle: Array) -> Array:
    """How far triangles leave bead and bevel between azimuths and the next ones, shape (n,)."""
    # From the corner of `_section_outlines` at which the groove begins: the bead's foot, or an open
    # root's land.
    groove = slice(2 if definition.imperfections.root.is_open else 3, -1)
    at = _section_outlines(definition, phi)[:, groove]
    after = np.roll(at, -1, axis=0)
    truth = _section_outlines(definition, middle)[:, groove]
    # An edge: only what is square to it counts, along it a chord may run ahead.
    chord, along = (at + after) / 2 - truth, after - at
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    edges = np.linalg.norm(np.cross(chord, along), axis=2)
    # A face: the diagonal that halves a quadrangle, square to the face.
    diagonal = (at[:, 1:] + after[:, :-1]) / 2 - (truth[:, 1:] + truth[:, :-1]) / 2
    normal = np.cross(at[:, 1:] - after[:, :-1], after[:, 1:] - at[:, :-1])
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    faces = np.abs(np.sum(diagonal * normal, axis=2))
    return np.asarray(np.maximum(edges.max(axis=1), faces.max(axis=1)))


def _leg_rod(d: JointDefinition, radius: float, length: float, error: float) -> manifold3d.Manifold:
    """A prism about the leg's axis; for a round leg it has the middle of a face on top."""
    segments = _prism_sides(radius, error)
    across = np.array((-np.cos(d.angle), 0.0, np.sin(d.angle)))
    T = np.column_stack((across, tangential_direction(0.0), d.leg_surface.axis, np.zeros(3)))
    rod = manifold3d.Manifold.cylinder(length, radius, circular_segments=segments, center=True)
    rod = rod.rotate((0, 0, 180 / segments))
    leg = d.leg_surface
    if isinstance(leg, OvalLegSurface):
        # The bore is as deep below the surface as in a round tube.
        semi = np.array((leg.section.long, leg.section.short)) - (d.leg_radius - radius)
        rod = rod.scale((*semi / radius, 1.0)).rotate((0, 0, np.rad2deg(leg.section.widest)))
    return rod.transform(T)


def _prism_sides(radius: float, error: float) -> int:
    """How many sides a prism takes to stay within `error` of its cylinder; a multiple of 4."""
    return 4 * int(np.ceil(np.pi / np.arccos(1 - error / radius) / 4))


def _brace_and_bead(definition: JointDefinition) -> manifold3d.Manifold:
    """The ring that the section of both sweeps round the brace's axis."""
    outline = _section_outlines(definition, brace_vertex_azimuths(definition))
    n, sides = outline.shape[:2]
    index = np.arange(n * sides).reshape(n, sides)
    a, b = index, np.roll(index, -1, axis=0)
    c, d = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    triangles = np.stack((a, b, c, b, d, c), axis=-1).reshape(-1, 3)
    mesh = manifold3d.Mesh64(outline.reshape(-1, 3), triangles.astype(np.uint64))
    return manifold3d.Manifold(mesh)


def _section_outlines(definition: JointDefinition, phi: Array) -> Array:
    """Corners of the section of brace and bead at azimuths, (n, m, 3), in frame j.

    They run down the bore, along the root and up bead, bevel and outer wall.
    """
    sections = JointGrooveSections(definition, phi)
    top = np.full_like(phi, definition.brace_length)
    wall = definition.brace_wall_radius(phi, top)
    corners = (
        np.column_stack((wall - definition.brace_wall, top)),
        sections.land_inner,
        *_bead_corners(definition, sections),
        *_bevel_corners(definition, sections),
        np.column_stack((wall, top)),
    )
    rho, z = np.stack(corners, axis=-1).swapaxes(0, 1)
    return cylindrical_to_j(phi[:, None], rho, z)


def _bead_corners(definition: JointDefinition, s: JointGrooveSections) -> list[Array]:
    """The root bead from behind the land to below p3; nothing if the root is open."""
    root = definition.imperfections.root
    if root.is_open:
        return []
    # From p4, where the face begins on the leg, up to below p3.
    face = np.array((s.p4, s.p3))
    if root.bead_height != (0.0,):
        share = np.linspace(0, 1, BEAD_FACE_STRIPS + 1)[:, None, None]
        height = interpolate_around_joint(root.bead_height, s.phi)[:, None]
        chord = s.p3 - s.p4
        outward = chord[:, ::-1] * (1, -1) / s.root_width[:, None]
        face = s.p4 + share * chord + 4 * share * (1 - share) * height * outward
    foot_outer, foot_inner = _bead_ends_in_leg(definition, s, face[1])
    if len(face) == 2:
        return [foot_inner, *np.linspace(foot_outer, s.p3, BEAD_STRIPS, endpoint=False)]
    return [foot_inner, foot_outer, *face[1:-1]]


def _bevel_corners(definition: JointDefinition, s: JointGrooveSections) -> Array:
    """Points up the bevel from p3 to p2, (k, n, 2)."""
    cut = definition.imperfections.bevel
    share = np.linspace(0, 1, BEVEL_STRIPS + 1)[:, None, None]
    if cut.facet_angle == 0:
        return np.linspace(s.p3, s.p2, BEVEL_STRIPS + 1)
    at, along = cut.facet_at, s.p2 - s.p3
    share = np.concatenate((at * share, at + (1 - at) * share[1:]))
    # Where the facets meet, so far off the line from p3 to p2 (for small angles).
    height = np.tan(cut.facet_angle) * at * (1 - at)
    outward = along[:, ::-1] * (1, -1)
    knee = np.minimum(share / at, (1 - share) / (1 - at))
    return np.asarray(s.p3 + share * along + height * knee * outward)


def _bead_ends_in_leg(
    d: JointDefinition, s: JointGrooveSections, above: Array
) -> tuple[Array, Array]:
    """Where the bead's face, from a point above p4, and its back end inside the leg, each (n, 2).

    Both cross the leg's surface at a good angle, so the union's edge there is sharp and lies on
    p4 however finely the leg is cut into faces.
    """
    sunk = d.leg_surface.offset_surface(-min(BEAD_SINK_DEPTH, d.leg_wall / 2, 0.02 * d.leg_radius))
    outer = sunk.ray_intersections(s.phi, above, s.p4 - above)
    gapped = d.leg_surface.offset_surface(d.root_opening_at(s.phi))
    back = -leg_normal_rz(gapped, s.phi, s.land_inner[:, 0])
    return outer, sunk.ray_intersections(s.phi, s.land_inner, back)
