"""Newton steps with few equality constraints: Cholesky, made convex where it must be."""

from __future__ import annotations

from math import sqrt

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.compiled import compiled


@compiled
def factorise_shifted(matrix: Array, shift: float, factor: Array) -> bool:
    """Cholesky factor of a matrix with a shift added to its diagonal; False if there is none."""
    for i in range(len(matrix)):
        for j in range(i):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = total / factor[j, j]
        total = matrix[i, i] + shift
        for k in range(i):
            total -= factor[i, k] * factor[i, k]
        if not total > 1e-12 * abs(matrix[i, i]) + 1e-14:
            return False
        factor[i, i] = sqrt(total)
    return True


@compiled
def factorise_convex(matrix: Array, shift: float, factor: Array, least: float) -> float:
    """Factorise with the least shift of a few tried, none or `least` on, and return it."""
    if factorise_shifted(matrix, 0.0, factor):
        return 0.0
    shift = max(0.25 * shift, least)
    while not factorise_shifted(matrix, shift, factor):
        shift *= 4.0
    return shift


@compiled
def back_substitute(factor: Array, b: Array) -> None:
    """Solve for the vector in place."""
    n = len(b)
    for i in range(n):
        total = b[i]
        for k in range(i):
            total -= factor[i, k] * b[k]
        b[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        b[i] /= factor[i, i]
        for k in range(i):
            b[k] -= factor[i, k] * b[i]


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
    meet_constraints(rows, solved, c, step, multipliers)


@compiled
def meet_constraints(rows: Array, solved: Array, c: Array, step: Array, multipliers: Array) -> None:
    """Change a step d of H d = -g to one that meets A d = -c, with the rows of A solved by H."""
    n, m = len(step), len(c)
    if m == 0:
        return
    schur = np.zeros((m, m))
    right = np.zeros(m)
    trace = 0.0
    for e in range(m):
        for f in range(m):
            for i in range(n):
                schur[e, f] += rows[e, i] * solved[f, i]
        trace += schur[e, e]
        right[e] = c[e]
        for i in range(n):
            right[e] += rows[e, i] * step[i]
    for e in range(m):
        schur[e, e] += 1e-13 * trace
    multipliers[:] = np.linalg.solve(schur, right)
    for e in range(m):
        for i in range(n):
            step[i] -= solved[e, i] * multipliers[e]


@compiled
def least_squares_multipliers(rows: Array, gradient: Array, multipliers: Array) -> float:
    """Multipliers that leave least of the Lagrangian's gradient; its largest entry is returned."""
    m = len(multipliers)
    if m > 0:
        gram = rows @ rows.T
        trace = 0.0
        for e in range(m):
            trace += gram[e, e]
        for e in range(m):
            gram[e, e] += 1e-13 * trace
        multipliers[:] = -np.linalg.solve(gram, rows @ gradient)
    residual = 0.0
    for i in range(len(gradient)):
        at = gradient[i]
        for e in range(m):
            at += rows[e, i] * multipliers[e]
        residual = max(residual, abs(at))
    return residual


@compiled
def add_constraint_squares(rows: Array, matrix: Array) -> float:
    """Add the constraints' rows to the lower triangle, A'A times a weight that is returned.

    That leaves the step what it is, as A d is fixed, and makes convex what can be: the Hessian
    then needs to be convex only along the constraints.
    """
    weight, level = 0.0, 1e-300
    for i in range(len(matrix)):
        weight += 10.0 * abs(matrix[i, i])
    for e in range(len(rows)):
        for i in range(len(matrix)):
            level += rows[e, i] * rows[e, i]
    weight /= level
    for e in range(len(rows)):
        for i in range(len(matrix)):
            by = weight * rows[e, i]
            for j in range(i + 1):
                matrix[i, j] += by * rows[e, j]
    return weight
