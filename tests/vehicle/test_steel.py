"""Where there is steel, and what proximity sensors read of it."""

from math import inf, isinf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.vehicle.simulated_body import ProximitySensors, ProximitySettings, SteelArea

PLATE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
HOOK = ((0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 2.0), (3.0, 2.0), (3.0, 3.0), (0, 3))


@given(st.floats(-0.1, 3.1), st.floats(-0.1, 3.1))
def test_a_polygon_holds_what_lies_in_its_parts(x: float, y: float) -> None:
    inside = 0 < x < 3 and 0 < y < 3 and not (x >= 1 and 1 <= y <= 2)
    near = min(abs(a - b) for a in (x, y) for b in (0, 1, 2, 3)) < 1e-6
    assert near or SteelArea(HOOK).covers_points(np.array([(x, y)]))[0] == inside


def test_a_surface_without_an_outline_never_ends() -> None:
    assert SteelArea().covers_points(np.array([(1e6, -1e6)])).all()


@pytest.mark.parametrize(
    ("x", "y", "heading", "off"),
    [
        (0.0, 0.0, 0.0, ()),
        (0.7, 0.0, 0.0, (0, 1)),  # front over the edge
        (0.7, 0.0, np.pi, (2, 3)),  # rear
        (0.0, 0.8, 0.0, (1, 3)),  # y is to the right
        (0.0, 0.7, np.pi / 2, (0, 1)),  # a heading of a quarter turn looks along y
        (0.5, 0.65, np.pi / 4, (1,)),
    ],
)
def test_the_corner_over_the_edge_sees_nothing(
    x: float, y: float, heading: float, off: tuple[int, ...]
) -> None:
    sensors = ProximitySensors(ProximitySettings(), SteelArea(PLATE), 1)
    read = sensors.read(np.array((x, y, heading)), arc_burning=False)
    assert tuple(i for i, distance in enumerate(read) if isinf(distance)) == off
    assert all(abs(d - 0.03) < 2e-3 for d in read if d < inf)


def test_readings_are_irregular_while_the_arc_burns_and_only_then() -> None:
    sensors = ProximitySensors(ProximitySettings(irregular=0.02), SteelArea(PLATE), 1)
    for burning in (False, True):
        read = np.array([sensors.read(np.zeros(3), arc_burning=burning) for _ in range(2000)])
        odd = np.mean(np.abs(read - 0.03) > 2e-3)
        assert (0.015 < odd < 0.025) if burning else odd == 0
