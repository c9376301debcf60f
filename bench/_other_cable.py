"""A cable plant of another make, from first principles: no equation of the product's simulation.

MuJoCo's plant has rigid links, ball joints, soft welds at the vehicles and soft contacts with a
friction that creeps. This one is a discrete elastic rod in the plane (Bergou et al., Discrete
elastic rods, 2008): points with stiff springs between them, half as far apart as the job's links,
that bend towards a curvature of their own. Each step is the least of an incremental potential
(implicit Euler), in which the floor's friction is Coulomb's dissipation (Moreau, 1977). A link that
a vehicle holds is a rigid part of the vehicle: nothing slips or yields there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple, TypeVar, cast
from unittest.mock import patch

import numpy as np
from numba import njit

from tjscan.core.errors import VehicleFault
from tjscan.core.frames import Array
from tjscan.vehicle.cable.model import TowingWorldModel

PARTS: Final = 1
"""Segments in each of the job's links."""

TIME_STEP: Final = 0.005
STRETCHING: Final = 1e6
"""N/m of a segment: 10 N make the whole cable a millimetre longer."""

CREEP: Final = 1e-5
"""m/s below which friction is not yet Coulomb's: a loaded point creeps 1 cm in 1,000 s at most."""

CONTACT: Final = 5e3
"""N/m of what is touched."""

LOOK_STEPS: Final = 2
"""Steps from one look for contacts to the next."""

BAND: Final = 7
"""Of the matrix: three neighbours, one of them a vehicle with its three degrees of freedom."""

MOST_NEWTON_STEPS: Final = 40
FORCE_TOLERANCE: Final = 2e-3
"""Newton, of what is left of the balance of forces."""


@dataclass(frozen=True, slots=True)
class CableTruth:
    """What the cable truly is: shares of what the job states, and a set.

    Parameters
    ----------
    stiffness, friction : float
        Over what the job states.
    curvature : float
        To which the cable bends by itself, 1/m.
    """

    stiffness: float = 1.0
    friction: float = 1.0
    curvature: float = 0.0


F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a function, with a type that callers know."""
    return cast(F, njit(cache=True)(function))


class Rod(NamedTuple):
    """What a step needs to know of the rod.

    Parameters
    ----------
    dof : ndarray of int, shape (n + 1,)
        First degree of freedom of each point; -1 of the root.
    lever : ndarray, shape (n + 1,)
        Metres from a vehicle's origin back to a point that it holds; NaN of a free point.
    root : ndarray, shape (3,)
    segment : float
        Metres.
    stiffness, damping : float
        Of a point, N m/rad and N m s/rad.
    rest : float
        Angle of a point without stress, radians.
    slide : ndarray, shape (n + 1,)
        Friction of each point, newton.
    mass : ndarray, shape (d,)
        Of each degree of freedom.
    """

    dof: Any
    lever: Array
    root: Array
    segment: float
    stiffness: float
    damping: float
    rest: float
    slide: Array
    mass: Array


class Step(NamedTuple):
    """What a step needs to know besides: of where it begins, of what pushes, and room.

    Parameters
    ----------
    ahead, push : ndarray, shape (d,)
        Where everything would go by itself, and forces.
    start : ndarray, shape (n + 1, 2)
        Places of the points before.
    bent : ndarray, shape (n,)
        Their angles before.
    contacts : ndarray, shape (c, 4)
        First degree of freedom, normal, and how far along it there is something.
    seconds : float
    points, angles : ndarray
        Room for what `potential` finds.
    """

    ahead: Array
    push: Array
    start: Array
    bent: Array
    contacts: Array
    seconds: float
    points: Array
    angles: Array


@compiled
def place(rod: Rod, x: Array, points: Array) -> None:
    """Fill the points' places, shape (n + 1, 2)."""
    points[0] = rod.root[:2]
    for j in range(1, len(points)):
        k, lever = rod.dof[j], rod.lever[j]
        points[j, 0], points[j, 1] = x[k], x[k + 1]
        if lever == lever:
            points[j, 0] -= lever * np.cos(x[k + 2])
            points[j, 1] -= lever * np.sin(x[k + 2])


@compiled
def bends(rod: Rod, points: Array, angles: Array) -> None:
    """Fill the angle at each point but the last, shape (n,)."""
    before = rod.root[2]
    for j in range(len(angles)):
        dx, dy = points[j + 1, 0] - points[j, 0], points[j + 1, 1] - points[j, 1]
        heading = np.arctan2(dy, dx)
        turn = heading - before
        angles[j] = turn - 2 * np.pi * np.floor(turn / (2 * np.pi) + 0.5)
        before = heading


@compiled
def potential(rod: Rod, x: Array, given: Step) -> float:
    """Incremental potential of a step."""
    ahead, push, start, bent, contacts, step, points, angles = given
    place(rod, x, points)
    bends(rod, points, angles)
    energy = 0.0
    for i in range(len(x)):
        energy += 0.5 * rod.mass[i] * ((x[i] - ahead[i]) / step) ** 2 - push[i] * x[i]
    n = len(angles)
    for j in range(n):
        a = angles[j] - rod.rest
        moved = angles[j] - bent[j]
        energy += 0.5 * rod.stiffness * a * a + 0.5 * rod.damping / step * moved * moved
        if rod.dof[j] != rod.dof[j + 1] or rod.dof[j] < 0:
            length = np.hypot(points[j + 1, 0] - points[j, 0], points[j + 1, 1] - points[j, 1])
            energy += 0.5 * STRETCHING * (length - rod.segment) ** 2
    small = CREEP * step
    for j in range(1, n + 1):
        dx, dy = points[j, 0] - start[j, 0], points[j, 1] - start[j, 1]
        energy += rod.slide[j] * (np.sqrt(dx * dx + dy * dy + small * small) - small)
    for c in range(len(contacts)):
        k = int(contacts[c, 0])
        deep = contacts[c, 3] - contacts[c, 1] * x[k] - contacts[c, 2] * x[k + 1]
        if deep > 0:
            energy += 0.5 * CONTACT * deep * deep
    return energy


@compiled
def add(rod: Rod, x: Array, j: int, g: Array, gradient: Array) -> None:
    """Add what a point's gradient is for its degrees of freedom."""
    k, lever = rod.dof[j], rod.lever[j]
    if k < 0:
        return
    gradient[k] += g[0]
    gradient[k + 1] += g[1]
    if lever == lever:
        gradient[k + 2] += lever * (np.sin(x[k + 2]) * g[0] - np.cos(x[k + 2]) * g[1])


@compiled
def add_square(rod: Rod, x: Array, js: Any, gs: Array, factor: float, band: Array) -> None:
    """Add `factor` g g' of a function of some points to the matrix."""
    place_of, value, count = np.empty(9, np.int64), np.empty(9), 0
    for a in range(len(js)):
        k, lever = rod.dof[js[a]], rod.lever[js[a]]
        if k < 0:
            continue
        place_of[count], value[count] = k, gs[a, 0]
        place_of[count + 1], value[count + 1] = k + 1, gs[a, 1]
        count += 2
        if lever == lever:
            place_of[count] = k + 2
            value[count] = lever * (np.sin(x[k + 2]) * gs[a, 0] - np.cos(x[k + 2]) * gs[a, 1])
            count += 1
    for a in range(count):
        for b in range(count):
            if place_of[a] >= place_of[b]:
                band[place_of[a], place_of[a] - place_of[b]] += factor * value[a] * value[b]


@compiled
def derivatives(rod: Rod, x: Array, given: Step, gradient: Array, band: Array) -> None:
    """Gradient and a positive Hessian of the potential at what `potential` was last asked for."""
    ahead, push, start, bent, contacts, step, points, angles = given
    n = len(angles)
    band[:] = 0.0
    for i in range(len(x)):
        gradient[i] = rod.mass[i] * (x[i] - ahead[i]) / step**2 - push[i]
        band[i, 0] = rod.mass[i] / step**2
    g, js = np.empty((3, 2)), np.empty(3, np.int64)
    two = np.empty((2, 2))
    for j in range(n):
        d = points[j + 1] - points[j]
        square = d[0] * d[0] + d[1] * d[1]
        turned = np.array((-d[1], d[0])) / square  # of its heading by its vector
        moment = rod.stiffness * (angles[j] - rod.rest) + rod.damping / step * (angles[j] - bent[j])
        js[0], js[1], js[2] = max(j - 1, 0), j, j + 1
        g[2] = turned
        g[1] = -turned
        g[0] = 0.0
        if j > 0:
            e = points[j] - points[j - 1]
            before = np.array((-e[1], e[0])) / (e[0] * e[0] + e[1] * e[1])
            g[1] -= before
            g[0] += before
        for a in range(3):
            add(rod, x, js[a], moment * g[a], gradient)
        add_square(rod, x, js, g, rod.stiffness + rod.damping / step, band)
        if rod.dof[j] != rod.dof[j + 1] or rod.dof[j] < 0:
            length = np.sqrt(square)
            along, tension = d / length, STRETCHING * (length - rod.segment)
            add(rod, x, j + 1, tension * along, gradient)
            add(rod, x, j, -tension * along, gradient)
            two[1], two[0] = along, -along
            add_square(rod, x, js[1:], two, STRETCHING, band)
            if tension > 0:
                across = np.array((-along[1], along[0]))
                two[1], two[0] = across, -across
                add_square(rod, x, js[1:], two, tension / length, band)
    small, one = CREEP * step, np.empty((1, 2))
    for j in range(1, n + 1):
        if rod.slide[j] == 0.0:
            continue
        d = points[j] - start[j]
        far = np.sqrt(d[0] * d[0] + d[1] * d[1] + small * small)
        add(rod, x, j, rod.slide[j] / far * d, gradient)
        gone = np.sqrt(d[0] * d[0] + d[1] * d[1])
        along = d / gone if gone > 0 else np.array((1.0, 0.0))
        one[0] = along
        add_square(rod, x, np.array([j]), one, rod.slide[j] * small**2 / far**3, band)
        one[0] = np.array((-along[1], along[0]))
        add_square(rod, x, np.array([j]), one, rod.slide[j] / far, band)
    for c in range(len(contacts)):
        k = int(contacts[c, 0])
        normal = contacts[c, 1:3]
        deep = contacts[c, 3] - normal[0] * x[k] - normal[1] * x[k + 1]
        if deep > 0:
            gradient[k] -= CONTACT * deep * normal[0]
            gradient[k + 1] -= CONTACT * deep * normal[1]
            band[k, 0] += CONTACT * normal[0] ** 2
            band[k + 1, 0] += CONTACT * normal[1] ** 2
            band[k + 1, 1] += CONTACT * normal[0] * normal[1]


@compiled
def solve_band(band: Array, b: Array) -> None:
    """Cholesky's solution in place; rows hold the diagonal and what is left of it."""
    n = len(b)
    for i in range(n):
        for j in range(max(0, i - BAND + 1), i + 1):
            total = band[i, i - j]
            for k in range(max(0, i - BAND + 1, j - BAND + 1), j):
                total -= band[i, i - k] * band[j, j - k]
            band[i, i - j] = np.sqrt(total) if i == j else total / band[j, 0]
    for i in range(n):
        for k in range(max(0, i - BAND + 1), i):
            b[i] -= band[i, i - k] * b[k]
        b[i] /= band[i, 0]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, min(n, i + BAND)):
            b[i] -= band[k, k - i] * b[k]
        b[i] /= band[i, 0]


@compiled
def advance(
    rod: Rod, x: Array, speed: Array, push: Array, contacts: Array, step: float
) -> tuple[int, float]:
    """One step, in place; Newton steps, and what is left of the balance of forces."""
    n, d = len(rod.dof) - 1, len(x)
    start, points, bent, angles = (
        np.empty((n + 1, 2)),
        np.empty((n + 1, 2)),
        np.empty(n),
        np.empty(n),
    )
    place(rod, x, start)
    bends(rod, start, bent)
    given = Step(x + step * speed, push, start, bent, contacts, step, points, angles)
    now = given.ahead.copy()
    gradient, band, trial = np.empty(d), np.empty((d, BAND)), np.empty(d)
    if potential(rod, x, given) < potential(rod, now, given):
        now[:] = x
    energy, left, count = potential(rod, now, given), np.inf, 0
    while count < MOST_NEWTON_STEPS:
        derivatives(rod, now, given, gradient, band)
        left = np.abs(gradient).max()
        if left < FORCE_TOLERANCE:
            break
        count += 1
        way = -gradient
        solve_band(band, way)
        share, better = 1.0, False
        for _ in range(12):
            trial[:] = now + share * way
            after = potential(rod, trial, given)
            if after <= energy + 1e-4 * share * (gradient @ way):
                better = True
                break
            share *= 0.4
        if not better:
            break
        now[:], energy = trial, after
    speed[:] = (now - x) / step
    x[:] = now
    return count, left


@compiled
def nearest_on(a: Array, b: Array, p: Array) -> Array:
    """Place on a segment that is nearest to a point."""
    x, y = b[0] - a[0], b[1] - a[1]
    share = ((p[0] - a[0]) * x + (p[1] - a[1]) * y) / max(x * x + y * y, 1e-300)
    share = min(max(share, 0.0), 1.0)
    return np.array((a[0] + share * x, a[1] + share * y))


@compiled
def are_crossing(a: Array, b: Array, p: Array, q: Array) -> bool:
    """Whether two segments cross."""
    d, e = b - a, q - p
    sides = (d[0] * (p - a)[1] - d[1] * (p - a)[0]) * (d[0] * (q - a)[1] - d[1] * (q - a)[0])
    others = (e[0] * (a - p)[1] - e[1] * (a - p)[0]) * (e[0] * (b - p)[1] - e[1] * (b - p)[0])
    return bool(sides < 0 and others < 0)


@compiled
def _cable_on_itself(places: Array, gap: float) -> list[tuple[int, int]]:
    """Points whose segments touch though they are no neighbours."""
    found = [(0, 0) for _ in range(0)]
    n, apart = len(places), 2 * PARTS
    reach = 1.02 * np.hypot(places[1, 0] - places[0, 0], places[1, 1] - places[0, 1])
    for a in range(n - 1):
        b = a + apart
        while b < n - 1:
            far = np.hypot(places[a, 0] - places[b, 0], places[a, 1] - places[b, 1])
            if far < 2.2 * reach:
                near = nearest_on(places[b], places[b + 1], places[a])
                d = np.hypot(near[0] - places[a, 0], near[1] - places[a, 1])
                cross = are_crossing(places[a], places[a + 1], places[b], places[b + 1])
                if d < gap or cross:
                    found.append((a, b))
                b += 1
            else:
                b += max(1, int((far - 2.2 * reach) / reach))
    return found


@compiled
def is_near_discs(at: Array, discs: Array, apart: float) -> bool:
    """Whether any of some points is nearer to a disc x, y, radius than that."""
    for c in range(len(discs)):
        for j in range(len(at)):
            if np.hypot(at[j, 0] - discs[c, 0], at[j, 1] - discs[c, 1]) < discs[c, 2] + apart:
                return True
    return False


@compiled
def is_near_walls(at: Array, walls: Array, apart: float) -> bool:
    """Whether any of some points is nearer to a wall than that."""
    for e in range(len(walls)):
        for j in range(len(at)):
            off = nearest_on(walls[e, :2], walls[e, 2:], at[j]) - at[j]
            if off @ off < apart * apart:
                return True
    return False


@compiled
def is_near_itself(places: Array, bodies: Array, held: Any, thick: float, radius: float) -> bool:
    """Whether a vehicle may touch another one or cable, or the cable itself."""
    near = PARTS * (int(np.ceil(radius / 0.1)) + 2)
    for m in range(len(bodies)):
        own = np.array([[bodies[m, 0], bodies[m, 1], radius]])
        first, last = PARTS * held[m] - near, PARTS * held[m] + near + 1
        if is_near_discs(bodies[:m], own, radius):
            return True
        if is_near_discs(places[: max(first, 0)], own, thick):
            return True
        if is_near_discs(places[last:], own, thick):
            return True
    return len(_cable_on_itself(places, 2 * thick)) > 0


class OtherCablePlant:
    """Behind `TowingWorld` in place of `CablePlant`.

    Parameters
    ----------
    world : TowingWorldModel
    angles : ndarray, shape (N,)
    step : float, optional
    truth : CableTruth, optional
    """

    def __init__(
        self,
        world: TowingWorldModel,
        angles: Array,
        *,
        step: float = TIME_STEP,
        truth: CableTruth | None = None,
    ) -> None:
        truth = truth or CableTruth()
        self.step, self._world, cable = step, world, world.cable
        assert cable.root is not None
        self._n, size = cable.links * PARTS, cable.link_length / PARTS
        dof, lever = np.full(self._n + 1, -1), np.full(self._n + 1, np.nan)
        held_of = {
            j: link for link in cable.held for j in range(link * PARTS, (link + 1) * PARTS + 1)
        }
        count, self._vehicle_dof = 0, np.empty((len(cable.held), 3), int)
        for j in range(1, self._n + 1):
            if j not in held_of:
                dof[j], count = count, count + 2
                continue
            far = (held_of[j] + 1) * PARTS
            if j == held_of[j] * PARTS:
                self._vehicle_dof[cable.held.index(held_of[j])] = count + np.arange(3)
                count += 3
            dof[j], lever[j] = count - 3, (far - j) * size
        point_mass = cable.link_mass / PARTS
        mass, slide = np.full(count, point_mass), np.zeros(self._n + 1)
        for j in range(self._n):  # half of each segment that lies on the floor to either end
            if dof[j] != dof[j + 1] or dof[j] < 0:
                slide[j : j + 2] += truth.friction * cable.friction * point_mass * 9.81 / 2
        body = world.vehicle
        turning = body.mass * body.body_radius**2 / 2 + cable.link_mass * cable.link_length**2 / 3
        mass[self._vehicle_dof] = (body.mass + cable.link_mass,) * 2 + (turning,)
        self._rod = Rod(
            dof,
            lever,
            np.array(cable.root, float),
            size,
            truth.stiffness * cable.stiffness * PARTS,
            cable.damping * PARTS,
            truth.curvature * size,
            slide,
            mass,
        )
        self._x, self._speed, self._count = np.empty(count), np.zeros(count), 0
        headings, line = cable.headings(angles), cable.points(angles)
        for j in range(1, self._n + 1):
            link = (j - 1) // PARTS
            share = (j - link * PARTS) / PARTS
            if lever[j] != lever[j]:
                self._x[dof[j] : dof[j] + 2] = line[link] + share * (line[link + 1] - line[link])
        for m, link in enumerate(cable.held):
            self._x[self._vehicle_dof[m]] = (*line[link + 1], headings[link])
        self._passers = np.array([(*p.waypoints[0], p.radius) for p in world.passers_by])
        self._passers = self._passers.reshape(-1, 3)
        self._edges = [
            (f"wall {edge}" if which == 0 else f"pillar {which}, side {edge}", a, b)
            for which, ring in enumerate(world.walls)
            for edge, (a, b) in enumerate(zip(ring, np.roll(ring, -1, axis=0), strict=True), 1)
        ]
        self._walls = np.array([(*a, *b) for _, a, b in self._edges]).reshape(-1, 4)
        self._contacts, self._pairs = np.zeros((0, 4)), set[tuple[str, str]]()
        self.worst_left, self.newton_steps = 0.0, 0
        """Newton: largest error of a balance of forces; and Newton steps so far."""

    @property
    def poses(self) -> Array:
        """Of the vehicles, shape (n, 3)."""
        return self._x[self._vehicle_dof]

    @property
    def speeds(self) -> Array:
        """Of the vehicles, shape (n, 3)."""
        return self._speed[self._vehicle_dof]

    @property
    def points(self) -> Array:
        """The root and the far end of each link, metres, shape (N + 1, 3)."""
        every = self._places()[::PARTS]
        return np.column_stack((every, np.zeros(len(every))))

    @property
    def headings(self) -> Array:
        """Of the links, shape (N,)."""
        steps = np.diff(self._places()[::PARTS], axis=0)
        return np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))

    @property
    def touching_pairs(self) -> set[tuple[str, str]]:
        """What touches what, by name, as it was last looked for."""
        return self._pairs

    def place_passer_by(self, which: int, at: Array) -> None:
        """Put a passer-by somewhere."""
        self._passers[which, :2] = at

    def advance(self, forces: Array) -> None:
        """Go on by one step with the wheels' forces, shape (n, 3)."""
        if self._count % LOOK_STEPS == 0:
            self._look_for_contacts()
        self._count += 1
        push = np.zeros(len(self._x))
        push[self._vehicle_dof] = forces
        steps, left = advance(self._rod, self._x, self._speed, push, self._contacts, self.step)
        self.newton_steps += steps + 1
        self.worst_left = max(self.worst_left, left)
        if not np.isfinite(self._x).all():
            raise VehicleFault("the other cable diverged")

    def _places(self) -> Array:
        points = np.empty((self._n + 1, 2))
        place(self._rod, self._x, points)
        return points

    def _look_for_contacts(self) -> None:
        """Find what touches what, and what is pushed back."""
        places, world = self._places(), self._world
        cable, radius, free = world.cable, world.vehicle.body_radius, world.exempt_links
        bodies, held, thick = self.poses[:, :2], np.array(cable.held), cable.radius
        inner = places[PARTS * free + 1 : len(places) - PARTS * free]
        if not (
            is_near_discs(places, self._passers, thick)
            or is_near_discs(bodies, self._passers, radius)
            or is_near_walls(inner, self._walls, thick)
            or is_near_walls(bodies[:-1], self._walls, radius)
            or is_near_itself(places, bodies, held, thick, radius)
        ):
            self._pairs, self._contacts = set(), np.zeros((0, 4))
            return
        pairs, contacts = set[tuple[str, str]](), list[tuple[float, ...]]()
        of_point = np.clip((np.arange(self._n + 1) - 1) // PARTS, 0, cable.links - 1)
        may_meet_wall = (of_point >= world.exempt_links) & (
            of_point < cable.links - world.exempt_links
        )

        def touch(name: str, at: Array, gap: Array, who: list[tuple[str, int]]) -> None:
            for k in np.flatnonzero(gap < 0):
                pairs.add((min(who[k][0], name), max(who[k][0], name)))
                place_of, dof = places_of[k], who[k][1]
                away = place_of - at[k]
                normal = away / max(np.hypot(*away), 1e-9)
                if dof >= 0:
                    contacts.append((dof, *normal, normal @ self._x[dof : dof + 2] - gap[k]))

        links = [(f"link {of_point[j]}", int(self._rod.dof[j])) for j in range(self._n + 1)]
        vehicles = [(f"vehicle {m + 1}", int(d[0])) for m, d in enumerate(self._vehicle_dof)]
        for name, a, b in self._edges:
            d = (b - a) / np.hypot(*(b - a))
            for who, places_of, size in (
                (
                    [one for one, f in zip(links, may_meet_wall, strict=True) if f],
                    places[may_meet_wall],
                    cable.radius,
                ),
                (vehicles[:-1], bodies[:-1], radius),
            ):
                share = np.clip((places_of - a) @ d, 0, np.hypot(*(b - a)))
                at = a + share[:, None] * d
                touch(name, at, np.hypot(*(places_of - at).T) - size, who)
        for number, (x, y, size) in enumerate(self._passers, 1):
            for who, places_of, own in ((links, places, cable.radius), (vehicles, bodies, radius)):
                at = np.tile((x, y), (len(places_of), 1))
                touch(f"passer-by {number}", at, np.hypot(*(places_of - at).T) - size - own, who)
        for m, (name, _) in enumerate(vehicles):
            others = np.array([k != m for k in range(len(vehicles))])
            places_of, at = bodies[others], np.tile(bodies[m], (len(vehicles) - 1, 1))
            gap = np.hypot(*(places_of - at).T) - 2 * radius
            touch(name, at, gap, [one for one, o in zip(vehicles, others, strict=True) if o])
            near = int(np.ceil(radius / cable.link_length)) + 1
            away = np.abs(of_point - cable.held[m]) > near
            gap = np.hypot(*(places[away] - bodies[m]).T) - radius - cable.radius
            places_of, at = places[away], np.tile(bodies[m], (int(away.sum()), 1))
            touch(name, at, gap, [one for one, o in zip(links, away, strict=True) if o])
        for a, b in _cable_on_itself(places, 2 * cable.radius):
            pairs.add((min(links[a][0], links[b][0]), max(links[a][0], links[b][0])))
        self._pairs = pairs
        self._contacts = np.array(contacts, dtype=np.float64).reshape(-1, 4)


@contextmanager
def other_cable(truth: CableTruth | None = None) -> Iterator[None]:
    """Let simulated worlds have this plant."""
    with patch("tjscan.vehicle.cable.world.CablePlant", partial(OtherCablePlant, truth=truth)):
        yield
