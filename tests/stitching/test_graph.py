"""Laws of stations placed by their overlaps alone."""

import numpy as np
import pytest

from tjscan.core.frames import Array, inverse_pose
from tjscan.core.pose_vector import pose_from_vector
from tjscan.stitching.graph import overlap_gap, spanning_tree_poses
from tjscan.stitching.registration import StationRegistration
from tjscan.stitching.stations import AzimuthArc, StationOverlap

EXACT = 1e-9


def registration(first: int, second: int, T: Array, sigma: float) -> StationRegistration:
    """An overlap with nothing but a pose and its uncertainty."""
    nothing, flags = np.zeros((1, 6)), np.ones(1, dtype=bool)
    return StationRegistration(
        StationOverlap(first, second, AzimuthArc(0.0, 0.3), (3, 3)),
        T,
        np.diag(np.repeat((sigma**2, 0.0), 3)),
        np.array((0.3, 0.1, 0.2)),
        np.array((0.0, 1.0, 0.0)),
        1.0,
        np.zeros(1),
        nothing,
        flags,
        flags,
        np.zeros(1, dtype=np.intp),
        np.zeros((1, 6, 11, 3)),
    )


def poses(count: int, seed: int) -> list[Array]:
    """Where stations stand; the first one at the identity."""
    rng = np.random.default_rng(seed)
    return [np.eye(4), *(pose_from_vector(0.1 * v) for v in rng.standard_normal((count - 1, 6)))]


@pytest.mark.parametrize("seed", range(5))
def test_overlaps_that_agree_place_every_station(seed: int) -> None:
    rng, truth = np.random.default_rng(seed), poses(6, seed)
    pairs = [(0, 3), (1, 3), (1, 5), (2, 4), (4, 5), (0, 2), (0, 1)]
    edges = [
        registration(a, b, inverse_pose(truth[a]) @ truth[b], rng.uniform(1e-5, 1e-3))
        for a, b in pairs
    ]
    T, closing = spanning_tree_poses(6, edges)
    np.testing.assert_allclose(T, truth, atol=EXACT)
    assert len(closing) == len(pairs) - 5
    assert max(overlap_gap(edge, T) for edge in closing) < EXACT


def test_the_surest_overlaps_place_and_the_others_close() -> None:
    truth, wrong = poses(3, 1), pose_from_vector((1e-3, 0, 0, 0, 0, 0))
    sure = [
        registration(a, b, inverse_pose(truth[a]) @ truth[b], 1e-5) for a, b in ((0, 1), (1, 2))
    ]
    loose = registration(0, 2, wrong @ truth[2], 1e-3)
    T, closing = spanning_tree_poses(3, [loose, *sure])
    np.testing.assert_allclose(T, truth, atol=EXACT)
    assert closing == [loose]
    assert overlap_gap(loose, T) == pytest.approx(1e-3, rel=0.1)


def test_of_two_overlaps_of_the_same_stations_the_surer_one_places() -> None:
    """As two stations that share both ends of their arcs."""
    truth = poses(2, 2)
    sure = registration(0, 1, truth[1], 1e-5)
    loose = registration(0, 1, pose_from_vector((1e-3, 0, 0, 0, 0, 0)) @ truth[1], 1e-4)
    T, closing = spanning_tree_poses(2, [loose, sure])
    np.testing.assert_allclose(T, truth, atol=EXACT)
    assert closing == [loose]
