"""Welds for the bench: a parametric T groove, faults, and worlds whose beads obey other laws."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path
from typing import Literal, Self

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tjscan.core.frames import Array
from tjscan.planning.template import SectionTemplate
from tjscan.planning.wps import WeldingProcedure, read_wps
from tjscan.welding.bead import BeadModel, LaidBeads, column_widths, interpolate_rows
from tjscan.welding.replan import NextBead
from tjscan.welding.state import WeldState
from tjscan.welding.target import WeldTarget, remaining_area
from tjscan.welding.world import TorchTrace, WeldFaults, WeldWorld, correlated_noise

LENGTH, STEP, COLUMN = 0.6, 2e-3, 0.35e-3
CAP_HEIGHT = 2.3e-3
CORNER_SIGMA = 0.05e-3
"""Of the toes' place across in the first scan, metres."""
WPS = Path(__file__).parents[1] / "examples" / "wps.toml"


def bench_wps() -> WeldingProcedure:
    """The example's procedure."""
    return read_wps(WPS)


WorldKind = Literal["right", "wrong", "arcs"]


@dataclass(frozen=True, slots=True, eq=False)
class GrooveOfBench:
    """A groove and its corners, p3, p4, g and p2, shape (n, 4, 2), metres."""

    state: WeldState
    corners: Array

    @classmethod
    def drawn(cls, seed: int) -> GrooveOfBench:
        """A groove by chance."""
        rng = np.random.default_rng([seed, 1])
        return t_groove(rng, tilt=rng.uniform(0.0, 0.35))


def t_groove(rng: np.random.Generator, tilt: float) -> GrooveOfBench:
    """A groove of 600 mm with areas from about 400 to 560 mm², as columns in the bisector's frame.

    Leg and bevel stand at half the groove angle on both sides of w; the brace's wall follows
    beyond p2. Angles, gap and area vary along it.
    """
    s = np.arange(0.0, LENGTH, STEP)

    def between(low: float, high: float) -> Array:
        phase, waves = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1.5)
        return 0.5 * (low + high) + 0.5 * (high - low) * np.sin(
            2 * np.pi * waves * s / LENGTH + phase
        )

    angle, dihedral = np.deg2rad(between(49, 65)), np.deg2rad(between(90, 134))
    gap, area = between(0.2e-3, 4e-3), between(400e-6, 560e-6)
    u = np.arange(-30e-3, 30e-3, COLUMN)
    low, high = np.full_like(s, 5e-3), np.full_like(s, 60e-3)
    for _ in range(50):
        bevel = 0.5 * (low + high)
        corners = _corners(angle, dihedral, gap, bevel)
        short = _area(corners) < area
        low, high = np.where(short, bevel, low), np.where(short, high, bevel)
    p3, p4, g, p2 = corners
    wall = dihedral - angle / 2
    w = np.empty((len(s), len(u)))
    for i in range(len(s)):
        far = p2[i] + 60e-3 * np.array((-np.sin(wall[i]), np.cos(wall[i])))
        out = p4[i] + 90e-3 * np.array((np.sin(angle[i] / 2), np.cos(angle[i] / 2)))
        w[i] = np.interp(u, *np.array((far, p2[i], p3[i], p4[i], out)).T)
    toes = np.stack((p2[:, 0], g[:, 0]), axis=1)
    return GrooveOfBench(
        WeldState.of_groove(s, u, w, toes, np.full_like(s, tilt)), np.stack((p3, p4, g, p2), axis=1)
    )


def _corners(angle: Array, dihedral: Array, gap: Array, bevel: Array) -> tuple[Array, ...]:
    half = angle / 2
    zero = np.zeros_like(gap)
    p3, p4 = np.stack((-gap / 2 - 1e-6, zero), 1), np.stack((gap / 2 + 1e-6, zero), 1)
    p2 = p3 + bevel[:, None] * np.stack((-np.sin(half), np.cos(half)), 1)
    leg = np.stack((np.sin(half), np.cos(half)), 1)
    back = np.stack((np.sin(dihedral - half), -np.cos(dihedral - half)), 1)
    # g: p4 + x leg = p2 + y back
    cross = leg[:, 0] * back[:, 1] - leg[:, 1] * back[:, 0]
    d = p2 - p4
    x = (d[:, 0] * back[:, 1] - d[:, 1] * back[:, 0]) / cross
    return p3, p4, p4 + x[:, None] * leg, p2


def _area(corners: tuple[Array, ...]) -> Array:
    p3, p4, g, p2 = corners
    a, b = g - p3, p2 - p4
    return 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def drawn_faults(rng: np.random.Generator) -> WeldFaults:
    """All faults of a weld: signs and sizes by chance."""
    return WeldFaults(
        gain=0.03 * rng.uniform(-1, 1),
        slip=rng.uniform(0.02, 0.05),
        offset=rng.choice((-1, 1)) * 0.5e-3,
        wander=0.5e-3,
        width_sigma=0.05,
        shrinkage=0.3 * rng.uniform(-1, 1),
    )


@dataclass(slots=True)
class ArcWorld(WeldWorld):
    """A world of other equations: a bead is a circular arc over its surface, and melts nothing.

    Its radius follows from its width, its height from its area; it meets walls at whatever angle.
    """

    def lay_shape(self, part: WeldState, centre: Array, width: Array, area: Array) -> LaidBeads:
        u, w = part.u, part.w
        radius = 0.62 * width[:, None]
        x = u - centre[:, None]
        inside = np.abs(x) < radius
        dome = np.where(inside, np.sqrt(np.maximum(radius**2 - x**2, 0.0)), -1.0)
        (at,) = interpolate_rows(centre, u, w)
        low, high = at - 40e-3, at + 40e-3
        widths = column_widths(u)
        for _ in range(40):
            middle = 0.5 * (low + high)
            over = np.maximum(dome + middle[:, None] - w, 0.0) * inside
            short = np.einsum("ij,ij->i", widths, over) < area
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        over = np.maximum(dome + low[:, None] - w, 0.0) * inside
        over *= (area / np.einsum("ij,ij->i", widths, over))[:, None]
        covered = over > 0
        rows = np.arange(len(u))
        left = u[rows, covered.argmax(axis=1)]
        right = u[rows, u.shape[1] - 1 - covered[:, ::-1].argmax(axis=1)]
        return LaidBeads(w + over, left, right, np.zeros((len(u), 2)), np.zeros(len(u), dtype=bool))


def make_world(kind: WorldKind, groove: GrooveOfBench, seed: int) -> WeldWorld:
    """A world by name: ``right`` has the planner's bead model, ``wrong`` and ``arcs`` have not."""
    rng = np.random.default_rng(seed)
    state, faults = groove.state, drawn_faults(rng)
    wire = bench_wps().wire
    model = BeadModel()
    if kind != "right":
        state = replace(state, tilt=state.tilt + radians(10))
    if kind == "wrong":
        model = replace(
            model,
            width_factor=0.88 * model.width_factor,
            least_contact=radians(35),
            largest_contact=radians(80),
        )
    make = ArcWorld if kind == "arcs" else WeldWorld
    return make(state, wire.diameter, wire.deposition_efficiency, rng, model=model, faults=faults)


@dataclass(slots=True)
class Look:
    """A look at a world: noise of heights, and registration along the leg."""

    rng: np.random.Generator
    noise: float = 0.05e-3
    registration: float = 0.05e-3

    def first_scan(self, world: WeldWorld, groove: GrooveOfBench) -> WeldState:
        """What the planner begins with: sections smoothed along the groove, corners with noise."""
        u, w = (gaussian_filter1d(rows, 2.0, axis=0) for rows in self.take(world))
        n = len(groove.state.s)
        off = correlated_noise(groove.state.s, 0.04, CORNER_SIGMA, self.rng)
        toes = groove.corners[:, [3, 2], 0] + off[:, None]
        return WeldState.of_groove(groove.state.s, u, w, toes, np.full(n, groove.state.tilt[0]))

    def take(self, world: WeldWorld) -> tuple[Array, Array]:
        """Surface seen, u and w, shape (n, m)."""
        state = world.state
        shift = correlated_noise(state.s, 0.04, self.registration, self.rng)
        leg = np.stack((state.u[:, -1] - state.u[:, -9], state.base[:, -1] - state.base[:, -9]), 1)
        leg /= np.linalg.norm(leg, axis=1, keepdims=True)
        noise = self.noise * self.rng.standard_normal(state.w.shape)
        return state.u + (shift * leg[:, 0])[:, None], state.w + noise + (shift * leg[:, 1])[
            :, None
        ]


ENDS = 5
"""Stations at either end, 10 mm, that are left out: ignition and crater."""


@dataclass(frozen=True, slots=True)
class SurfaceErrors:
    """A finished surface against its target, ends apart, in mm and %."""

    fill_rms: float
    fill_p95: float
    cap_rms: float
    excess_b: float
    excess_c: float
    sag_share: float
    sag_p95: float

    @classmethod
    def of_weld(cls, state: WeldState, cap_height: float, *, closed: bool = False) -> Self:
        """Those of a true surface; the target moved with the groove's faces."""
        inner = slice(None) if closed else slice(ENDS, -ENDS)
        target = WeldTarget.over(state, cap_height)
        upright = 1 / np.hypot(1, target.slope)
        span = np.diff(state.toe_points[:, :, 0], axis=1)[:, 0]
        width = (span / upright)[inner]
        fill = -remaining_area(state, target)[inner] / width
        between = np.where(target.between, 1.0, np.nan) * upright[:, None]
        point = ((state.w - target.top) * between)[inner]
        over = ((state.w - target.chord) * between)[inner]
        excess, sag = np.nanmax(over, axis=1), -np.nanmin(over, axis=1)
        return cls(
            1e3 * float(np.sqrt(np.mean(fill**2))),
            1e3 * float(np.percentile(np.abs(fill), 95)),
            1e3 * float(np.sqrt(np.nanmean(point**2))),
            100 * float(np.mean(excess <= np.minimum(1e-3 + 0.1 * width, 5e-3))),
            100 * float(np.mean(excess <= np.minimum(1e-3 + 0.15 * width, 7e-3))),
            100 * float(np.mean(sag < 0.5e-3)),
            1e3 * float(np.percentile(sag, 95)),
        )


def trace_of(bead: NextBead) -> TorchTrace:
    """A torch that does what a bead says."""
    u = bead.tip[:, 0]
    return TorchTrace(bead.s, u, bead.speed, bead.feed, bead.heat_input, bead.weave)


def even_plan(groove: GrooveOfBench, counts: tuple[int, ...], feed: float) -> Iterator[TorchTrace]:
    """Torches of a plan whose beads fill their cells exactly, each aiming at its lower side."""
    template = SectionTemplate(groove.corners, CAP_HEIGHT)
    share = template.area / sum(counts)
    cells = template.cut_into_beads(counts, np.tile(share[:, None], (1, sum(counts))))
    wps, n = bench_wps(), len(share)
    feeds = np.full(n, feed)
    speed = np.clip(wps.deposition_rate(feeds) / share, *wps.arc.travel_speed)
    heat = wps.heat_input(feeds, speed)
    for layer, count in enumerate(counts):
        quads = cells.quadrilaterals(layer)
        for j in sorted(range(count), key=lambda k: (min(k, count - 1 - k), k)):
            aim, weave = quads[:, j, :2, 0].mean(axis=1), np.full(n, 3e-3)
            yield TorchTrace(groove.state.s, aim, speed, feeds, heat, weave)
