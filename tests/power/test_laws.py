"""Current, feed and stick-out follow from each other."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.power.laws import ArcLaw

LAW = ArcLaw()


@given(feed=st.floats(0.05, 0.3), stick_out=st.floats(5e-3, 30e-3))
def test_current_melts_what_is_fed(feed: float, stick_out: float) -> None:
    current = LAW.current(feed, stick_out)
    melted = LAW.arc_melting * current + LAW.resistive_melting * stick_out * current**2
    assert melted == pytest.approx(feed, rel=1e-12)
    assert LAW.stick_out(feed, current) == pytest.approx(stick_out, rel=1e-9)


@pytest.mark.parametrize(("feed", "current"), [(7.0, 243.0), (9.0, 290.0), (11.0, 333.0)])
def test_currents_of_a_wire_of_1_2_mm(feed: float, current: float) -> None:
    assert LAW.current(feed / 60, 15e-3) == pytest.approx(current, abs=1.0)
