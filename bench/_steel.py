"""Grooves as yards leave them, and what a line laser makes of them: one function per fault.

A `Groove` is drawn in the plane of the laser from the cuts of two tubes; faults of the steel
change its lines, faults of the sensor change the points. Corners that a fault takes away are
marked as such. Numbers are spans that such joints and sensors show.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np
from _sections import (
    COLUMNS,
    EMITTER_Z,
    Array,
    CylinderCut,
    Pose,
    Seen,
    Tubes,
    groove_angle,
    hidden_corners,
    look_at,
    pose_before,
)
from numpy.typing import NDArray

MM: Final = 1e-3
REACH: Final = 75 * MM
"""How far wall and leg run on beyond the groove."""

CHORD: Final = 0.5 * MM

TUBES: Final = (
    Tubes(0.2032, 0.1619, 0.016, math.radians(90)),
    Tubes(0.305, 0.2285, 0.0254, math.radians(90)),
    Tubes(0.305, 0.219, 0.0222, math.radians(60)),
    Tubes(0.510, 0.355, 0.030, math.radians(75)),
)
"""Four joints of different size and angle."""


@dataclass
class Groove:
    """One section, as lines in the laser plane.

    Parameters
    ----------
    wall, bevel, root, leg : ndarray, shape (m, 2)
        Polylines from the far end of the wall to the far end of the leg. An open root has the
        root face and the bore for a root, and a leg that goes on under it.
    corners : ndarray, shape (3, 2)
        Top of the bevel, and the root's corners on bevel and leg.
    there : ndarray of bool, shape (3,)
        Which of them are there to be seen. For one that is not, `corners` holds the point that a
        reader may still give.
    affected : ndarray of bool, shape (3,)
        Which of them lie wholly under interreflection, or under reflections (`hidden_corners`).
    extra : list of ndarray
        Other lines: spatter, weld caps.
    """

    pose: Pose
    wall_cut: CylinderCut
    leg_cut: CylinderCut
    wall: Array
    bevel: Array
    root: Array
    leg: Array
    corners: Array
    there: NDArray[np.bool_] = field(default_factory=lambda: np.ones(3, dtype=bool))
    affected: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(3, dtype=bool))
    extra: list[Array] = field(default_factory=list)

    @property
    def lines(self) -> list[Array]:
        """All that light can fall on."""
        return [self.wall, self.bevel, self.root, self.leg, *self.extra]

    @property
    def root_width(self) -> float:
        return float(np.linalg.norm(self.corners[2] - self.corners[1]))


Steel = Callable[[Groove, np.random.Generator], None]
"""Changes a groove in place."""

Sensing = Callable[[Groove, Seen, Array, np.random.Generator], Array]
"""Gives the points, shape (n, 2), that a sensor reports instead of those handed in."""


def straight(start: Array, end: Array, count: int = 2) -> Array:
    return np.asarray(np.linspace(start, end, count))


def bowed(start: Array, end: Array, height: float, towards: Array, power: float = 1.0) -> Array:
    """A parabola over a chord (`power` 1), or one with blunter ends."""
    s = np.linspace(0, 1, 41)[:, None]
    normal = square_to(end - start, towards)
    return np.asarray(start + s * (end - start) + height * (4 * s * (1 - s)) ** power * normal)


def square_to(along: Array, towards: Array) -> Array:
    """Unit normal of a direction, on a given side."""
    n = np.array((-along[1], along[0])) / np.linalg.norm(along)
    return np.asarray(n if n @ towards > 0 else -n)


TO_SENSOR: Final = np.array((0.0, -1.0))


def draw(
    rng: np.random.Generator,
    k: int,
    *,
    gap: tuple[float, float] = (2.0, 4.0),
    rise: tuple[float, float] = (1.5, 3.0),
    slop: float = 1.0,
    further: float = 0.0,
    own: np.random.Generator | None = None,
) -> Groove:
    """A sound groove with a straight root bead, from a pose off by up to 5 degrees and 5 mm.

    Parameters
    ----------
    k : int
        Number of the profile: joints and ways round take turns.
    gap, rise : tuple of float
        Span of the root opening, and of the bead's rise on the bevel, in millimetres.
    further : float
        How far along the groove from where `rng` has it, in metres.
    own : Generator, optional
        What the section and its view have for themselves: the pose, and a tenth of opening and
        rise. Without it all is of `rng`.
    """
    tubes, own = TUBES[k % len(TUBES)], own or rng
    pose = pose_before(
        tubes,
        rng.uniform(0, 2 * np.pi) + further / tubes.brace,
        pull=math.radians(10 if k // len(TUBES) % 2 else -10),
        turn=slop * math.radians(5) * own.uniform(-1, 1, 3),
        shift=slop * 5 * MM * own.uniform(-1, 1, 3),
    )
    wander = own.uniform(0.9, 1.1, 2) if own is not rng else np.ones(2)
    wall_cut, leg_cut = cuts(pose)
    up, out = wall_cut.forward, leg_cut.forward
    opening = MM * rng.uniform(*gap) * wander[0]
    face = MM * rng.uniform(1.0, 2.5)
    # The edge of the root face: so far behind the wall, and so far off the leg.
    behind = -square_to(up, out)
    depth = tubes.wall - face
    n_leg = square_to(out, up)
    edge = np.linalg.solve(
        np.array((behind, n_leg)),
        np.array((behind @ wall_cut.start + depth, n_leg @ leg_cut.start + opening)),
    )
    local = leg_cut.going(leg_cut.at(np.array([(edge - leg_cut.start) @ out]))[0], out)
    edge = local.start + opening * local.outward(local.start)
    up_bevel = turned_from(local.forward, up, groove_angle(pose.dihedral))
    top = wall_cut.meet(edge, up_bevel)
    lift = MM * rng.uniform(*rise) * wander[1]
    p3 = edge + lift * up_bevel
    apex = leg_cut.meet(edge + 0.1 * up_bevel, -up_bevel)
    along = (p3 - apex) @ up_bevel * rng.uniform(0.85, 1.15)
    p4 = local.going(apex, out).at(np.array([along]))[0]
    wall_from = wall_cut.going(top, up)
    leg_from = leg_cut.going(p4, out)
    s = np.arange(0, REACH, CHORD)
    return Groove(
        pose,
        wall_from,
        leg_from,
        wall_from.at(s)[::-1],
        straight(top, p3),
        straight(p3, p4),
        leg_from.at(s),
        np.array((top, p3, p4)),
    )


def cuts(pose: Pose) -> tuple[CylinderCut, CylinderCut]:
    """Wall and leg in the laser plane, from where they would meet, upward and outward."""
    angle = pose.tubes.angle
    axis = np.array((math.sin(angle), 0.0, math.cos(angle)))
    brace = CylinderCut.of(pose, np.array((0.0, 0.0, 1.0)), pose.tubes.brace)
    leg = CylinderCut.of(pose, axis, pose.tubes.leg)
    p = np.array((0.0, 0.240))
    for _ in range(30):
        J = np.array((brace.gradient(p), leg.gradient(p)))
        p = p - np.linalg.solve(J, np.array((float(brace.value(p)), float(leg.value(p)))))
    n_wall, n_leg = brace.outward(p), leg.outward(p)
    return brace.going(p, n_leg), leg.going(p, n_wall)


def turned_from(start: Array, towards: Array, angle: float) -> Array:
    """A unit vector at an angle from `start`, on the side of `towards`."""
    return np.asarray(math.cos(angle) * start + math.sin(angle) * square_to(start, towards))


# --- faults of the steel


def bulge(least: float, most: float) -> Steel:
    """A curved root bead; positive is convex. In millimetres."""

    def change(g: Groove, rng: np.random.Generator) -> None:
        h = MM * rng.uniform(least, most)
        g.root = bowed(g.corners[1], g.corners[2], h, TO_SENSOR, rng.choice((0.75, 1.0)))

    return change


def tack(g: Groove, rng: np.random.Generator) -> None:
    """A short, strongly convex weld that fills the root; its toes are no root corners."""
    _fill(g, MM * rng.uniform(5, 8), rng.uniform(0.2, 0.3))
    g.there[1:] = False


def _fill(g: Groove, rise: float, bow: float) -> None:
    """Metal from a point that far up the bevel to one as far out on the leg."""
    p3 = g.corners[1] + rise * _unit(g.corners[0] - g.corners[1])
    p4 = g.leg_cut.at(np.array([rise]))[0]
    g.bevel = straight(g.corners[0], p3)
    g.root = bowed(p3, p4, bow * float(np.linalg.norm(p4 - p3)), TO_SENSOR, 0.75)
    g.leg = g.leg_cut.at(np.arange(rise, REACH, CHORD))
    g.corners = np.array((g.corners[0], p3, p4))


def root_pass(g: Groove, rng: np.random.Generator) -> None:
    """A convex root pass that rises 3 to 6 mm; its toes are the corners now."""
    _fill(g, MM * rng.uniform(3, 6), rng.uniform(0.08, 0.16))


FILL_SHAPES: Final = ("flat", "convex", "concave", "beads", "one-sided")


def partly_filled(share: float, shape: str) -> Steel:
    """Weld up to a share of the bevel; its toes are the corners now."""

    def change(g: Groove, rng: np.random.Generator) -> None:
        top, p3, p4 = g.corners
        rise = share * float(np.linalg.norm(top - p3))
        out = rise * rng.uniform(0.8, 1.2)
        if shape == "one-sided":
            out *= rng.uniform(0.2, 0.5) if rng.random() < 0.5 else rng.uniform(1.5, 1.9)
        leg = g.leg_cut.going(p4, g.leg_cut.forward)
        a, b = p3 + rise * _unit(top - p3), leg.at(np.array([out]))[0]
        width = float(np.linalg.norm(b - a))
        if shape == "beads":
            g.root = _beads(a, b, rng)
        else:
            bow = {"convex": rng.uniform(0.05, 0.15), "concave": -rng.uniform(0.03, 0.08)}
            g.root = bowed(a, b, width * bow.get(shape, 0.0), TO_SENSOR)
        g.bevel, g.leg = straight(top, a), leg.at(np.arange(out, out + REACH, CHORD))
        g.corners = np.array((top, a, b))

    return change


def _beads(a: Array, b: Array, rng: np.random.Generator) -> Array:
    """Two beads or more side by side, 7 to 11 mm wide and 0.5 to 1.2 mm high."""
    count = max(2, round(float(np.linalg.norm(b - a)) / (MM * rng.uniform(7, 11))))
    s = np.linspace(0, 1, 40 * count + 1)
    each = MM * rng.uniform(0.5, 1.2, count + 1)[np.minimum((s * count).astype(int), count)]
    height = each * 4 * (s * count % 1) * (1 - s * count % 1)
    height += MM * rng.uniform(-0.5, 0.5) * 4 * s * (1 - s)
    return np.asarray(a + s[:, None] * (b - a) + height[:, None] * square_to(b - a, TO_SENSOR))


def area_left(g: Groove) -> float:
    """Area between the weld and where the tangents of wall and leg meet, in m².

    What stands out over both counts as less than nothing.
    """
    (top, _, toe), down = g.corners, _unit(g.wall[-1] - g.wall[-3])
    in_ = _unit(g.leg[0] - g.leg[2])
    along = np.linalg.solve(np.column_stack((down, in_)), toe - top)[0]
    x, z = np.vstack((top, g.root, top + along * down)).T
    side = np.sign(down[1] * in_[0] - down[0] * in_[1])
    return 0.5 * float(side * (x @ np.roll(z, -1) - z @ np.roll(x, -1)))


def two_facets(g: Groove, rng: np.random.Generator) -> None:
    """A bevel ground in two facets, 5 to 8 degrees apart."""
    top, p3 = g.corners[:2]
    share, angle = rng.uniform(0.35, 0.65), math.radians(rng.uniform(5, 8))
    length = float(np.linalg.norm(p3 - top))
    height = rng.choice((-1, 1)) * math.tan(angle) * length * share * (1 - share)
    knee = top + share * (p3 - top) + height * square_to(p3 - top, TO_SENSOR)
    g.bevel = np.array((top, knee, p3))


def scallops(g: Groove, rng: np.random.Generator) -> None:
    """A flame-cut bevel: scallops 0.3 mm deep and 4 mm long; the corners move with them."""
    top, p3 = g.corners[:2]
    along, normal = _unit(p3 - top), square_to(p3 - top, TO_SENSOR)
    phase = rng.uniform(0, np.pi)

    def line(s: Array) -> Array:
        height = 0.15 * MM * (2 * np.abs(np.sin(np.pi * s / (4 * MM) + phase)) - 1)
        return np.asarray(top + s[:, None] * along - height[:, None] * normal)

    def first(f: Callable[[Array], Array], at: float) -> float:
        s = at + np.linspace(-1.5 * MM, 1.5 * MM, 3001)
        sign = f(line(s))
        crossings = np.flatnonzero(np.diff(np.sign(sign)))
        return float(s[crossings[np.argmin(np.abs(s[crossings] - at))]])

    length = float(np.linalg.norm(p3 - top))
    n_root = square_to(g.corners[2] - p3, TO_SENSOR)
    begin = first(g.wall_cut.value, 0.0)
    end = first(lambda p: (p - p3) @ n_root, length)
    g.bevel = line(np.arange(begin, end, 0.1 * MM))
    g.corners = np.array((g.bevel[0], g.bevel[-1], g.corners[2]))
    beyond = g.wall_cut.forward @ (g.bevel[0] - top)
    g.wall = g.wall_cut.at(np.arange(beyond, REACH, CHORD))[::-1]
    g.root = straight(g.corners[1], g.corners[2])


def mill_scale(*spans: tuple[float, float]) -> Steel:
    """Scale that has partly flaked off, on wall and leg so proud; the corners are the metal's."""

    def change(g: Groove, rng: np.random.Generator) -> None:
        s = np.arange(0, REACH, 0.2 * MM)
        for name, span in zip(("wall", "leg"), spans, strict=True):
            cut: CylinderCut = getattr(g, f"{name}_cut")
            line = cut.at(s)
            height = MM * rng.uniform(*span) * _patches(s, rng)
            line = line + height[:, None] * cut.outward(line)
            setattr(g, name, line[::-1] if name == "wall" else line)

    return change


scale = mill_scale((0.2, 0.4), (0.2, 0.4))


def _patches(s: Array, rng: np.random.Generator) -> Array:
    """0 and 1 by turns, with short ramps."""
    bounds = np.cumsum(MM * rng.uniform(3, 14, 40)) - MM * rng.uniform(0, 14)
    inside = np.searchsorted(bounds, s) % 2 == rng.integers(2)
    return np.convolve(np.pad(inside.astype(float), 1, mode="edge"), np.full(3, 1 / 3), "valid")


def spatter(g: Groove, rng: np.random.Generator) -> None:
    """3 to 8 blobs anywhere on the surface; one that sits on a corner hides it."""
    surface = np.concatenate((g.wall, _dense(g.bevel), _dense(g.root), g.leg))
    near = np.flatnonzero(np.linalg.norm(surface - g.corners.mean(axis=0), axis=1) < 45 * MM)
    for i in rng.choice(near, rng.integers(3, 9)):
        radius = MM * rng.uniform(0.4, 1.6)
        g.extra.append(_blob(surface[i], radius, radius * rng.uniform(0.5, 1.2)))
        g.there &= np.linalg.norm(g.corners - surface[i], axis=1) > radius + 1 * MM


def _blob(centre: Array, radius: float, height: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, 25)
    return np.asarray(centre + np.column_stack((radius * np.cos(angle), height * np.sin(angle))))


def seam_cap(g: Groove, rng: np.random.Generator) -> None:
    """The cap of the leg's own seam weld, 6 to 20 mm beside the groove."""
    begin, width = MM * rng.uniform(6, 20), MM * rng.uniform(10, 16)
    a, b = g.leg_cut.at(np.array((begin, begin + width)))
    height = MM * rng.uniform(1.5, 3.0)
    g.extra.append(bowed(a, b, height, g.leg_cut.outward(a), 0.75))


def open_root(g: Groove, rng: np.random.Generator) -> None:
    """No bead: root face, root opening of 2 to 4 mm, and the leg goes on underneath.

    The root's corner on the leg is not there; what may be given is the foot of the root face's
    edge on the leg. High-low tilts the root face against the leg.
    """
    up_bevel = _unit(g.corners[0] - g.corners[1])
    opening = MM * rng.uniform(2, 4)
    p3 = g.corners[1]
    away = float((p3 - g.leg_cut.start) @ square_to(g.leg_cut.forward, up_bevel))
    sine = float(up_bevel @ square_to(g.leg_cut.forward, up_bevel))
    p3 = p3 + (opening - away) / sine * up_bevel
    foot = g.leg_cut.at(np.array([(p3 - g.leg_cut.start) @ g.leg_cut.forward]))[0]
    face = MM * rng.uniform(1, 3)
    inward = -g.leg_cut.forward
    high_low = MM * rng.uniform(-1, 1)
    inner = p3 + face * inward + high_low * g.leg_cut.outward(foot)
    bore = inner + 0.03 * g.wall_cut.forward
    g.corners = np.array((g.corners[0], p3, foot))
    g.there[2] = False
    g.bevel, g.root = straight(g.corners[0], p3), np.array((p3, inner, bore))
    start = float((foot - g.leg_cut.start) @ g.leg_cut.forward)
    g.leg = g.leg_cut.at(np.arange(start - 40 * MM, REACH, CHORD))


def welded(g: Groove, rng: np.random.Generator) -> None:
    """The groove is full: a cap with a few beads from wall to leg."""
    a = g.wall_cut.at(np.array([MM * rng.uniform(1, 4)]))[0]
    width = float(np.linalg.norm(a - g.corners[2])) * rng.uniform(0.5, 0.9)
    b = g.leg_cut.at(np.array([width]))[0]
    cap = bowed(a, b, MM * rng.uniform(0.5, 3), TO_SENSOR)
    s = np.linspace(0, 1, len(cap))
    ripple = np.abs(np.sin(np.pi * s * rng.integers(2, 7))) - 0.5
    normal = square_to(b - a, TO_SENSOR)
    g.bevel = cap + (MM * rng.uniform(0, 0.8) * ripple * (s * (1 - s) > 0))[:, None] * normal
    g.root = straight(g.bevel[-1], b)
    # The old leg is buried up to there.
    g.leg = g.leg_cut.at(np.arange(width, REACH, CHORD))
    g.wall = g.wall_cut.at(np.arange((a - g.wall_cut.start) @ g.wall_cut.forward, REACH, CHORD))
    g.wall = g.wall[::-1]


# --- what stands there instead of a groove


def only(*names: str) -> Steel:
    """Leave nothing but some of the sides, drawn on."""

    def change(g: Groove, rng: np.random.Generator) -> None:
        nothing = np.full((2, 2), 9.0)
        lines = {"wall": g.wall_cut, "leg": g.leg_cut}
        g.bevel = g.root = nothing
        s = np.arange(-REACH, REACH, CHORD)
        g.wall = lines["wall"].at(s) if "wall" in names else nothing
        g.leg = lines["leg"].at(s) if "leg" in names else nothing
        middle = g.corners.mean(axis=0)
        for name in names:
            if len(names) == 1:
                line = getattr(g, name)
                setattr(g, name, line + np.array((0.0, middle[1] - line[len(line) // 2, 1])))

    return change


def plate(g: Groove, rng: np.random.Generator) -> None:
    """A flat plate."""
    only()(g, rng)
    slope = rng.uniform(-0.7, 0.7)
    g.wall = np.array(((-0.1, 0.24 - 0.1 * slope), (0.1, 0.24 + 0.1 * slope)))


def corner(g: Groove, rng: np.random.Generator) -> None:
    """Brace and leg without any bevel between them."""
    wall, leg = cuts(g.pose)
    s = np.arange(0, REACH, CHORD)
    only()(g, rng)
    g.wall, g.leg = wall.at(s)[::-1], leg.at(s)


# --- faults of the sensor


def interreflection(least: float, most: float, reaches: tuple[float, float] = (3, 5)) -> Sensing:
    """Light from one face onto another pulls the notch in, smoothly within 3 to 5 mm of it."""

    def change(g: Groove, seen: Seen, points: Array, rng: np.random.Generator) -> Array:
        pull, reach = MM * rng.uniform(least, most), MM * rng.uniform(*reaches)
        along = g.corners[2] - g.corners[1]
        share = np.clip((seen.points - g.corners[1]) @ along / (along @ along), 0, 1)
        away = np.linalg.norm(seen.points - g.corners[1] - share[:, None] * along, axis=1)
        weight = np.where(away < reach, 0.5 + 0.5 * np.cos(np.pi * away / reach), 0.0)
        g.affected[1:] = True
        return points - (pull * weight)[:, None] * np.column_stack(
            (seen.tangents, np.ones_like(seen.tangents))
        )

    return change


def curled_rims(g: Groove, seen: Seen, points: Array, rng: np.random.Generator) -> Array:
    """Gaps where the surface is brightest, whose rims curl by 0.2 to 0.3 mm."""
    points = points.copy()
    for _ in range(rng.integers(3, 7)):
        first, length = rng.integers(60, 560), rng.integers(8, 25)
        rim = rng.integers(3, 8)
        lift = MM * rng.uniform(0.2, 0.3) * rng.choice((-1, 1))
        ramp = lift * np.arange(1, rim + 1) / rim
        for columns, heights in (
            (slice(first - rim, first), ramp),
            (slice(first + length, first + length + rim), ramp[::-1]),
        ):
            points[columns] += heights[:, None] * np.column_stack(
                (seen.tangents[columns], np.ones(rim))
            )
        points[first : first + length] = np.nan
    return points


def quantised(g: Groove, seen: Seen, points: Array, rng: np.random.Generator) -> Array:
    """Heights in steps of 0.05 to 0.1 mm."""
    step = MM * rng.uniform(0.05, 0.1)
    return np.column_stack((points[:, 0], np.round(points[:, 1] / step) * step))


def ghosts(g: Groove, seen: Seen, points: Array, rng: np.random.Generator) -> Array:
    """Whole runs of points before and behind the surface, most of them round the root."""
    points, surface = points.copy(), np.isfinite(points[:, 0])
    middle = g.corners[1:].mean(axis=0)
    root = int(np.nanargmin(np.linalg.norm(np.nan_to_num(points, nan=9.0) - middle, axis=1)))
    for _ in range(rng.integers(4, 9)):
        length = int(rng.integers(8, 40))
        at = root + rng.normal(0, 60) if rng.random() < 0.7 else rng.uniform(0, len(points))
        first = int(np.clip(at - length / 2, 0, len(points) - length))
        t = np.linspace(-1, 1, length)
        away = rng.choice((-1, 1)) * MM * rng.uniform(0.8, 8) * (1 + rng.uniform(-0.5, 0.5) * t)
        rays = np.column_stack((seen.tangents[first : first + length], np.ones(length)))
        points[first : first + length] += away[:, None] * rays
        surface[first : first + length] = False
    corners = g.corners[:, 0] / (g.corners[:, 1] - EMITTER_Z)
    g.affected |= hidden_corners(seen.tangents, corners, surface)
    return points


def noise(
    seen: Seen, points: Array, rng: np.random.Generator, sigma: float, *, gaps: bool = True
) -> Array:
    """Correlated noise along the rays and, unless told not to, gaps and grazing drop-outs.

    The noise is a first-order autoregression, `RHO` from column to column.
    """
    white = rng.standard_normal(len(points)) * sigma * math.sqrt(1 - RHO**2)
    along = np.empty_like(white)
    last = sigma * rng.standard_normal()
    for i, w in enumerate(white):
        along[i] = last = RHO * last + w
    points = points + along[:, None] * np.column_stack((seen.tangents, np.ones_like(along)))
    if gaps:
        grazing = (np.degrees(seen.incidence) - 65) / 15
        points[rng.random(len(points)) < grazing] = np.nan
        for first in rng.integers(0, len(points), 5):
            points[first : first + rng.integers(1, 5)] = np.nan
    return points


RHO: Final = 0.6


@dataclass(frozen=True)
class Fault:
    """A row of the bench: what is wrong with the steel, and with the sensor.

    Parameters
    ----------
    name : str
    steel : tuple of Steel
    sensing : tuple of Sensing
    gap, rise : tuple of float
        Of `draw`.
    named : str, optional
        A word that the reading's conditions, or the refusal, must hold.
    """

    name: str
    steel: tuple[Steel, ...] = ()
    sensing: tuple[Sensing, ...] = ()
    gap: tuple[float, float] = (2.0, 4.0)
    rise: tuple[float, float] = (1.5, 3.0)
    named: str | None = None


@dataclass(frozen=True)
class PosedProfile:
    """Points of a groove with the truth about it; columns may run either way."""

    groove: Groove
    points: Array


def shoot(fault: Fault, k: int, columns: int = COLUMNS) -> PosedProfile:
    """The k-th profile of a row, of a sensor of so many columns: always the same one."""
    rng = np.random.default_rng((k, *fault.name.encode()))
    return shoot_groove(fault, draw(rng, k, gap=fault.gap, rise=fault.rise), rng, columns)


def shoot_groove(
    fault: Fault, g: Groove, rng: np.random.Generator, columns: int = COLUMNS
) -> PosedProfile:
    """A profile of a groove that was drawn, with a fault."""
    for change in fault.steel:
        change(g, rng)
    seen = look_at(g.lines, g.pose.second_eye, columns)
    points = noise(seen, seen.points, rng, 1e-6 * rng.choice((20, 30, 50)))
    for sense in fault.sensing:
        points = sense(g, seen, points, rng)
    points = np.round(points / 5e-6) * 5e-6
    return PosedProfile(g, points[::-1] if rng.random() < 0.5 else points)


def _dense(line: Array) -> Array:
    pieces = [straight(a, b, max(2, int(np.linalg.norm(b - a) / CHORD))) for a, b in pairwise(line)]
    return np.concatenate(pieces)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


GROOVES: Final = (
    Fault("sound"),
    Fault("root bead bulged 0.2 mm", (bulge(0.2, 0.2),)),
    Fault("root bead bulged 0.4 mm", (bulge(0.4, 0.4),)),
    Fault("root bead bulged 0.7-1.3 mm", (bulge(0.7, 1.3),)),
    Fault("root bead sagged 0.7-1.3 mm", (bulge(-1.3, -0.7),), gap=(3, 5), rise=(2.5, 4)),
    Fault("convex root pass 3-6 mm", (root_pass,)),
    Fault("interreflection 0.4 mm", sensing=(interreflection(0.4, 0.4),)),
    Fault("interreflection 0.5-1.5 mm", sensing=(interreflection(0.5, 1.5),)),
    Fault("bevel in two facets", (two_facets,)),
    Fault("flame-cut scallops", (scallops,)),
    Fault("mill scale", (scale,)),
    Fault("spatter", (spatter,)),
    Fault("seam weld beside", (seam_cap,), named="seam"),
    Fault("open root", (open_root,), named="open"),
    Fault("tack", (tack,), named="tack"),
    Fault("rim curl", sensing=(curled_rims,)),
    Fault("quantised heights", sensing=(quantised,)),
    Fault("ghosts before and behind", sensing=(ghosts,)),
    Fault(
        "several at once",
        (bulge(-0.4, 0.8), two_facets, scale, spatter),
        (ghosts,),
    ),
)
"""Everything that has a groove."""

FILLED: Final = tuple(
    Fault(f"{share} % filled, {shape}", (partly_filled(share / 100, shape),))
    for share in (10, 25, 50, 75, 90)
    for shape in FILL_SHAPES
)
"""Grooves with weld in them: from 50 % on most of them are wider than any root."""

NO_GROOVE: Final = (
    Fault("plain plate", (plate,)),
    Fault("plain wall", (only("wall"),)),
    Fault("plain leg", (only("leg"),)),
    Fault("corner without a bevel", (corner,)),
    Fault("already welded", (welded,), named="weld"),
)
"""To be refused, or named."""
