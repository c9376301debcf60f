"""A second ray caster for grooves: it shares no code and no equation with the first one.

Steel is where a function of the plane is positive, put together from half planes, parabolas and
discs by minimum and maximum; rays are marched through it and bisected. Speckle is correlated by a
bell and patchy in strength, reflections are the mirror image of the other face or rows of the
picture shifted, light between the faces follows the view factor of a wedge, and scale is where a
random wave is above a level.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from _sections import hidden_corners
from numpy.typing import NDArray

Array = NDArray[np.float64]

MM: Final = 1e-3
STEP, BISECTIONS = 0.25 * MM, 12
NEAREST, FARTHEST = 0.16, 0.32


@dataclass
class WedgeGroove:
    """One groove in the plane of the laser, in the sensor's frame.

    Parameters
    ----------
    corners : ndarray, shape (3, 2)
        Top of the bevel, and the root's corners, or a weld's toes, on bevel and leg.
    wall, leg : ndarray, shape (2,)
        Unit vectors up the wall and out along the leg, at their corners.
    bends : dict of str to float
        Second coefficients of ``wall`` and ``leg``, 1/m, positive towards the sensor.
    proud : dict of str to function
        Height of what stands out over ``wall``, ``bevel``, ``root`` and ``leg``, by the distance
        from the side's first corner; the wall's counts from its end.
    discs : list of (ndarray, float)
        Centres and radii of what sticks to the steel.
    there, affected : ndarray of bool, shape (3,)
        As of `_steel.Groove`.
    """

    corners: Array
    wall: Array
    leg: Array
    bends: dict[str, float]
    proud: dict[str, Callable[[Array], Array]] = field(default_factory=dict)
    discs: list[tuple[Array, float]] = field(default_factory=list)
    there: NDArray[np.bool_] = field(default_factory=lambda: np.ones(3, dtype=bool))
    affected: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(3, dtype=bool))

    @property
    def sides(self) -> dict[str, tuple[Array, Array]]:
        """Where each side begins, on the way from the wall to the leg, and its direction."""
        p2, p3, p4 = self.corners
        return {
            "wall": (p2, -self.wall),
            "bevel": (p2, _unit(p3 - p2)),
            "root": (p3, _unit(p4 - p3)),
            "leg": (p4, self.leg),
        }

    def steel(self, x: Array, z: Array) -> Array:
        """Positive in steel, zero on its surface."""
        behind = {}
        for name, (start, along) in self.sides.items():
            dx, dz = x - start[0], z - start[1]
            s = dx * along[0] + dz * along[1]
            height = self.proud[name](s) if name in self.proud else 0.0
            height = height + self.bends.get(name, 0.0) * s * s
            behind[name] = dx * along[1] - dz * along[0] + height
        # Drawn on into the brace the root ends at the wall at the latest.
        (x3, z3), (ux, uz) = self.sides["root"]
        inside = (x - x3) * ux + (z - z3) * uz < 0
        root = np.where(inside, np.minimum(behind["root"], behind["wall"]), behind["root"])
        found = np.maximum(np.minimum(behind["wall"], behind["bevel"]), behind["leg"])
        found = np.maximum(found, root)
        for centre, radius in self.discs:
            found = np.maximum(found, radius - np.hypot(x - centre[0], z - centre[1]))
        return np.asarray(found)

    def place(self, name: str, s: float, height: float = 0.0) -> Array:
        """A point on a side, so far from its first corner and so high over it."""
        start, along = self.sides[name]
        outward = np.array((-along[1], along[0]))
        return np.asarray(
            start + s * along + (self.bends.get(name, 0.0) * s * s + height) * outward
        )

    @property
    def area(self) -> float:
        """Between the weld or root and where the tangents of wall and leg meet, m².

        What stands out over both counts as less than nothing.
        """
        p2, p3, p4 = self.corners
        along = np.linalg.solve(np.column_stack((-self.wall, -self.leg)), p4 - p2)[0]
        (ax, az), (bx, bz) = p3 - p2 + along * self.wall, p4 - p2
        chord = float(np.linalg.norm(p4 - p3))
        s = np.linspace(0, chord, 4001)
        stands = self.proud["root"](s) if "root" in self.proud else np.zeros_like(s)
        # The diagonals of origin, p2, p3 and p4.
        return 0.5 * float(ax * bz - az * bx) - float(stands.mean()) * chord


@dataclass(frozen=True)
class View:
    """Rays from an emitter on the sensor's axis: their tangents x / z, shape (n,)."""

    emitter: Array
    tangents: Array

    def points(self, depth: Array) -> Array:
        """At depths along z from the emitter, shape (n, 2)."""
        return np.column_stack((self.tangents * depth, self.emitter[1] + depth))


@dataclass(frozen=True)
class WedgeProfile:
    """Points of one groove, shape (n, 2), with the truth about it."""

    groove: WedgeGroove
    points: Array


Steel = Callable[[WedgeGroove, np.random.Generator], None]
Light = Callable[[WedgeGroove, View, Array, np.random.Generator], Array]
"""Gives other depths, shape (n,), than those handed in."""


@dataclass(frozen=True)
class SecondFault:
    """A row of the bench: its name, what is wrong with the steel, and with the light."""

    name: str
    steel: tuple[Steel, ...] = ()
    light: tuple[Light, ...] = ()
    named: str | None = None

    def shoot(self, k: int) -> WedgeProfile:
        """The k-th profile of this row: always the same one."""
        rng = np.random.default_rng((k, 2, *self.name.encode()))
        return self.shoot_groove(draw_wedge(rng), rng)

    def shoot_groove(self, g: WedgeGroove, rng: np.random.Generator) -> WedgeProfile:
        """A profile of a groove that was drawn."""
        for change in self.steel:
            change(g, rng)
        view = View(
            np.array((0.0, MM * rng.uniform(-20, 20))),
            np.linspace(-0.21, 0.21, int(rng.choice((480, 640, 800)))),
        )
        depth = march(g, view)
        detector = view.emitter + MM * rng.uniform((-10, -20), (10, 20))
        depth[~_in_sight(g, view.points(depth), detector)] = np.nan
        lost = _lost(depth, view.tangents, rng)
        for alter in self.light:
            depth = alter(g, view, depth, rng)
        depth = depth + speckle(len(depth), rng)
        depth[lost] = np.nan
        points = np.round(view.points(depth) / 8e-6) * 8e-6
        return WedgeProfile(g, points[::-1] if rng.random() < 0.5 else points)


def draw_wedge(rng: np.random.Generator) -> WedgeGroove:
    """A sound groove, looked at along the middle of its opening but for 6 degrees and 6 mm."""
    opening = math.radians(rng.uniform(36, 62))
    dihedral = opening + math.radians(rng.uniform(26, 75))
    length, face = MM * rng.uniform(14, 34), MM * rng.uniform(2.5, 5.5)
    middle = math.radians(90 + rng.uniform(-6, 6))

    def direction(from_leg: float) -> Array:
        """At an angle from the leg towards the wall; z goes into the notch."""
        angle = middle + opening / 2 - from_leg
        return np.array((math.cos(angle), -math.sin(angle)))

    leg, bevel, wall = direction(0), direction(opening), direction(dihedral)
    apex = MM * np.array((rng.uniform(-6, 6), 250 + rng.uniform(-6, 6)))
    far = face / (2 * math.sin(opening / 2)) * rng.uniform(0.9, 1.1, 2)
    p3, p4 = apex + far[0] * bevel, apex + far[1] * leg
    bends = {"wall": rng.uniform(-0.15, 0), "leg": rng.uniform(-2, 0)}
    return WedgeGroove(np.array((p3 + length * bevel, p3, p4)), wall, leg, bends)


def march(g: WedgeGroove, view: View) -> Array:
    """Depths along z of the first steel on each ray, shape (n,); NaN where there is none."""
    u, z0, depth = view.tangents, view.emitter[1], np.arange(NEAREST, FARTHEST, STEP)
    inside = g.steel(u[:, None] * depth, z0 + depth[None]) > 0
    first = inside.argmax(axis=1)
    near, far = depth[np.maximum(first - 1, 0)], depth[first]
    for _ in range(BISECTIONS):
        half = 0.5 * (near + far)
        within = g.steel(u * half, z0 + half) > 0
        near, far = np.where(within, near, half), np.where(within, half, far)
    return np.where(first > 0, far, np.nan)


def _in_sight(g: WedgeGroove, points: Array, detector: Array) -> NDArray[np.bool_]:
    """Whether nothing lies between each point and the detector."""
    away = detector - points
    away /= np.linalg.norm(away, axis=1)[:, None]
    way = points[:, None] + np.arange(0.05 * MM, 60 * MM, STEP)[:, None] * away[:, None]
    return np.asarray(~(g.steel(way[..., 0], way[..., 1]) > 0).any(axis=1))


def speckle(count: int, rng: np.random.Generator) -> Array:
    """Noise along the rays whose correlation is a bell, and whose strength is patchy, (n,)."""
    kernel = np.exp(-0.5 * (np.arange(-5, 6) / rng.uniform(0.6, 1.4)) ** 2)
    white = np.convolve(rng.standard_normal(count + 10), kernel / np.linalg.norm(kernel), "valid")
    slow = np.convolve(rng.standard_normal(count + 60), np.hanning(61) / 5, "valid")
    return np.asarray(1e-6 * rng.choice((15, 30, 45)) * np.exp(0.25 * slow) * white)


def _lost(depth: Array, tangents: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Points lost where the ray grazes, and at random in short gaps."""
    slope = np.abs(np.gradient(depth, tangents)) / np.nan_to_num(depth, nan=1.0)
    lost = rng.random(len(depth)) < np.clip((np.nan_to_num(slope, nan=9.0) - 2.5) / 3, 0, 1)
    for at in rng.integers(0, len(depth), rng.poisson(4)).tolist():
        lost[at : at + rng.geometric(0.4)] = True
    return np.asarray(lost)


# --- faults of the steel


def _arc(chord: float, sagitta: float) -> Callable[[Array], Array]:
    """Height of an arc of a circle over its chord."""
    radius = (chord**2 / 4 + sagitta**2) / (2 * abs(sagitta))

    def height(s: Array) -> Array:
        away = np.minimum(np.abs(s - chord / 2), chord / 2)
        return np.asarray(np.sign(sagitta) * (np.sqrt(radius**2 - away**2) - radius) + sagitta)

    return height


def bead(least: float, most: float) -> Steel:
    """A root bead that is an arc, so many millimetres high."""

    def change(g: WedgeGroove, rng: np.random.Generator) -> None:
        chord = float(np.linalg.norm(g.corners[2] - g.corners[1]))
        g.proud["root"] = _arc(chord, MM * rng.uniform(least, most))

    return change


def weld(share: float, sagittas: tuple[float, float], beads: int = 1) -> Steel:
    """Weld up to a share of the bevel: arcs side by side, heights as shares of their width."""

    def change(g: WedgeGroove, rng: np.random.Generator) -> None:
        rise = share * float(np.linalg.norm(g.corners[0] - g.corners[1]))
        s = rise * rng.uniform(0.7, 1.3)
        toe, along = g.place("leg", s), g.leg
        bent = 2 * g.bends["leg"] * s
        g.leg = _unit(along + bent * np.array((-along[1], along[0])))
        g.corners = np.array((g.corners[0], g.corners[1] - rise * g.sides["bevel"][1], toe))
        chord = float(np.linalg.norm(g.corners[2] - g.corners[1]))
        width = chord / beads
        arc = _arc(width, width * rng.uniform(*sagittas))
        g.proud["root"] = lambda s: np.where((s > 0) & (s < chord), arc(s % width), 0.0)

    return change


def facets(g: WedgeGroove, rng: np.random.Generator) -> None:
    """A bevel that stands out or lies back at a knee of 5 to 9 degrees."""
    length = float(np.linalg.norm(g.corners[1] - g.corners[0]))
    knee, turn = rng.uniform(0.35, 0.65), math.tan(math.radians(rng.uniform(5, 9)))
    sign = rng.choice((-1, 1))
    g.proud["bevel"] = lambda s: sign * turn * np.minimum((1 - knee) * s, knee * (length - s))


def scallops(g: WedgeGroove, rng: np.random.Generator) -> None:
    """Waves along a flame-cut bevel that fade out at both of its corners."""
    length = float(np.linalg.norm(g.corners[1] - g.corners[0]))
    height, number = MM * rng.uniform(0.1, 0.2), 2 * math.pi / (MM * rng.uniform(3, 5))
    g.proud["bevel"] = lambda s: (
        height * np.clip(np.minimum(s, length - s) / (2 * MM), 0, 1) * np.cos(number * s)
    )


def scale(least: float, most: float) -> Steel:
    """Scale of one thickness on wall and leg each, where a random wave is above a level."""

    def change(g: WedgeGroove, rng: np.random.Generator) -> None:
        for name in ("wall", "leg"):
            thick, level = MM * rng.uniform(least, most), rng.uniform(-0.6, 0.9)
            numbers = 2 * math.pi / (MM * rng.uniform(9, 40, (5, 1, 1)))
            phases = rng.uniform(0, 2 * math.pi, (5, 1, 1))

            def height(
                s: Array, a: float = thick, b: float = level, k: Array = numbers, p: Array = phases
            ) -> Array:
                wave = np.sin(k * np.atleast_2d(s) + p).sum(axis=0).reshape(s.shape)
                return np.asarray(0.5 * a * (1 + np.tanh((wave - b) / 0.15)))

            g.proud[name] = height

    return change


def drops(g: WedgeGroove, rng: np.random.Generator) -> None:
    """Drops of 0.4 to 1.5 mm that stick to the steel anywhere about the groove."""
    length = float(np.linalg.norm(g.corners[1] - g.corners[0]))
    for _ in range(rng.integers(3, 9)):
        name, reach = (("wall", -25 * MM), ("bevel", length), ("leg", 25 * MM))[rng.integers(3)]
        centre, radius = g.place(name, reach * rng.random()), MM * rng.uniform(0.4, 1.5)
        g.discs.append((centre, radius))
        g.there &= np.linalg.norm(g.corners - centre, axis=1) > radius + 1 * MM


def seam_cap(g: WedgeGroove, rng: np.random.Generator) -> None:
    """The cap of a seam weld on the leg: the top of a large disc."""
    width, height = MM * rng.uniform(10, 16), MM * rng.uniform(1.5, 3)
    radius = (width**2 / 4 + height**2) / (2 * height)
    middle = MM * rng.uniform(6, 20) + width / 2
    g.discs.append((g.place("leg", middle, height - radius), radius))


# --- faults of the light


def between_faces(least: float, most: float, widths: tuple[float, float] = (1.4, 2.4)) -> Light:
    """Light from each face onto the other draws its points nearer, by a wedge's view factor.

    A strip as wide as `lit` beside the notch lights the other face.
    """

    def change(g: WedgeGroove, view: View, depth: Array, rng: np.random.Generator) -> Array:
        pull, lit = MM * rng.uniform(least, most), MM * rng.uniform(*widths)
        (_, p3, p4), bevel = g.corners, -g.sides["bevel"][1]
        cosine, points = float(bevel @ g.leg), view.points(depth)
        away = np.maximum(np.maximum((points - p3) @ bevel, (points - p4) @ g.leg), 0.0)
        across = np.sqrt(away**2 + lit**2 - 2 * away * lit * cosine)
        g.affected[1:] = True
        return np.asarray(depth - pull * (1 + (lit * cosine - away) / across) / (1 + cosine))

    return change


def blooming(g: WedgeGroove, view: View, depth: Array, rng: np.random.Generator) -> Array:
    """Bright spots that are lost, and about which points bend away within a few columns."""
    column = np.arange(len(depth))
    for _ in range(rng.integers(3, 7)):
        middle, half = rng.uniform(0.1, 0.9) * len(depth), rng.uniform(4, 12)
        beyond = np.abs(column - middle) - half
        lift = MM * rng.uniform(0.2, 0.3) * rng.choice((-1, 1))
        depth = depth + lift * np.exp(-np.maximum(beyond, 0) / rng.uniform(1, 2.5)) * (beyond < 10)
        depth[beyond < 0] = np.nan
    return depth


def reflections(g: WedgeGroove, view: View, depth: Array, rng: np.random.Generator) -> Array:
    """Runs of columns that show the other face in the mirror of their own, or shifted rows."""
    depth, (bevel, leg) = depth.copy(), (g.sides["bevel"], (g.corners[2], g.leg))
    surface = np.isfinite(depth)
    root = int(np.abs(view.tangents - g.corners[1, 0] / g.corners[1, 1]).argmin())
    for _ in range(rng.integers(4, 9)):
        length = int(rng.integers(8, 40))
        at = root + rng.normal(0, 60) if rng.random() < 0.7 else rng.uniform(0, len(depth))
        first = int(np.clip(at - length / 2, 0, len(depth) - length))
        run = slice(first, first + length)
        shifted = 1 / (1 / depth[run] + rng.choice((-1, 1)) * rng.uniform(0.8, 8) * MM / 0.24**2)
        own, other = (bevel, leg) if view.tangents[first] > view.tangents[root] else (leg, bevel)
        normal = np.array((-own[1][1], own[1][0]))
        flip = np.eye(2) - 2 * np.outer(normal, normal)
        start, along = own[0] + flip @ (other[0] - own[0]) - view.emitter, flip @ other[1]
        u = view.tangents[run]
        # The ray (u, 1) d meets start + t along.
        mirrored = (start[0] * along[1] - start[1] * along[0]) / (u * along[1] - along[0])
        seen = np.abs(mirrored - depth[run]) < 12 * MM
        depth[run] = np.where(seen, mirrored, shifted) if rng.random() < 0.5 else shifted
        surface[run] = False
    corners = g.corners - view.emitter
    g.affected |= hidden_corners(view.tangents, corners[:, 0] / corners[:, 1], surface)
    return depth


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


SECOND_GROOVES: Final = (
    SecondFault("second caster, sound"),
    SecondFault("second caster, root bead", (bead(-0.5, 1.0),)),
    SecondFault("second caster, two facets", (facets,)),
    SecondFault("second caster, scallops", (scallops,)),
    SecondFault("second caster, light scale", (scale(0.1, 0.2),)),
    SecondFault("second caster, heavy scale", (scale(0.3, 0.5),)),
    SecondFault("second caster, spatter", (drops,)),
    SecondFault("second caster, seam", (seam_cap,), named="seam"),
    SecondFault("second caster, blooming", light=(blooming,)),
    SecondFault("second caster, light 0.4 mm", light=(between_faces(0.4, 0.4),)),
    SecondFault("second caster, light 0.5-1.5 mm", light=(between_faces(0.5, 1.5),)),
    SecondFault("second caster, reflections", light=(reflections,)),
    SecondFault(
        "second caster, several", (bead(-0.4, 0.8), facets, scale(0.2, 0.4), drops), (reflections,)
    ),
)
"""Everything that has a groove."""

SECOND_FILLED: Final = tuple(
    SecondFault(f"second caster, {round(100 * share)} % {name}", (weld(share, sagittas, beads),))
    for share in (0.25, 0.5, 0.75)
    for name, sagittas, beads in (
        ("convex", (0.05, 0.12), 1),
        ("concave", (-0.08, -0.03), 1),
        ("beads", (0.06, 0.12), 3),
    )
)
"""Grooves with weld in them."""
