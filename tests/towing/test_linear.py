"""The factor of a chain's Hessian in O(N), against the dense matrix."""

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.towing.shape.chain import (
    ChainDerivatives,
    chain_hessian,
    chain_hessian_diagonal,
    place_links,
)
from tjscan.towing.shape.linear import back_substitute, factorise_shifted

ROOT, LENGTH = np.array((0.3, -0.2, 0.4)), 0.1


def chain_parts(links: int, seed: int, convex: bool) -> tuple[ChainDerivatives, Array, Array]:
    """Parts of a bent chain with two ends held hard, its links, and its dense Hessian."""
    rng = np.random.default_rng(seed)
    joint, point, turn = np.ones((links, 2)), np.zeros((links, 5)), np.zeros((links, 2))
    point[:, :2] = (0.0 if convex else 30.0) * rng.standard_normal((links, 2))
    for k in (links // 2, links - 1):
        point[k, 2:], turn[k, 1] = (4e6, 0.0, 4e6), 3e5
    points = np.empty((links, 5))
    place_links(0.1 * rng.standard_normal(links), ROOT, LENGTH, points)
    parts, hessian = ChainDerivatives(joint, point, turn), np.empty((links, links))
    chain_hessian(parts, points, LENGTH, hessian)
    return parts, points, hessian


@pytest.mark.parametrize("links", [2, 7, 60, 300])
def test_a_convex_chain_is_solved_as_its_dense_hessian_is(links: int) -> None:
    parts, points, hessian = chain_parts(links, links, convex=True)
    factor, shift = np.empty((links, 6)), 0.3
    assert factorise_shifted(parts, points, LENGTH, shift, factor)
    right = np.random.default_rng(1).standard_normal(links)
    solved = right.copy()
    back_substitute(factor, solved)
    expected = np.linalg.solve(hessian + shift * np.eye(links), right)
    np.testing.assert_allclose(solved, expected, atol=2e-5 * np.abs(expected).max())
    diagonal = np.empty(links)
    chain_hessian_diagonal(parts, points, LENGTH, diagonal)
    np.testing.assert_allclose(diagonal, np.diag(hessian), rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_shift_makes_it_convex_where_it_makes_the_dense_hessian_so(seed: int) -> None:
    parts, points, hessian = chain_parts(20, seed, convex=False)
    least, factor = float(np.linalg.eigvalsh(hessian).min()), np.empty((20, 6))
    assert not factorise_shifted(parts, points, LENGTH, -least - 1e-3, factor)
    assert factorise_shifted(parts, points, LENGTH, -least + 1e-3, factor)
