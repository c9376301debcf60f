"""The prepared groove, one radial half-plane per azimuth, and its sharp edges as polylines.

The land is at the root opening from the leg, over the root face's share of the wall. From its
outer edge the bevel rises as a straight line to the brace's outer wall. The root bead closes
the groove with a face from the bevel to the leg; an open root has none.
"""

from __future__ import annotations

from dataclasses import field
from typing import Final

import numpy as np
import scipy  # its parts are loaded at first use
from numpy.typing import ArrayLike, NDArray

from tjscan.core.frames import Array, Mask, array_dataclass, readonly_copy, unit_vectors
from tjscan.joint.definition import JointDefinition
from tjscan.joint.geometry import (
    LegSurface,
    cylindrical_to_j,
    radial_direction,
    tangential_direction,
)

WALL_CORRECTION_ROUNDS: Final = 12
"""Corrections of where a tilted wall is met; each is smaller by a fifth or less."""


class JointGrooveSections:
    """Sections of a joint's designed groove in radial half-planes, one for each azimuth.

    Parameters
    ----------
    definition : JointDefinition
        The joint.
    phi : array_like, shape (n,)
        Azimuths in radians.

    Attributes
    ----------
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
        on the leg. If the root is open p3 is the land's outer edge and p4 its foot on the leg.
    """

    def __init__(self, definition: JointDefinition, phi: ArrayLike) -> None:
        self.phi = phi = readonly_copy(phi)
        leg = definition.leg_surface
        gapped = leg.offset_surface(definition.root_opening_at(phi))
        self.dihedral = leg.dihedral_angle(phi, definition.brace_radius)
        self.groove_angle = definition.groove_angle_for_dihedral(self.dihedral)

        rho_inner = _bore_radius(definition, gapped, phi)
        self.land_inner = _points_rz(gapped, phi, rho_inner)
        self.land = land = _points_rz(gapped, phi, rho_inner + definition.root_face)
        self.bevel = bevel = bevel_direction(gapped, phi, land[:, 0], self.groove_angle)
        self.p2 = _bevel_ends(definition, phi, land, bevel)
        self.apex = leg.ray_intersections(phi, land, -bevel)
        if definition.imperfections.root.is_open:
            self.p3, to_leg = land, -leg_normal_rz(gapped, phi, land[:, 0])
        else:
            self.p3 = land + definition.root_bead * bevel
            # The bead's face is the base of an isosceles triangle between the bevel and the leg's
            # tangent at the apex, so it is about square to the bisector of the groove.
            to_leg = _leg_direction_rz(leg, phi, self.apex[:, 0]) - bevel
        self.p4 = leg.ray_intersections(phi, self.p3, to_leg)
        for array in vars(self).values():
            array.flags.writeable = False

    @property
    def root_width(self) -> Array:
        """Width of the root bead's face, or of an open root, in metres, shape (n,)."""
        return np.asarray(np.linalg.norm(self.p4 - self.p3, axis=1))

    @property
    def bevel_length(self) -> Array:
        """Length of the bevel from the land to the outer wall in metres, shape (n,)."""
        return np.asarray(np.linalg.norm(self.p2 - self.land, axis=1))


def bevel_direction(gapped: LegSurface, phi: Array, rho: Array, groove_angle: Array) -> Array:
    """Directions up the bevel in the radial half-planes, unit length, shape (n, 2).

    The line along the land's outer edge is both in the bevel and in the surface at the root
    gap over the leg. Turning that surface's tangent plane about the line by the groove angle
    gives the bevel's tangent plane; where it cuts the half-plane is the direction sought.

    Parameters
    ----------
    gapped : LegSurface
        The surface at the root opening over the leg.
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
    return unit_vectors(np.column_stack((rho_part, in_half_plane[:, 2])))


def leg_normal_rz(leg: LegSurface, phi: Array, rho: Array) -> Array:
    """Unit vectors out of the leg in the radial half-planes, square to its line there, (n, 2)."""
    return _leg_direction_rz(leg, phi, rho)[:, ::-1] * (-1.0, 1.0)


def _bore_radius(definition: JointDefinition, gapped: LegSurface, phi: Array) -> Array:
    """Distance from the brace's axis at which its bore meets the surface at the root opening."""
    rho = np.full_like(phi, definition.brace_inner_radius)
    if definition.imperfections.is_brace_nominal:
        return rho
    for _ in range(WALL_CORRECTION_ROUNDS):
        rho = definition.brace_wall_radius(phi, gapped.height(phi, rho)) - definition.brace_wall
    return rho


def _bevel_ends(definition: JointDefinition, phi: Array, land: Array, bevel: Array) -> Array:
    """Where the bevel meets the brace's outer wall, (n, 2)."""
    top = land
    for _ in range(1 if definition.imperfections.is_brace_nominal else WALL_CORRECTION_ROUNDS):
        wall = definition.brace_wall_radius(phi, top[:, 1])
        top = land + ((wall - land[:, 0]) / bevel[:, 0])[:, None] * bevel
    return top


def _points_rz(leg: LegSurface, phi: Array, rho: Array) -> Array:
    return np.column_stack((rho, leg.height(phi, rho)))


def _leg_direction_rz(leg: LegSurface, phi: Array, rho: Array) -> Array:
    """Unit vectors along the leg in the radial half-planes, away from the brace, (n, 2)."""
    return unit_vectors(np.column_stack((np.ones_like(phi), leg.slope(phi, rho))))


FIRST_SEARCH_VERTICES = 4
"""Vertices that a first search looks at; it looks at more where these can't prove the result."""


class ClosedPolyline:
    """A closed line through points.

    Parameters
    ----------
    points_j : ndarray, shape (n, 3)
        Its vertices in frame j, in metres; the last one is joined to the first.
    """

    def __init__(self, points_j: Array) -> None:
        self.points_j = readonly_copy(points_j)
        steps = np.roll(self.points_j, -1, axis=0) - self.points_j
        self._tree = scipy.spatial.KDTree(self.points_j)
        self._half = float(np.linalg.norm(steps, axis=1).max()) / 2

    def nearest_points(self, points_j: Array) -> Array:
        """Nearest points of the line to points, shape (m, 3), in frame j, in metres."""
        points = np.asarray(points_j, dtype=float).reshape(-1, 3)
        feet = np.empty_like(points)
        open_ = np.arange(len(points))
        neighbours = FIRST_SEARCH_VERTICES
        while open_.size:
            neighbours = min(neighbours, len(self.points_j))
            reach, vertices = self._tree.query(points[open_], k=np.arange(1, neighbours + 1))
            reach, vertices = np.asarray(reach), np.asarray(vertices)
            feet[open_], distance = self._on_segments_at(vertices, points[open_])
            # A closer foot on a segment away from these vertices would lie within half its
            # length of a vertex that is closer than the farthest of them.
            proven = reach[:, -1] ** 2 > distance**2 + self._half**2
            open_ = open_[~proven] if neighbours < len(self.points_j) else open_[:0]
            neighbours *= 8
        return feet

    def distances(self, points_j: Array) -> Array:
        """Distances of points, shape (m, 3), from the line in metres, shape (m,)."""
        points = np.asarray(points_j, dtype=float).reshape(-1, 3)
        return np.asarray(np.linalg.norm(points - self.nearest_points(points), axis=1))

    def _on_segments_at(self, vertices: NDArray[np.intp], points: Array) -> tuple[Array, Array]:
        """Nearest feet, and their distances, on the segments before and after vertices (m, k)."""
        starts = np.concatenate((vertices - 1, vertices), axis=1)
        a = self.points_j[starts]
        along = self.points_j[(starts + 1) % len(self.points_j)] - a
        offset = points[:, None] - a
        share = np.sum(offset * along, axis=2) / np.sum(along * along, axis=2)
        feet = a + np.clip(share, 0, 1)[..., None] * along
        distances = np.linalg.norm(points[:, None] - feet, axis=2)
        best = np.argmin(distances, axis=1)
        rows = np.arange(len(points))
        return feet[rows, best], distances[rows, best]


@array_dataclass
class FeatureEdges:
    """The groove's three feature edges, along which the corners p2, p3 and p4 run (Fig. 3).

    Parameters
    ----------
    phi : ndarray, shape (n,)
        Azimuth of the vertices in radians, the same for the three.
    p2, p3, p4 : ClosedPolyline
        Top of the bevel, root corner on the bevel, root corner on the leg.
    tacks : ndarray, shape (k, 2)
        First and last azimuth of each tack weld, under which p3 and p4 are buried, in radians.
    """

    phi: Array
    p2: ClosedPolyline
    p3: ClosedPolyline
    p4: ClosedPolyline
    tacks: Array = field(default_factory=lambda: np.empty((0, 2)))

    def on_tack(self, points_j: Array) -> Mask:
        """Whether points, shape (m, 3), lie at azimuths where a tack covers the root, (m,)."""
        return is_within_spans(self.tacks, np.arctan2(points_j[:, 1], points_j[:, 0]))

    def distances(self, points_j: Array) -> Array:
        """Distances of points, shape (m, 3), from p2, p3 and p4 in metres, shape (m, 3)."""
        edges = (self.p2, self.p3, self.p4)
        return np.column_stack([edge.distances(points_j) for edge in edges])


def feature_edges(definition: JointDefinition, n: int = 3600) -> FeatureEdges:
    """Compute the feature edges of a joint's groove, each with `n` vertices at even azimuths.

    At the default their chords leave the true edge by less than 0.001 mm.
    """
    phi = np.linspace(0, 2 * np.pi, n, endpoint=False)
    sections = JointGrooveSections(definition, phi)
    corners = (sections.p2, sections.p3, sections.p4)
    p2, p3, p4 = (ClosedPolyline(cylindrical_to_j(phi, rz[:, 0], rz[:, 1])) for rz in corners)
    return FeatureEdges(phi, p2, p3, p4, tack_spans(definition))


def tack_spans(definition: JointDefinition) -> Array:
    """First and last azimuth of each tack in radians, shape (k, 2)."""
    spans = np.empty((len(definition.imperfections.tacks), 2))
    for i, tack in enumerate(definition.imperfections.tacks):
        at = np.array([tack.at])
        land = JointGrooveSections(definition, at).land
        speed = float(np.linalg.norm(definition.leg_surface.azimuth_derivative(at, land[:, 0])))
        spans[i] = tack.at + 0.5 * tack.length / speed * np.array((-1, 1))
    return spans


def is_within_spans(spans: Array, phi: ArrayLike) -> Mask:
    """Whether azimuths are in one of the spans that `tack_spans` gives, the shape of `phi`.

    Parameters
    ----------
    spans : ndarray, shape (k, 2)
        Radians.
    phi : array_like
        Radians; a turn more or less makes no difference.
    """
    phi = np.asarray(phi, dtype=float)
    covered = np.zeros(phi.shape, dtype=bool)
    for first, last in spans:
        covered |= np.mod(phi - first, 2 * np.pi) <= last - first
    return covered
