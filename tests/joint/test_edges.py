from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.joint.edges import ClosedPolyline, JointGrooveSections, feature_edges
from tjscan.joint.file import read_joint
from tjscan.joint.geometry import cylindrical_to_j

PAPER = Path(__file__).parents[2] / "cad" / "tjoint-600x457.toml"
EXACT = 1e-12

SQUARE = ClosedPolyline(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float))


def by_brute_force(line: ClosedPolyline, points: Array) -> Array:
    a = line.points_j
    along = np.roll(a, -1, axis=0) - a
    share = np.einsum("mnk,nk->mn", points[:, None] - a, along) / np.sum(along**2, axis=1)
    feet = a + np.clip(share, 0, 1)[..., None] * along
    return np.asarray(np.linalg.norm(points[:, None] - feet, axis=2).min(axis=1))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 60), st.floats(0.01, 10))
def test_distance_is_exact_even_where_no_vertex_is_near(seed: int, n: int, reach: float) -> None:
    rng = np.random.default_rng(seed)
    line = ClosedPolyline(rng.normal(size=(n, 3)))
    points = reach * rng.normal(size=(20, 3))
    np.testing.assert_allclose(line.distances(points), by_brute_force(line, points), atol=EXACT)


def test_the_last_vertex_is_joined_to_the_first() -> None:
    points = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.1, 0.2], [2, 2, 0]])
    np.testing.assert_allclose(
        SQUARE.distances(points), (0.5, 0.5, np.hypot(0.1, 0.2), np.sqrt(2)), atol=EXACT
    )
    np.testing.assert_allclose(SQUARE.nearest_points(points)[0], (0, 0.5, 0), atol=EXACT)


def test_no_points_have_no_distances() -> None:
    assert SQUARE.distances(np.empty((0, 3))).shape == (0,)


def test_true_points_of_an_edge_lie_on_it() -> None:
    """Between vertices, too: the chords are short enough."""
    joint = read_joint(PAPER)
    edges = feature_edges(joint)
    phi = np.random.default_rng(3).uniform(0, 2 * np.pi, 500)
    s = JointGrooveSections(joint, phi)
    for rz, line in ((s.p2, edges.p2), (s.p3, edges.p3), (s.p4, edges.p4)):
        assert line.distances(cylindrical_to_j(phi, rz[:, 0], rz[:, 1])).max() < 1e-6


def test_distances_tell_the_edges_apart() -> None:
    edges = feature_edges(read_joint(PAPER))
    on_p3 = edges.p3.points_j[::100]
    distances = edges.distances(on_p3)
    assert distances.shape == (36, 3)
    np.testing.assert_allclose(distances[:, 1], 0, atol=EXACT)
    assert distances[:, [0, 2]].min() > 4e-3
    np.testing.assert_allclose(edges.distances(on_p3).min(axis=1), 0, atol=EXACT)


def test_a_point_off_the_edge_is_as_far_as_it_was_moved() -> None:
    joint = read_joint(PAPER)
    p2 = feature_edges(joint).p2
    lifted = p2.points_j[::50] * (1.001, 1.001, 1.0)
    moved = 0.001 * joint.brace_radius
    assert p2.distances(lifted) == pytest.approx(moved, rel=1e-4)


def test_arrays_are_read_only() -> None:
    edges = feature_edges(read_joint(PAPER), n=10)
    assert edges.p2.points_j.shape == (10, 3)
    for array in (edges.phi, edges.p2.points_j):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
