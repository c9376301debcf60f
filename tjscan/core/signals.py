"""Signals of the operating system: Ctrl-C, and what a terminal sends; the only file that knows.

Windows knows neither SIGTTIN nor a signal that is sent to one thread.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def handle_ctrl_c(handle: Callable[[], None]) -> Iterator[None]:
    """Let Ctrl-C call a function while the block of the main thread runs.

    Parameters
    ----------
    handle : callable
        May wait for nothing; what it raises is raised in the main thread.
    """
    before = signal.signal(signal.SIGINT, lambda number, frame: handle())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def exit_on_termination() -> Iterator[None]:
    """Let SIGTERM end the program as an exit does, so that what is open is closed and written."""

    def leave(number: int, frame: object) -> None:
        raise SystemExit(128 + number)

    if threading.current_thread() is not threading.main_thread():
        yield  # signals are another one's
        return
    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def delay_ctrl_c() -> Iterator[None]:
    """Let Ctrl-C wait until the block of the main thread has ended: what it does stays whole."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield  # nothing is interrupted there
        return
    pressed = 0

    def note(number: int, frame: object) -> None:
        nonlocal pressed
        pressed += 1

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        for _ in range(pressed):
            before(signal.SIGINT, None)


def ignore_ctrl_c() -> None:
    """Leave Ctrl-C, which reaches all processes of a terminal, to the one that began the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def enable_ctrl_c() -> None:
    """Let Ctrl-C interrupt a program that a script started in the background, which hears none."""
    if signal.getsignal(signal.SIGINT) in (signal.SIG_IGN, None):
        signal.signal(signal.SIGINT, signal.default_int_handler)


def interrupt_main_thread() -> None:
    """Do what Ctrl-C does, from another thread."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


def wait_for_ctrl_c() -> None:
    """Wait until Ctrl-C raises KeyboardInterrupt in the main thread."""
    while True:
        if hasattr(signal, "pause"):
            signal.pause()
        else:
            threading.Event().wait(0.2)


def survive_background_terminal_read() -> None:
    """Let reading from the terminal of another job end at once, not stop the program."""
    if hasattr(signal, "SIGTTIN"):
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)
