"""The loopback controller stops by count, and takes nonsense for no answer."""

from __future__ import annotations

import numpy as np
import pytest
from command import tjscan
from hypothesis import given
from hypothesis import strategies as st
from maker_cell import KUKA
from ur_cell import address

from tjscan_loopback.kuka.controller import RsiController, parse_answer

HOME, KINEMATICS = KUKA.home, KUKA.kinematics


def controller(said: list[str], *, patience: int = 5) -> RsiController:
    return RsiController(KINEMATICS, HOME, cycle_ms=4, patience=patience, report_line=said.append)


def answer(ipoc: int, a1: float = 0.0, sen_type: str = "tjscan") -> bytes:
    axes = " ".join(f'A{i}="{a1 if i == 1 else 0}"' for i in range(1, 7))
    return f'<Sen Type="{sen_type}"><AK {axes}/><IPOC>{ipoc}</IPOC></Sen>'.encode()


def test_it_stops_once_so_many_answers_are_missing_and_counts_none_before_the_first() -> None:
    said: list[str] = []
    one = controller(said)
    for _ in range(20):
        one.end_cycle(None)
    assert one.runs
    one.end_cycle(parse_answer(answer(one.stamp)))
    for late in range(5):
        assert one.runs
        assert f'<Delay D="{late}"'.encode() in one.packet()
        one.end_cycle(None)
    assert not one.runs
    assert said == ["stopped: 5 answers were late or missing"]


def test_a_correction_faster_than_a_joint_stops_it() -> None:
    said: list[str] = []
    one = controller(said)
    fastest = float(np.degrees(KINEMATICS.velocity[0])) * 4e-3
    one.end_cycle(parse_answer(answer(one.stamp, 0.99 * fastest)))
    assert one.runs
    one.end_cycle(parse_answer(answer(one.stamp, 2.01 * fastest)))
    assert said == ["stopped: A1 is commanded too fast"]


@given(st.binary(max_size=200))
def test_nonsense_is_no_answer(data: bytes) -> None:
    assert parse_answer(data) is None


def test_an_answer_of_another_name_is_none() -> None:
    assert parse_answer(answer(12)) is not None
    assert parse_answer(answer(12, sen_type="ImFree")) is None
    assert parse_answer(answer(12, a1=float("nan"))) is None


@pytest.mark.parametrize(
    "options",
    [
        ("--host", "0.0.0.0"),
        ("--computer", "192.168.0.10:59152"),
        ("--computer", "127.0.0.1"),
        ("--cycle-ms", "5"),
        ("--model", "ur99"),
        ("--home-deg", "-90", "-60", "65", "400", "95", "75"),
    ],
)
def test_it_refuses_what_can_not_be(options: tuple[str, ...]) -> None:
    assert tjscan("kuka-loopback", "--host", address(), *options) == 2
