"""What a crawl records, read again."""

import numpy as np
import pytest

from tjscan.crawler.slip_estimator import SlipBelief
from tjscan.crawler.slip_model import STATES
from tjscan.crawler.topics import SLIP


def test_slip_is_read_as_it_was_believed() -> None:
    believed = SlipBelief(np.arange(STATES) / 7, np.eye(STATES) / 3)
    read = SLIP.decode(SLIP.encode(believed))
    np.testing.assert_array_equal(read.x, believed.x)
    np.testing.assert_array_equal(read.P, believed.P)


def test_slip_of_an_earlier_estimator_is_not_known() -> None:
    assert SLIP.decode(SLIP.encode(SlipBelief(np.zeros(8), np.eye(8)))) is None


def test_slip_that_is_damaged_is_refused() -> None:
    with pytest.raises(ValueError, match="reshape"):
        SLIP.decode(SLIP.encode(SlipBelief(np.zeros(STATES), np.eye(8))))
