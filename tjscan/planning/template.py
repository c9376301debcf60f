"""Layers and beads in one section: a template on the unit square, mapped onto the groove.

The square's corners are p3, p4, g and p2; u runs from the bevel to the leg and w from the root to
the opening, so P(u, w) = p3 + u E + w F + u w H. Lines of constant w are layers, fanned between
bevel and leg; lines of constant u part a layer into beads. Both stay straight, and the map's
Jacobian is linear, J(u, w) = a + b u + c w: areas are known in closed form, and so are the lines
that part the groove into given areas.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array, readonly_copy

BISECTION_STEPS: Final = 60
"""For a line of the last layer: more steps change no bit of it."""


def planar_cross(a: Array, b: Array) -> Array:
    """Cross product of vectors of a plane, shape (..., 2): twice the triangle's area."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


class SectionTemplate:
    """The map of the unit square onto m sections, with a reinforcement above the opening.

    Parameters
    ----------
    corners : ndarray, shape (m, 4, 2)
        p3, p4, g and p2, counterclockwise, metres.
    cap_height : float
        Of the parabola above the line from p2 to g, in its middle, metres.
    root_area : ndarray, shape (m,)
        Below the line from p3 to p4, of what the first layer fills in an open root, m².

    Attributes
    ----------
    jacobian : tuple of ndarray, shape (m,)
        a, b and c of J = a + b u + c w, m².
    opening : ndarray, shape (m,)
        Distance of p2 and g, metres.
    """

    def __init__(self, corners: Array, cap_height: float, root_area: Array | float = 0.0) -> None:
        self.corners, self.cap_height = readonly_copy(corners), cap_height
        p3, p4, g, p2 = np.moveaxis(self.corners, 1, 0)
        self._edges = E, F, H = p4 - p3, p2 - p3, g - p4 - p2 + p3
        self.jacobian = planar_cross(E, F), planar_cross(E, H), planar_cross(H, F)
        self.opening: Array = np.linalg.norm(g - p2, axis=1)
        self.root_area: Array = np.broadcast_to(root_area, len(self.corners))

    @property
    def sections_are_convex(self) -> Array:
        """Whether each section's corners make a convex quadrilateral in their order, shape (m,)."""
        a, b, c = self.jacobian
        return np.asarray(np.minimum.reduce([a, a + b, a + c, a + b + c]) > 0)

    @property
    def groove_area(self) -> Array:
        """Area of p2, p3, p4 and g, shape (m,), m²."""
        a, b, c = self.jacobian
        return a + 0.5 * (b + c)

    @property
    def cap_area(self) -> Array:
        """Area of the reinforcement, two thirds of width times height, shape (m,), m²."""
        return 2 / 3 * self.cap_height * self.opening

    @property
    def area(self) -> Array:
        """Area of the groove with what is above and below it, shape (m,), m²."""
        return self.groove_area + self.cap_area + self.root_area

    def part(self, first: int, last: int) -> SectionTemplate:
        """The same of the sections from one to another, both included."""
        chosen = slice(first, last + 1)
        return SectionTemplate(self.corners[chosen], self.cap_height, self.root_area[chosen])

    def points(self, u: Array, w: Array) -> Array:
        """Points, shape (m, ..., 2), of u and w of shape (m, ...)."""
        extra = (slice(None), *(None,) * (np.ndim(u) - 1))
        E, F, H = (edge[extra] for edge in self._edges)
        u, w = np.asarray(u)[..., None], np.asarray(w)[..., None]
        return np.asarray(self.corners[:, 0][extra] + u * E + w * F + u * w * H)

    def cut_into_beads(self, counts: tuple[int, ...], areas: Array) -> BeadCells:
        """Move the lines so that beads have given areas.

        Parameters
        ----------
        counts : tuple of int
            Beads of each layer, from the root on.
        areas : ndarray, shape (m, n)
            Of each bead, layer by layer, from the bevel to the leg; they sum up to `area`.

        Raises
        ------
        ValueError
            If they do not, or the last layer would be all reinforcement.
        """
        if not np.allclose(areas.sum(axis=1), self.area, rtol=1e-9):
            raise ValueError("the areas of the beads do not sum up to the area of the groove")
        ends, m = np.cumsum(counts), len(areas)
        w = self.layer_lines(areas.cumsum(axis=1)[:, ends[:-1] - 1])
        cells = []
        for k, (end, count) in enumerate(zip(ends, counts, strict=True)):
            inside = areas[:, end - count : end - 1].cumsum(axis=1)
            last = k == len(counts) - 1
            inner = self._lines_between_beads(w[:, k], w[:, k + 1], inside, capped=last)
            cells.append(np.concatenate((np.zeros((m, 1)), inner, np.ones((m, 1))), axis=1))
        return BeadCells(self, counts, w, tuple(cells))

    def layer_lines(self, below: Array) -> Array:
        """Lines between layers that leave given areas towards the root.

        Parameters
        ----------
        below : ndarray, shape (m, L - 1)
            Areas of the beads below each inner line, m².

        Returns
        -------
        ndarray, shape (m, L + 1)
            w of each line, root and opening included.

        Raises
        ------
        ValueError
            If the first or the last layer would be outside the groove.
        """
        below = below - self.root_area[:, None]
        if np.any(below >= self.groove_area[:, None]):
            raise ValueError("the last layer would be all reinforcement")
        if np.any(below <= 0):
            raise ValueError("the first layer would fill no more than what is below the groove")
        a, b, c = (x[:, None] for x in self.jacobian)
        B = a + 0.5 * b
        lines = 2 * below / (B + np.sqrt(B**2 + 2 * c * below))  # of B w + c w²/2 = area below
        ends = np.ones((len(below), 1))
        return np.concatenate((0 * ends, lines, ends), axis=1)

    def layer_heights(self, w: Array) -> Array:
        """Height of each layer between the middles of its lines, shape (m, L), metres."""
        middles = self.points(np.full_like(w, 0.5), w)
        return np.asarray(np.linalg.norm(np.diff(middles, axis=1), axis=2))

    def layer_area_from_bevel(self, w0: Array, w1: Array, u: Array, *, capped: bool) -> Array:
        """Area of a layer from the bevel up to u, shape (m, k), m²; with its reinforcement."""
        a, b, c = (x[:, None] for x in self.jacobian)
        middle, height = 0.5 * (w0 + w1)[:, None], (w1 - w0)[:, None]
        area = height * ((a + c * middle) * u + 0.5 * b * u**2)
        if capped:
            area = area + 2 * self.cap_height * self.opening[:, None] * (u**2 - 2 / 3 * u**3)
        return np.asarray(area)

    def _lines_between_beads(self, w0: Array, w1: Array, inside: Array, *, capped: bool) -> Array:
        """U of the lines that leave given areas towards the bevel."""
        if capped and self.cap_height > 0:
            # A cubic that grows: halving finds its one root between 0 and 1.
            low, high = np.zeros_like(inside), np.ones_like(inside)
            for _ in range(BISECTION_STEPS):
                u = 0.5 * (low + high)
                short = self.layer_area_from_bevel(w0, w1, u, capped=True) < inside
                low, high = np.where(short, u, low), np.where(short, high, u)
            return np.asarray(0.5 * (low + high))
        a, b, c = (x[:, None] for x in self.jacobian)
        B = a + 0.5 * c * (w0 + w1)[:, None]
        share = inside / (w1 - w0)[:, None]
        return np.asarray(2 * share / (B + np.sqrt(B**2 + 2 * b * share)))


@dataclass(frozen=True, slots=True, eq=False)
class BeadCells:
    """Layers and beads of m sections.

    Parameters
    ----------
    template : SectionTemplate
        The sections.
    counts : tuple of int
        Beads of each of L layers.
    w : ndarray, shape (m, L + 1)
        Lines between layers, root and opening included.
    u : tuple of ndarray, shape (m, count + 1)
        Lines between the beads of each layer, bevel and leg included.
    """

    template: SectionTemplate
    counts: tuple[int, ...]
    w: Array
    u: tuple[Array, ...]

    @property
    def areas(self) -> Array:
        """Area of each bead between its lines, shape (m, n), m²."""
        last = len(self.counts) - 1
        parts = []
        for k, u in enumerate(self.u):
            w, capped = self._layer_borders(k), k == last
            parts.append(np.diff(self.template.layer_area_from_bevel(*w, u, capped=capped), axis=1))
        found = np.concatenate(parts, axis=1)
        found[:, 0] += self.template.root_area  # the first layer is one bead then
        return found

    def quadrilaterals(self, k: int) -> Array:
        """Corners of layer k's beads without reinforcement, shape (m, count, 4, 2), metres.

        Bevel side below, leg side below, leg side above, bevel side above.
        """
        u, (w0, w1) = self.u[k], self._layer_borders(k)
        at = [(u[:, :-1], w0), (u[:, 1:], w0), (u[:, 1:], w1), (u[:, :-1], w1)]
        return np.stack(
            [self.template.points(x, np.broadcast_to(w[:, None], x.shape)) for x, w in at], axis=2
        )

    def outlines(self, i: int, points: int = 20) -> list[Array]:
        """Outline of every bead of section i, each (q, 2), metres; the cap's tops are curved."""
        found = [quad for k in range(len(self.counts)) for quad in self.quadrilaterals(k)[i]]
        height = self.template.cap_height
        if height > 0:
            g, p2 = self.template.corners[i, 2], self.template.corners[i, 3]
            along = g - p2
            up = np.array((-along[1], along[0])) / np.linalg.norm(along)
            for j in range(self.counts[-1]):
                u = np.linspace(self.u[-1][i, j + 1], self.u[-1][i, j], points)[:, None]
                top = p2 + u * along + height * 4 * u * (1 - u) * up
                # If the reinforcement is nothing, at bevel and leg, its end is the corner.
                top = top[int(j == self.counts[-1] - 1) : len(top) - int(j == 0)]
                quad = found[j - self.counts[-1]]
                found[j - self.counts[-1]] = np.concatenate((quad[:3], top, quad[3:]))
        return found

    def _layer_borders(self, k: int) -> tuple[Array, Array]:
        return self.w[:, k], self.w[:, k + 1]
