"""The weave swings as far as it says, and dwells as long."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.bead_segments import weave_swing
from tjscan.crawler.plan import PassSegment, PassSettings


def test_a_pass_without_segments_is_one_row_that_holds_everywhere() -> None:
    one = PassSettings(offset=2e-3, speed=6e-3)
    here = one.table.at(np.array([-1.0, 0.0, 7.0]))
    np.testing.assert_array_equal(here.offset, 2e-3)
    np.testing.assert_array_equal(here.speed, 6e-3)
    assert np.isnan(here.feed).all()


def test_between_rows_all_is_linear_and_beyond_them_it_stays() -> None:
    rows = (
        PassSegment(s=0.1, speed=4e-3, offset=-1e-3, height=-8e-3, weave=0.0, feed=0.15),
        PassSegment(s=0.2, speed=6e-3, offset=1e-3, height=-6e-3, weave=2e-3, feed=0.17),
    )
    here = PassSettings(segments=rows).table.at(np.array([0.0, 0.1, 0.15, 0.3]))
    np.testing.assert_allclose(here.speed, (4e-3, 4e-3, 5e-3, 6e-3))
    np.testing.assert_allclose(here.offset, (-1e-3, -1e-3, 0, 1e-3), atol=1e-12)
    np.testing.assert_allclose(here.weave, (0, 0, 1e-3, 2e-3), atol=1e-12)
    np.testing.assert_allclose(here.feed, (0.15, 0.15, 0.16, 0.17))
    alone = PassSettings(segments=rows).table.at(np.array(0.15))
    assert float(alone.speed) == pytest.approx(5e-3)


def test_rows_that_contradict_are_refused() -> None:
    first, second = PassSegment(s=0.1), PassSegment(s=0.2)
    for rows in ((first, first), (second, first, second)):
        with pytest.raises(ValueError, match="in their order"):
            PassSettings(segments=rows)
    with pytest.raises(ValueError, match="no other"):
        PassSettings(segments=(first, second), offset=1e-3)


@given(
    period=st.floats(0.5, 10.0),
    share=st.floats(0.0, 0.9),
)
def test_a_weave_is_symmetric_and_dwells(period: float, share: float) -> None:
    path = weave_swing(np.arange(4000) * period / 4000, period, share * period / 2)
    assert abs(path[0]) < 1e-9
    assert path.max() == pytest.approx(1, rel=5e-3)
    np.testing.assert_allclose(path[2000:], -path[:2000], atol=1e-9)
    at_end = np.mean(path > 1 - 1e-9)
    assert at_end == pytest.approx(share / 2, abs=2e-3)


def test_dwells_that_leave_no_time_are_refused() -> None:
    with pytest.raises(ValueError, match="weave_period_s"):
        PassSettings(weave=1e-3, weave_period=1.0, dwell=0.5)
