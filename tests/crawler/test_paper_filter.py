"""Derivatives of the paper's models, and the sign that its equation (2) has wrong."""

from math import cos, sin, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.crawler.paper_method import (
    PaperFilter,
    PaperMethod,
    PaperState,
    paper_laser_offset,
    propagate_paper_state,
)
from tjscan.crawler.slip_estimator import CrawlerGeometry
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist

states = st.tuples(
    st.floats(-0.05, 0.05),
    st.floats(-0.1, 0.1),
    st.floats(-0.03, 0.03),
    st.floats(-0.4, 0.4),
    st.floats(0.05, 0.6),
).map(np.array)


@given(states)
def test_derivatives_are_those_of_finite_differences(x: Array) -> None:
    step = 1e-6
    _, F = propagate_paper_state(x, 0.02)
    _, H = paper_laser_offset(x)
    for k, e in enumerate(np.eye(5) * step):
        slope = propagate_paper_state(x + e, 0.02)[0] - propagate_paper_state(x - e, 0.02)[0]
        np.testing.assert_allclose(F[:, k], slope / (2 * step), atol=1e-8)
        off = paper_laser_offset(x + e)[0] - paper_laser_offset(x - e)[0]
        assert H[k] == pytest.approx(off / (2 * step), abs=1e-8)


@given(states)
def test_equation_2_needs_a_plus_before_its_first_term(x: Array) -> None:
    v, w, y, heading, ahead = x.tolist()
    period = 1e-5
    before, after = (
        paper_laser_offset(propagate_paper_state(x, t)[0])[0] for t in (-period, period)
    )
    rest = v * tan(heading) + ahead * w * (1 + tan(heading) ** 2)
    first = y * w * sin(heading) / cos(heading) ** 2
    assert (after - before) / (2 * period) == pytest.approx(rest + first, abs=1e-7)


def test_it_finds_heading_and_offset_on_tracks_that_do_not_slip() -> None:
    x = np.zeros(5)
    x[PaperState.LASER_TO_CENTRE] = 0.5
    found = PaperFilter(TrackGeometry(), x, np.diag([1e-6, 1e-4, 25e-6, 4e-4, 1e-4]))
    y, heading = 5e-3, 0.015
    for _ in range(2000):
        heading += 0.01 * -1e-3
        y += 0.01 * 0.02 * sin(heading)
        found.move(Twist(0.02, -1e-3), 0.01)
        found.read(y / cos(heading) + 0.5 * tan(heading))
    assert found.x[PaperState.OFFSET] == pytest.approx(y, abs=0.3e-3)
    assert found.x[PaperState.HEADING] == pytest.approx(heading, abs=1e-3)


def test_backward_it_steers_by_the_laser_distance_that_it_starts_with() -> None:
    design, tracks = CrawlerGeometry(0.5, 0.35), TrackGeometry()
    known, wrong = PaperMethod(design, tracks), PaperMethod(design, tracks, 0.05)
    for method in (known, wrong):
        method.read(1e-3, 1e-5)
    assert known.turn_rate(0.02) == wrong.turn_rate(0.02)
    assert abs(known.turn_rate(-0.02)) != pytest.approx(abs(wrong.turn_rate(-0.02)), rel=1e-3)
