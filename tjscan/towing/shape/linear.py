"""Newton steps of a chain with few equality constraints, made convex, in O(N)."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape import chain
from tjscan.towing.shape.chain import ChainDerivatives
from tjscan.towing.shape.compiled import compiled


@compiled
def factorise_shifted(
    parts: ChainDerivatives, links: Array, length: float, shift: float, factor: Array
) -> bool:
    """Factor of a chain's Hessian with a shift added to its diagonal; False if it is not convex.

    A link's end and heading follow from the link before and from its joint's turn alone.
    So joints are eliminated one by one, from the tip on, as of a linear-quadratic regulator: what
    is beyond a link depends on three numbers, its end and its heading.

    Parameters
    ----------
    parts : ChainDerivatives
    links : ndarray, shape (N, 5)
        As `place_links` fills it.
    length : float
        Of a link, metres.
    shift : float
    factor : ndarray, shape (N, 6)
        Filled: the turn of a joint by x, y and heading of the link before, its pivot, and how its
        link's end goes as it turns.
    """
    sums = chain.NO_HESSIAN_SUMS
    for i in range(len(factor) - 1, -1, -1):
        sums = chain.add_link_to_hessian(i, parts, links, length, sums)
        sx, sy, xx, xy, yy, xt, yt, tt = sums
        own = parts.joint[i, 1] + shift
        pivot = own + tt
        if not pivot > 1e-12 * (abs(own) + abs(tt)) + 1e-14:
            return False
        factor[i, 0], factor[i, 1], factor[i, 2] = xt / pivot, yt / pivot, tt / pivot
        factor[i, 3] = pivot
        factor[i, 4], factor[i, 5] = -length * links[i, 4], length * links[i, 3]
        xx, xy, yy = xx - xt * factor[i, 0], xy - xt * factor[i, 1], yy - yt * factor[i, 1]
        left = own / pivot  # of the last three; as of `xx`, but exact if `tt` is far above `own`
        sums = sx, sy, xx, xy, yy, left * xt, left * yt, left * tt
    return True


@compiled
def factorise_convex(
    parts: ChainDerivatives, links: Array, length: float, shift: float, factor: Array, least: float
) -> float:
    """Factorise with the least shift of a few tried, none or `least` on, and return it."""
    if factorise_shifted(parts, links, length, 0.0, factor):
        return 0.0
    shift = max(0.25 * shift, least)
    while not factorise_shifted(parts, links, length, shift, factor):
        shift *= 4.0
    return shift


@compiled
def back_substitute(factor: Array, b: Array) -> None:
    """Solve for the vector in place."""
    x, y, turn = 0.0, 0.0, 0.0
    for i in range(len(b) - 1, -1, -1):
        turn += factor[i, 4] * x + factor[i, 5] * y
        left = b[i] - turn
        x += factor[i, 0] * left
        y += factor[i, 1] * left
        turn += factor[i, 2] * left
        b[i] = left / factor[i, 3]
    x, y, turn = 0.0, 0.0, 0.0
    for i in range(len(b)):
        b[i] -= factor[i, 0] * x + factor[i, 1] * y + factor[i, 2] * turn
        turn += b[i]
        x += factor[i, 4] * turn
        y += factor[i, 5] * turn


@compiled
def back_substitute_rows(factor: Array, rows: Array) -> None:
    """Solve for each row in place."""
    for e in range(len(rows)):
        back_substitute(factor, rows[e])


@compiled
def constrained_step(
    factor: Array, rows: Array, gradient: Array, c: Array, step: Array, multipliers: Array
) -> None:
    """Step d and multipliers y of H d + A'y = -g, A d = -c, with the factor of H."""
    solved = rows.copy()
    back_substitute_rows(factor, solved)
    step[:] = -gradient
    back_substitute(factor, step)
    multipliers[:] = solve_schur(rows @ solved.T, c + rows @ step)
    step -= multipliers @ solved


@compiled
def solve_schur(schur: Array, missed: Array) -> Array:
    """Multipliers of rows that a step without them misses; of equal rows they are shared."""
    softness = 1e-13 * np.trace(schur) * np.eye(len(schur))
    return np.asarray(np.linalg.solve(schur + softness, missed))


@compiled
def least_squares_multipliers(rows: Array, gradient: Array, multipliers: Array) -> float:
    """Multipliers that leave least of the Lagrangian's gradient; its largest entry is returned."""
    multipliers[:] = -solve_schur(rows @ rows.T, rows @ gradient)
    return float(np.abs(gradient + multipliers @ rows).max())


@compiled
def weigh_constraint_squares(rows: Array, diagonal: Array) -> float:
    """Weight with which A'A, of the constraints' rows A, is added to a Hessian of that diagonal.

    That leaves the step what it is, as A d is fixed, and makes convex what can be: the Hessian
    then needs to be convex only along the constraints. The diagonal is the sum's afterwards.
    """
    squares = (rows * rows).sum(axis=0)
    weight = 10.0 * np.abs(diagonal).sum() / squares.sum()
    diagonal += weight * squares
    return float(weight)
