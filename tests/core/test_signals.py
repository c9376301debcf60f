"""A program that is ended closes what is open, as after Ctrl-C."""

from __future__ import annotations

import os
import signal

import pytest

from tjscan.core.signals import exit_on_termination


@pytest.mark.skipif(os.name == "nt", reason="Windows ends a program without a signal")
def test_what_is_open_is_closed_when_a_program_is_ended() -> None:
    before, closed = signal.getsignal(signal.SIGTERM), []
    with pytest.raises(SystemExit) as ended, exit_on_termination():  # noqa: PT012
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            signal.pause()
        finally:
            closed.append(True)
    assert ended.value.code == 128 + signal.SIGTERM
    assert closed
    assert signal.getsignal(signal.SIGTERM) is before
