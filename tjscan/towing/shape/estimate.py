"""The cable's shape now, from the vehicles' poses: that of least energy.

Suzuki et al. (2022), IV-C, take the poses for exact, (1)-(4). Noise or slip then stretch the cable
between two vehicles beyond its length, and no shape fits: here poses are known to a standard
deviation. The paper leaves the floor out; here friction holds the links, so that the cable keeps
what it was bent to on its way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians, sqrt
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import chain_gradient, chain_hessian, place_links, wrapped
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.linear import back_substitute, factorise_convex

SLIDES = 1e-3
"""Metres by which a link gives way before it slides. As long as this is little beside the bends of
a cable, it says nothing: from 0.2 to 2 mm estimates are the same."""

LEAST_SHIFT = 0.1
"""Share of a joint's stiffness that is added first where the energy is not convex. Poses are held
1e8 times as stiffly as joints: a share of that would freeze the shape, and end the search."""


@compiled
def estimate_terms(
    angles: Array,
    links: Array,
    held: Indices,
    poses: Array,
    stiff: Array,
    rest: Array,
    slide: Array,
    joint: Array,
    point: Array,
    turn: Array,
) -> float:
    """Energy of the cable over that of a joint's stiffness, and what each joint and link has in it.

    Parameters
    ----------
    angles : ndarray, shape (N,)
    links : ndarray, shape (N, 5)
    held : ndarray of int, shape (M,)
        Links whose poses, shape (M, 3), are known.
    stiff : ndarray, shape (M, 2)
        One over the variance of each position, and of each heading.
    rest : ndarray, shape (N, 2)
        Towards which the floor holds the links' far ends: with a force that grows until they slide.
    slide : ndarray, shape (N,)
        Friction there over the stiffness of a joint, 1/m; 0 without.
    joint, point, turn : ndarray, shapes (N, 2), (N, 5), (N, 2)
        Filled.
    """
    energy = 0.0
    for i in range(len(angles)):
        energy += 0.5 * angles[i] * angles[i]
        joint[i, 0], joint[i, 1] = angles[i], 1.0
        turn[i, 0], turn[i, 1] = 0.0, 0.0
        point[i, :] = 0.0
        if slide[i] > 0.0:
            x, y = links[i, 0] - rest[i, 0], links[i, 1] - rest[i, 1]
            d = sqrt(x * x + y * y)
            slides = d > (1.0 + 1e-9) * SLIDES  # one that slid is held there again
            pull = slide[i] / max(d, SLIDES)
            energy += slide[i] * (d - 0.5 * SLIDES if slides else 0.5 * d * d / SLIDES)
            point[i, 0], point[i, 1] = pull * x, pull * y
            point[i, 2], point[i, 4] = pull, pull
            if slides:
                point[i, 2] -= pull * (x / d) ** 2
                point[i, 3] -= pull * (x / d) * (y / d)
                point[i, 4] -= pull * (y / d) ** 2
    for m in range(len(held)):
        k = held[m]
        x, y = links[k, 0] - poses[m, 0], links[k, 1] - poses[m, 1]
        a = wrapped(links[k, 2] - poses[m, 2])
        by_place, by_turn = stiff[m, 0], stiff[m, 1]
        energy += 0.5 * by_place * (x * x + y * y) + 0.5 * by_turn * a * a
        point[k, 0] += by_place * x
        point[k, 1] += by_place * y
        point[k, 2] += by_place
        point[k, 4] += by_place
        turn[k, 0], turn[k, 1] = by_turn * a, by_turn
    return energy


@compiled
def newton_estimate(
    angles: Array,
    root: Array,
    length: float,
    held: Indices,
    poses: Array,
    stiff: Array,
    rest: Array,
    slide: Array,
    most: int,
) -> tuple[int, float]:
    """Shape of least energy near the vehicles' poses, in place; iterations and the energy."""
    n = len(angles)
    links = np.empty((n, 5))
    joint, point, turn = np.empty((n, 2)), np.empty((n, 5)), np.empty((n, 2))
    gradient, step, trial = np.empty(n), np.empty(n), np.empty(n)
    hessian, factor = np.empty((n, n)), np.zeros((n, n))
    place_links(angles, root, length, links)
    energy = estimate_terms(angles, links, held, poses, stiff, rest, slide, joint, point, turn)
    shift, iteration = 0.0, 0
    while iteration < most:
        iteration += 1
        chain_gradient(joint, point, turn, links, length, gradient)
        chain_hessian(joint, point, turn, links, length, hessian)
        shift = factorise_convex(hessian, shift, factor, LEAST_SHIFT)
        step[:] = -gradient
        back_substitute(factor, step)
        slope, longest = 0.0, 0.0
        for i in range(n):
            slope += gradient[i] * step[i]
            longest = max(longest, abs(step[i]))
        share = min(1.0, 0.5 / max(longest, 1e-300))
        after, better = energy, False
        for _ in range(30):
            for i in range(n):
                trial[i] = angles[i] + share * step[i]
            place_links(trial, root, length, links)
            after = estimate_terms(
                trial, links, held, poses, stiff, rest, slide, joint, point, turn
            )
            if after <= energy + 1e-4 * share * slope + 1e-12 * abs(energy):
                better = True
                break
            share *= 0.5
        if not better:
            break
        angles[:] = trial
        energy = after
        if -slope < 1e-8 * (1.0 + energy):
            break
    return iteration, energy


MOST: Final = 60
"""Iterations; warm ones need fewer than ten."""

BULGES: Final = (-0.3, 0.0, 0.3)
"""Sideways, in chords between vehicles, where a search begins that knows no shape before."""


@dataclass(frozen=True, slots=True)
class PoseTrust:
    """How well the vehicles' poses are known.

    Parameters
    ----------
    position_sd : float
        Of x and of y, metres.
    heading_sd : float
        Radians.
    """

    position_sd: float = 3e-3
    heading_sd: float = radians(1.0)

    @property
    def stiffness(self) -> Array:
        """One over the variances, as `estimate_terms` takes them."""
        return np.array((self.position_sd**-2, self.heading_sd**-2))


@dataclass(frozen=True, slots=True, eq=False)
class CableEstimate:
    """How the cable lies.

    Parameters
    ----------
    angles : ndarray, shape (N,)
        Of the joints, radians: θ_init.
    rest : ndarray, shape (N, 2)
        Towards which the floor holds the links' far ends, metres.
    """

    angles: Array
    rest: Array

    @staticmethod
    def unpulled(cable: Cable, angles: Array) -> CableEstimate:
        """A cable that was laid down so: the floor does not yet pull at it."""
        return CableEstimate(angles, cable.poses(angles)[:, :2].copy())


def estimate_shape(
    cable: Cable,
    held_links: Sequence[int],
    poses: Array,
    *,
    last: CableEstimate | None = None,
    trust: PoseTrust | None = None,
) -> CableEstimate:
    """How the cable lies between vehicles at these poses.

    The links between were moved from where they lay by least work, of bends and friction: that is
    Coulomb's, for a floor that gives way by `SLIDES` first. So its holding force lasts from one
    estimate to the next, however little a link moves.

    Parameters
    ----------
    cable : Cable
    held_links : sequence of int
        Of the vehicles, which carry these links off the floor.
    poses : ndarray, shape (vehicles, 3)
        Of the held links: x, y, metres, and heading, radians; rows of NaN are unknown.
    last : CableEstimate, optional
        The estimate before. Without, the floor is left out.
    trust : PoseTrust, optional
    """
    known = np.isfinite(poses).all(axis=1)
    held, at = np.array(held_links, dtype=np.int64)[known], np.array(poses[known], dtype=float)
    root = np.array(cable.root, dtype=float)
    stiff = np.tile((trust or PoseTrust()).stiffness, (len(held), 1))
    if last is None:
        starts, rest = _guesses(cable, held, at), np.zeros((cable.links, 2))
        slide = np.zeros(cable.links)
    else:
        starts, rest, slide = [last.angles], last.rest, friction_at_ends(cable, held_links)
    best, least = np.zeros(cable.links), np.inf
    for start in starts:
        angles = np.array(start, dtype=float)
        most = MOST if last is not None else 10 * MOST
        _, energy = newton_estimate(
            angles, root, cable.link_length, held, at, stiff, rest, slide, most
        )
        if energy < least:
            best, least = angles, energy
    if last is None:
        return CableEstimate.unpulled(cable, best)
    lie = cable.poses(best)[:, :2]
    off = lie - rest
    far = np.hypot(off[:, 0], off[:, 1])[:, None]
    return CableEstimate(best, lie - off * np.minimum(1.0, SLIDES / np.maximum(far, 1e-300)))


def friction_at_ends(cable: Cable, held_links: Sequence[int]) -> Array:
    """Friction at the links' far ends over a joint's stiffness, shape (N,), 1/m."""
    # Half of the link on either side, where that lies on the floor.
    lies = np.ones(cable.links + 1)
    lies[list(held_links)] = lies[-1] = 0.0
    return np.asarray((lies[:-1] + lies[1:]) / 2 * cable.friction / cable.bending_stiffness)


def _guesses(cable: Cable, held: Indices, poses: Array) -> list[Array]:
    """Shapes through the poses as cubic curves, with bulges to either side."""
    knots = np.vstack((np.array(cable.root), poses))
    guesses = []
    for bulge in BULGES:
        headings = np.empty(cable.links)
        first = 0
        for a, b, link in zip(knots, knots[1:], held, strict=False):
            t = (np.arange(first, link + 1) - first + 0.5) / (link + 1 - first)
            chord = b[:2] - a[:2]
            size = cable.link_length * (link + 1 - first)
            aside = bulge * np.array((-chord[1], chord[0]))
            tangent = [size * np.array((np.cos(k[2]), np.sin(k[2]))) for k in (a, b)]
            slope = (
                np.outer(6 * t - 6 * t**2, chord)
                + np.outer(1 - 4 * t + 3 * t**2, tangent[0])
                + np.outer(3 * t**2 - 2 * t, tangent[1])
                + np.outer(np.pi * np.cos(np.pi * t), aside)
            )
            headings[first : link + 1] = np.arctan2(slope[:, 1], slope[:, 0])
            first = link + 1
        headings[first:] = headings[first - 1] if first else cable.root[2]
        guesses.append(cable.angles(np.unwrap(np.concatenate(([cable.root[2]], headings)))[1:]))
    return guesses
