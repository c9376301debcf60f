"""A reason to wait is said once, however its figures change."""

import pytest

from tjscan.core.errors import TowHalted
from tjscan.towing.standstill import WaitingPatience, WaitingReason


def test_what_differs_in_its_figures_alone_is_said_once() -> None:
    said: list[tuple[str, str]] = []
    patience = WaitingPatience(1.0, lambda name, words: said.append((name, words)))
    for cycle, mm in enumerate(("0.8", "1", "1.05", "12")):
        patience.update(0.1 * cycle, WaitingReason(f"it ends {mm} mm short"), 0.0)
    patience.update(0.5, None, 0.0)
    assert said == [("waits", "it ends 0.8 mm short"), ("goes on", "after 0.5 s")]


def test_reasons_that_take_turns_are_said_once_each_and_another_vehicle_is_another_reason() -> None:
    said: list[str] = []
    patience = WaitingPatience(10.0, lambda name, words: said.append(words))
    reasons = ("vehicle 2 is 147 mm too near", "the pose of vehicle 2 is lost", "bent 0.3° too far")
    for cycle in range(30):
        patience.update(
            0.1 * cycle, WaitingReason(reasons[cycle % 3].replace("147", f"{cycle}")), 0.0
        )
    patience.update(3.0, WaitingReason("the pose of vehicle 4 is lost"), 0.0)
    assert said == [
        "vehicle 2 is 0 mm too near",
        *reasons[1:],
        "the pose of vehicle 4 is lost",
    ]


def test_who_waited_for_too_long_gives_up() -> None:
    patience = WaitingPatience(1.0, lambda name, words: None)
    patience.update(0.0, WaitingReason("it is held"), 0.025)
    with pytest.raises(TowHalted, match=r"it is held. The weld is halted 25 mm along"):
        patience.update(1.1, WaitingReason("it is held"), 0.025)
