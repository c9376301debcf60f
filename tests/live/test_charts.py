"""Charts of the page: the clock in one piece, profiles with equal axes and one way up."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.laser.profile import Profile
from tjscan.live.colours import scale_ticks
from tjscan.live.panel import CHART_SIZE, hours_in_one_piece, measure_chart, profile_chart
from tjscan.live.step import Measure, PlaneCurve, Sample, SceneSetup

WIDTH = Measure("root width", "mm")


def dots(path: str) -> np.ndarray:
    return np.array([[float(n) for n in pair] for pair in re.findall(r"M(\S+) (\S+?)h0", path)])


@given(st.floats(0, 12), st.floats(0.1, 10))
def test_a_scan_over_twelve_is_in_one_piece(start: float, length: float) -> None:
    hours = np.linspace(start, start + length, 30) % 12
    found = hours_in_one_piece(hours)
    assert np.ptp(found) == pytest.approx(length, abs=1e-6)
    assert np.abs((found - hours + 6) % 12 - 6).max() < 1e-6


def test_the_clock_is_numbered_as_a_clock() -> None:
    samples = [Sample(hour % 12, {WIDTH.name: 6.0}) for hour in (11.2, 11.9, 12.4, 13.1)]
    chart = measure_chart(samples, WIDTH, SceneSetup("a", (WIDTH,), "h", plot_by_clock=True))
    assert [name for _, name in chart.x_ticks if name] == ["11", "12", "1", "2"]
    places = np.sort(dots(chart.paths[-1][0])[:, 0]) * 3 / CHART_SIZE[0]
    np.testing.assert_allclose(places, (0.2, 0.9, 1.4, 2.1), atol=0.01)


def test_a_profile_has_equal_axes_and_its_brace_up() -> None:
    x = np.linspace(-0.05, 0.05, 41)
    profile = Profile(x, 0.25 + 0.1 * np.abs(x))
    for curve, (across, up) in (
        (PlaneCurve.along_groove(profile), (-profile.z_s, profile.x_s)),
        (PlaneCurve.of_profile(profile), (profile.x_s, -profile.z_s)),
    ):
        drawn = dots(profile_chart(curve).paths[0][0]) * (1, -1)
        true = 1e3 * np.column_stack((across, up))
        scale = np.ptp(drawn, axis=0) / np.ptp(true, axis=0)
        assert scale[0] == pytest.approx(scale[1], rel=0.02)
        expected = (true - true[0]) * scale.mean() + drawn[0]
        np.testing.assert_allclose(drawn, expected, atol=2.0)
        assert (np.ptp(drawn, axis=0) <= np.array(CHART_SIZE)).all()


@pytest.mark.parametrize("value", [0.0, 1e-9, -3e-7, 43.2])
def test_numbers_beside_a_single_value_are_short(value: float) -> None:
    assert max(len(f"{tick:g}") for tick in scale_ticks([value])) <= len("-0.001")


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=5))
def test_ticks_hold_all_values_evenly(values: list[float]) -> None:
    ticks = scale_ticks(values)
    step = np.diff(ticks)
    assert ticks[0] <= min(values) + 1e-6 * step[0]
    assert ticks[-1] >= max(values) - 1e-6 * step[0]
    np.testing.assert_allclose(step, step[0])
