"""The four lines that meet at the top edges of a V butt joint, fitted among arc light.

A straight line is straight, too, as one over z against the slope of the ray, x over z: there each
point errs along its own column only. Points are of the steel or of a uniform background, before
or behind it; which, is estimated along with the lines (expectation maximisation).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, hypot, radians, sin, sqrt, tau
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array

PLATE_LINES, BEVEL_LINES = [0, 3], [1, 2]
"""Places of the lines of the left and of the right plate, and of the left and the right bevel."""

EDGE_LINE_PAIRS: Final = tuple(zip(PLATE_LINES, BEVEL_LINES, strict=True))
"""The two lines that meet at the left and at the right top edge."""

CAPTURE_SIGMAS: Final = (0.35e-3, 0.15e-3)
"""Standard deviations of the first rounds, in metres: a line this far off is still found."""

MOST_FIT_ROUNDS: Final = 12
"""Most rounds after those."""

SETTLED_SIGMAS: Final = 0.02
"""Edges that move less from one round to the next are final, in standard deviations of a point."""

DEPTH_OF_FIELD: Final = 0.08
"""Range of z over which points of the background lie, in metres."""

LEAST_FILL_RANGE: Final = 1e-3
"""Least range of z over which the steel may be where a bevel has ended, in metres."""

BEVEL_ANGLE_SIGMA: Final = radians(1.0)
"""By how much a bevel's angle differs from what it was before, one standard deviation."""

BELOW_PLATE_SIGMAS: Final = 3.0
"""Standard deviations below the plate from which a point shows a bevel."""

SAME_FOOT_POINTS, SAME_FOOT_LOG_ODDS = 2.5, 8.0
"""Points within which a bevel ends where it did before, and the logarithm of the odds that it does:
only at tacks and where a pass ended it does not."""

LEAST_BACKGROUND, MOST_BACKGROUND = 0.01, 0.8
"""Bounds of the share of points that are of the background."""


@dataclass(frozen=True, slots=True, eq=False)
class EdgeLines:
    """Plates and bevels at the top edges of a V butt joint, as seen in one profile.

    Parameters
    ----------
    lines : ndarray, shape (4, 2)
        a and b of ``1 / z = a + b t``, t being x over z: left plate, left bevel, right bevel,
        right plate.
    covariances : ndarray, shape (4, 2, 2)
        Of a and b, for noise that is independent from column to column.
    edges : ndarray, shape (2,)
        t of the left and of the right top edge.
    feet : ndarray, shape (2,)
        t at which the left and the right bevel end, at the root or at the weld.
    counts : ndarray, shape (4,)
        How many points, by their probability, are of each line. A bevel's points next to its
        edge, which the plate drawn on explains as well, do not count.
    shares : ndarray, shape (4,)
        Share of the points between a line's ends that are of it.
    noise : float
        Standard deviation of z, in metres.
    background : float
        Share of points that are of no line.
    """

    lines: Array
    covariances: Array
    edges: Array
    feet: Array
    counts: Array
    shares: Array
    noise: float
    background: float

    @property
    def points(self) -> Array:
        """Places (x, z) of the left and of the right top edge, in metres, shape (2, 2)."""
        left, *_, right = self.lines.tolist()
        t, u = self.edges.tolist()
        z, w = 1 / (left[0] + left[1] * t), 1 / (right[0] + right[1] * u)
        return np.array(((t * z, z), (u * w, w)))

    @property
    def point_covariances(self) -> Array:
        """Covariance of x and z of each top edge, in m², shape (2, 2, 2)."""
        found, points = np.empty((2, 2, 2)), self.points.tolist()
        for k, (plate, bevel) in enumerate(EDGE_LINE_PAIRS):
            t, (x, z) = float(self.edges[k]), points[k]
            slope = float(self.lines[plate, 1] - self.lines[bevel, 1])
            terms = np.array((1.0, t))
            moves = terms / slope  # of t by the bevel's a and b; by the plate's, minus these
            total = np.zeros((2, 2))
            for line, dt in ((plate, -moves), (bevel, moves)):
                dq = self.lines[plate, 1] * dt + (terms if line == plate else 0.0)
                jacobian = np.array((z * dt - x * z * dq, -z * z * dq))
                total += jacobian @ self.covariances[line] @ jacobian.T
            found[k] = total
        return found

    @property
    def angles(self) -> Array:
        """Angle of each line against x, positive where z grows with x, radians, shape (4,)."""
        return np.arctan2(-self.lines[:, 1], self.lines[:, 0])

    @property
    def root(self) -> float:
        """Slope t of the ray to where the two bevels, drawn on, meet."""
        (a, b), (c, d) = self.lines[BEVEL_LINES].tolist()
        return float((c - a) / (b - d))

    def moved(self, turn: float, before: Array, after: Array) -> EdgeLines:
        """Lines of a joint that has moved.

        Parameters
        ----------
        turn : float
            Against the clock where x runs right and z down, in radians.
        before, after : ndarray, shape (2,)
            x and z of the same point of the joint, in metres.
        """
        c, s = cos(turn), sin(turn)
        R = np.array([[c, s], [-s, c]])
        normals = self.lines[:, ::-1] @ R.T
        distances = 1 - self.lines[:, ::-1] @ before + normals @ after
        ends = np.empty((2, 2))
        for k, bevel in enumerate(BEVEL_LINES):
            z = float(self.heights(bevel, self.feet[k]))
            ends[k] = R @ (np.array((z * self.feet[k], z)) - before) + after
        edges = (self.points - before) @ R.T + after
        return replace(
            self,
            lines=normals[:, ::-1] / distances[:, None],
            edges=edges[:, 0] / edges[:, 1],
            feet=ends[:, 0] / ends[:, 1],
        )

    def heights(self, line: int, t: Array) -> Array:
        """Heights z of a line at slopes of rays, in metres."""
        a, b = self.lines[line].tolist()
        return np.asarray(1 / (a + b * t))


def line_through(first: Array, second: Array) -> Array:
    """Coefficients a and b of the line through two points (x, z), shape (2,)."""
    (x, z), (u, w) = np.asarray(first).tolist(), np.asarray(second).tolist()
    c = (w - z) * x - (u - x) * z
    return np.array(((x - u) / c, (w - z) / c))


def fit_joint_lines(
    t: Array, z: Array, start: EdgeLines, bevel_angles: Array | None = None
) -> EdgeLines | None:
    """Fit the four lines to a profile from where they were before.

    Parameters
    ----------
    t, z : ndarray, shape (n,)
        x over z, rising, and z in metres.
    start : EdgeLines
        The last fit; its noise is taken as known.
    bevel_angles : ndarray, shape (2,), optional
        The bevels' angles against x as they are expected, in radians.

    Returns
    -------
    EdgeLines or None
        None if a line has lost its points, or two no longer meet between the others.
    """
    # One over z errs by z² less than z does.
    certain = z**4 / start.noise**2
    rows = certain, certain * t, certain * t * t, certain / z, certain * t / z, np.ones_like(t)
    moments = np.stack(rows)
    prior = _bevel_angle_prior(start, bevel_angles)
    found = start
    for k in range(len(CAPTURE_SIGMAS) + MOST_FIT_ROUNDS):
        sigma = max(CAPTURE_SIGMAS[k], start.noise) if k < len(CAPTURE_SIGMAS) else start.noise
        after = _fit_lines_once(t, z, moments, found, sigma, prior)
        if after is None:
            return None
        moved = float(np.abs(after.edges - found.edges).max()) * float(z[len(z) // 2])
        if k < len(CAPTURE_SIGMAS):
            found = after
            continue
        feet = _bevel_feet(t, z, after, start.feet)
        ended = (feet == found.feet).all()
        found = replace(after, feet=feet)
        if ended and moved < SETTLED_SIGMAS * start.noise:
            break
    return found


def _fit_lines_once(
    t: Array, z: Array, moments: Array, before: EdgeLines, sigma: float, prior: Array
) -> EdgeLines | None:
    """Which points are of the steel, the lines through them, and where they meet.

    Spans are the first point of each line, and the one after its last.
    """
    left, right = np.searchsorted(t, before.edges).tolist()
    foot, other_foot = np.searchsorted(t, before.feet).tolist()
    spans = np.array(((0, left), (left, foot), (other_foot, right), (right, len(t))))
    weight = _probabilities_on_lines(t, z, before, spans, sigma)
    total = np.zeros((6, len(t) + 1))
    np.cumsum(moments * weight, axis=1, out=total[:, 1:])
    sums = (total[:, spans[:, 1]] - total[:, spans[:, 0]]).T
    normal = sums[:, (0, 1, 1, 2)].reshape(4, 2, 2)
    normal += prior
    on = sums[:, 5]
    if on.min() < (1 if prior.any() else 2):
        return None
    covariances = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    lines = (covariances @ sums[:, 3:5, None])[:, :, 0]
    between = lines[BEVEL_LINES] - lines[PLATE_LINES]
    edges = between[:, 0] / -between[:, 1]
    sizes = np.maximum(spans[:, 1] - spans[:, 0], 1)
    background = 1 - float(on.sum()) / float(sizes.sum())
    counts = on.copy()
    for plate, bevel in EDGE_LINE_PAIRS:
        own = slice(*spans[bevel].tolist())
        below = z[own] - 1 / (lines[plate, 0] + lines[plate, 1] * t[own])
        counts[bevel] = weight[own] @ (below > BELOW_PLATE_SIGMAS * before.noise)
    found = replace(
        before,
        lines=lines,
        covariances=covariances,
        edges=edges,
        counts=counts,
        shares=on / sizes,
        background=min(max(background, LEAST_BACKGROUND), MOST_BACKGROUND),
    )
    return found if t[0] < edges[0] < found.root < edges[1] < t[-1] else None


def _probabilities_on_lines(
    t: Array, z: Array, lines: EdgeLines, spans: NDArray[np.intp], sigma: float
) -> Array:
    """Probability that each point is of its line, shape (n,); zero between the bevels' ends."""
    found = np.zeros(len(t))
    odds = lines.background / (1 - lines.background) * sqrt(tau) * sigma / DEPTH_OF_FIELD
    for line, (i, j) in enumerate(spans.tolist()):
        scaled = (z[i:j] - lines.heights(line, t[i:j])) / sigma
        bell = np.exp(-0.5 * np.minimum(scaled * scaled, 100.0))
        found[i:j] = bell / (bell + odds)
    return found


def _bevel_angle_prior(start: EdgeLines, bevel_angles: Array | None) -> Array:
    """What is known of the bevels' angles, as normal matrices of the lines, shape (4, 2, 2)."""
    found = np.zeros((4, 2, 2))
    if bevel_angles is not None:
        for line, angle in zip(BEVEL_LINES, bevel_angles.tolist(), strict=True):
            # (a, b) is (cos, -sin) of the line's angle over its distance from the sensor.
            across = np.array((sin(angle), cos(angle)))
            length = hypot(*start.lines[line].tolist())
            found[line] = np.outer(across, across) / (BEVEL_ANGLE_SIGMA * length) ** 2
    return found


def _bevel_feet(t: Array, z: Array, found: EdgeLines, last: Array) -> Array:
    """Where the bevels most likely end: beyond it the steel may be anywhere in the groove."""
    left, root, right = np.searchsorted(t, (found.edges[0], found.root, found.edges[1])).tolist()
    share, sigma = found.background, found.noise
    arc = share / DEPTH_OF_FIELD
    hull = float(found.points[:, 1].min())
    pitch = float(t[-1] - t[0]) / len(t)
    feet = []
    sides = zip(BEVEL_LINES, (slice(left, root), slice(root, right)), (1, -1), last, strict=True)
    for line, own, inward, old in sides:
        u = t[own][::inward]
        if not len(u):
            feet.append(found.root)
            continue
        height, seen = found.heights(line, u), z[own][::inward]
        on = np.exp(-0.5 * np.minimum(((seen - height) / sigma) ** 2, 100.0))
        on *= (1 - share) / (sqrt(tau) * sigma)
        # Beyond a bevel's end the steel is nearer than its continuation, or behind a gap.
        room = np.maximum(height - hull, LEAST_FILL_RANGE)
        off = np.where(np.abs(seen - height) < room, (1 - share) / room, 0.0)
        evidence = np.cumsum(np.log((on + arc) / (off + arc)))
        evidence[np.abs(u - old) < SAME_FOOT_POINTS * pitch] += SAME_FOOT_LOG_ODDS
        k = int(evidence.argmax())
        after = pitch if k + 1 == len(u) else min(abs(float(u[k + 1] - u[k])), pitch)
        foot = float(u[k]) + inward * after / 2
        feet.append(min(foot, found.root) if inward > 0 else max(foot, found.root))
    return np.array(feet)
