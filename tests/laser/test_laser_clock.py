"""From a laser's clock to the cell's: the stated uncertainty holds the truth."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.laser.genicam.messages import (
    LARGEST_CLOCK_DRIFT,
    HostInterval,
    exposure_on_cell_clock,
    host_time_of_exposure,
)

TICKS = 1_000_000_000
ROUNDING = 1e-6
"""Seconds: of ticks and of float arithmetic at large times."""


@given(
    latch_delay=st.floats(0, 0.05),
    answer_delay=st.floats(0, 0.05),
    clock_delay=st.floats(0, 0.05),
    clock_answer=st.floats(0, 0.05),
    waited=st.floats(0, 2),
    rate=st.floats(1 - LARGEST_CLOCK_DRIFT, 1 + LARGEST_CLOCK_DRIFT),
    offset=st.floats(-1e5, 1e5),
)
def test_the_true_time_lies_within_what_is_stated(
    latch_delay: float,
    answer_delay: float,
    clock_delay: float,
    clock_answer: float,
    waited: float,
    rate: float,
    offset: float,
) -> None:
    """A laser's clock that runs at another rate, and messages that take their time both ways."""
    begin = 1000.0
    read_at = begin + clock_delay
    cell_read = HostInterval(begin, read_at + clock_answer)
    latched_at = cell_read.end + latch_delay
    latch = HostInterval(cell_read.end, latched_at + answer_delay)
    exposed = latched_at + waited
    ticks = round(TICKS * rate * (exposed - latched_at))

    on_host = host_time_of_exposure(ticks, TICKS, latch)
    assert on_host.begin - ROUNDING <= exposed <= on_host.end + ROUNDING
    found, uncertainty = exposure_on_cell_clock(
        on_host.midpoint, on_host.half_length, read_at + offset, cell_read
    )
    assert abs(found - (exposed + offset)) <= uncertainty + ROUNDING


def test_a_profile_is_never_earlier_than_the_clock_that_was_read_before_it() -> None:
    cell_read, latch = HostInterval(5.0, 5.1), HostInterval(5.1, 5.4)
    on_host = host_time_of_exposure(0, TICKS, latch)
    found, uncertainty = exposure_on_cell_clock(
        on_host.midpoint, on_host.half_length, 70.0, cell_read
    )
    assert found >= 70.0
    assert uncertainty == pytest.approx(0.2)
