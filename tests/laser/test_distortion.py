"""Errors of a sensor's own calibration."""

from __future__ import annotations

import numpy as np

from tjscan.laser.deviation import Distortion
from tjscan.laser.model import LaserModel

MODEL = LaserModel(linearity=1e-4)


def drawn(make: int) -> Distortion:
    distortion = Distortion.draw_in_window(MODEL, make)
    assert distortion is not None
    return distortion


def errors(make: int, count: int = 4000) -> np.ndarray:
    """Errors of x and z at places all over the window, shape (2, count)."""
    rng = np.random.default_rng(0)
    z = rng.uniform(MODEL.near, MODEL.far, count)
    x = rng.uniform(-1, 1, count) * (z - MODEL.emitter_z) * np.tan(MODEL.half_angle)
    x_seen, z_seen = drawn(make).distort(x, z)
    return np.array((x_seen - x, z_seen - z))


def test_no_point_is_off_by_more_than_the_linearity_and_some_nearly_are() -> None:
    for make in range(20):
        largest = np.abs(errors(make)).max()
        assert 0.5e-4 < largest <= 1.02e-4


def test_the_make_decides_and_a_model_without_errors_has_none() -> None:
    np.testing.assert_array_equal(errors(3), errors(3))
    assert (errors(3) != errors(4)).any()
    assert Distortion.draw_in_window(LaserModel(), 3) is None
    assert Distortion.draw_in_window(LaserModel.without_faults(), 3) is None
