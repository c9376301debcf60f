"""Ctrl-C at any moment leaves whole messages, all that were begun, and interrupts after them."""

import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from tjscan.core.signals import delay_ctrl_c
from tjscan.recording.journal import RecordingWriter
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import Topic


@dataclass(frozen=True)
class Number:
    n: float


TOPIC = Topic.of("/number", Number)
pytestmark = pytest.mark.usefixtures("ctrl_c_is_heard")


def interrupt_at_line(number: int) -> None:
    """Press Ctrl-C at the line of this number that runs from now on."""

    def look(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal number
        if event == "line":
            number -= 1
            if not number:
                sys.settrace(None)
                signal.raise_signal(signal.SIGINT)
        return look

    sys.settrace(look)


@pytest.mark.parametrize("line", range(1, 400, 13))
def test_what_is_written_is_whole_wherever_it_is_interrupted(tmp_path: Path, line: int) -> None:
    file = tmp_path / "numbers.mcap"
    with pytest.raises(KeyboardInterrupt), RecordingWriter(file, [TOPIC]) as recording:  # noqa: PT012
        recording.write(1, (TOPIC, Number(1.0)))
        interrupt_at_line(line)
        try:
            for n in range(2, 30):
                recording.write(n, (TOPIC, Number(float(n))), (TOPIC, Number(n + 0.5)))
        finally:
            sys.settrace(None)
            recording.write(99, (TOPIC, Number(99.0)))
    found = [entry.message.n for entry in read_messages(file, [TOPIC])]
    assert found[0] == 1.0
    assert found[-1] == 99.0
    assert found[1:-1] == [n / 2 for n in range(4, 4 + 2 * (len(found) // 2 - 1))]


def test_ctrl_c_waits_for_the_end_of_the_outermost_block() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        with delay_ctrl_c():
            with delay_ctrl_c():
                signal.raise_signal(signal.SIGINT)
                done.append("inner")
            done.append("outer")
        done.append("never")
    assert done == ["inner", "outer"]
