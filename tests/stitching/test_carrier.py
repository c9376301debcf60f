"""Stations that a carrier went between: laws of its statement beside overlaps and tubes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_stations import exact_station
from free_stations import joint_named

from tjscan.core import pose_vector
from tjscan.core.errors import StitchingRefused
from tjscan.core.frames import Array, inverse_pose
from tjscan.joint.tubes.fit import ArmRepeatability
from tjscan.stitching.graph import CarriedFrames
from tjscan.stitching.stations import Station
from tjscan.stitching.stitch import StitchedGroove

ENDS = {"left": (-15.0, 195.0), "right": (167.0, 377.0)}


def carried(
    sigma: tuple[float, float] | None, off: Array | None = None, seed: int = 0
) -> list[Station]:
    """Two stations whose carrier says where they truly are, but for `off` of the second."""
    stations = []
    for name, ends in ENDS.items():
        azimuths = np.radians(np.arange(ends[0], ends[1] + 1e-9, 10.0))
        joint = joint_named("tjoint-600x457")
        station, T_j_b = exact_station(joint, name, azimuths, seed=seed, arm=ArmRepeatability())
        T_w_b = T_j_b if off is None or name == "left" else pose_vector.boxplus(T_j_b, off)
        stations.append(replace(station, T_w_b=T_w_b, carrier_sigma=sigma))
    return stations


def on_first(groove: StitchedGroove) -> Array:
    """The second station's base on the first one's."""
    first, second = (one.T_j_b for one in groove.stations)
    return inverse_pose(first) @ second


@pytest.mark.parametrize("seed", range(3))
def test_an_exact_carrier_holds_the_stations(seed: int) -> None:
    stations = carried((0.0, 0.0), seed=seed)
    groove = StitchedGroove(stations)
    said = inverse_pose(stations[0].T_w_b) @ stations[1].T_w_b
    np.testing.assert_allclose(on_first(groove), said, atol=1e-5)
    free = StitchedGroove(carried(None, seed=seed))
    for held, loose in zip(groove.stations, free.stations, strict=True):
        assert np.trace(held.covariance) < np.trace(loose.covariance)


def test_a_carrier_that_knows_nothing_changes_nothing() -> None:
    free, loose = StitchedGroove(carried(None)), StitchedGroove(carried((10.0, 5.0)))
    np.testing.assert_allclose(on_first(loose), on_first(free), atol=1e-7)
    for one, other in zip(loose.stations, free.stations, strict=True):
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-3, atol=1e-15)


@pytest.mark.parametrize("off", [(2e-3, 0, 0, 0, 0, 0), (0, 0, 0, 0, 3e-3, 0)])
def test_a_carrier_that_overlaps_contradict_is_an_alarm_and_no_weight(
    off: tuple[float, ...],
) -> None:
    with pytest.raises(StitchingRefused, match="carrier and overlaps disagree") as caught:
        StitchedGroove(carried((1e-4, 1e-4), np.array(off)))
    assert "right" in str(caught.value)
    StitchedGroove(carried((3e-3, 3e-3), np.array(off)))  # as uncertain as it is off


def test_a_turn_about_the_base_moves_the_far_groove() -> None:
    """As draws of the base's error have it."""
    stations, sigma = carried((3e-4, 1e-3)), (3e-4, 1e-3)
    bases = [one.T_w_b for one in stations]
    own = [inverse_pose(base) for base in bases]  # both found j where it is
    said = CarriedFrames.of_bases(bases, own, [sigma, sigma])
    np.testing.assert_allclose(said.T, [np.eye(4)] * 2, atol=1e-9)
    dice, drawn = np.random.default_rng(1), []
    for _ in range(4000):
        error = np.repeat(sigma, 3) / np.sqrt(3) * dice.standard_normal(6)
        T = pose_vector.boxplus(bases[1], error) @ own[1]
        drawn.append(pose_vector.pose_to_vector(T))
    spread = np.cov(np.array(drawn).T)
    whole = np.linalg.solve(said.covariances[1], spread)
    np.testing.assert_allclose(np.linalg.eigvals(whole), 1.0, atol=0.15)
