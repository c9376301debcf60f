"""The weave swings as far as it says, and dwells as long."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.crawler.plan import PassSettings


def test_a_stringer_bead_stays_where_it_is() -> None:
    assert PassSettings(offset=2e-3).offset_at(3.7) == 2e-3


@given(
    weave=st.floats(1e-3, 0.02),
    period=st.floats(0.5, 10.0),
    share=st.floats(0.0, 0.9),
    offset=st.floats(-0.01, 0.01),
)
def test_a_weave_is_symmetric_and_dwells(
    weave: float, period: float, share: float, offset: float
) -> None:
    one = PassSettings(weave=weave, weave_period=period, dwell=share * period / 2, offset=offset)
    times = np.arange(4000) * period / 4000
    path = np.array([one.offset_at(t) for t in times]) - offset
    assert abs(path[0]) < 1e-9
    assert path.max() == pytest.approx(weave, rel=5e-3)
    np.testing.assert_allclose(path[2000:], -path[:2000], atol=1e-9)
    at_end = np.mean(path > weave * (1 - 1e-9))
    assert at_end == pytest.approx(share / 2, abs=2e-3)


def test_dwells_that_leave_no_time_are_refused() -> None:
    with pytest.raises(ValueError, match="weave_period_s"):
        PassSettings(weave=1e-3, weave_period=1.0, dwell=0.5)
