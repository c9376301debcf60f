"""A reason to wait is said once, however its figures change."""

import pytest

from tjscan.core.errors import TowHalted
from tjscan.towing.waiting import Patience, Waiting


def test_what_differs_in_its_figures_alone_is_said_once() -> None:
    said: list[tuple[str, str]] = []
    patience = Patience(1.0, lambda name, words: said.append((name, words)))
    for cycle, mm in enumerate(("0.8", "1", "1.05", "12")):
        patience.update(0.1 * cycle, Waiting(f"it ends {mm} mm short"), 0.0)
    patience.update(0.5, None, 0.0)
    assert said == [("waits", "it ends 0.8 mm short"), ("goes on", "after 0.5 s")]


def test_who_waited_for_too_long_gives_up() -> None:
    patience = Patience(1.0, lambda name, words: None)
    patience.update(0.0, Waiting("it is held"), 0.025)
    with pytest.raises(TowHalted, match=r"it is held. The weld is halted 25 mm along"):
        patience.update(1.1, Waiting("it is held"), 0.025)
