"""The client library's whole control interface against the loopback controller."""

from __future__ import annotations

import pytest
from ur_cell import address

pytest.importorskip("rtde_control")

from _ur_methods import call_every_method


def test_every_method_does_what_it_says_or_ends_the_program_by_name() -> None:
    called = call_every_method(address())
    assert len(called) > 50
    assert [one.told for one in called if not one.right] == []
    assert sum(one.refused for one in called) == 14
