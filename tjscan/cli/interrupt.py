"""Ctrl-C: once a scan ends after the section under way, twice the arm is stopped at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from threading import Thread
from typing import Final

from tjscan.cli.output.console import print_message
from tjscan.core.signals import enable_ctrl_c, handle_ctrl_c, interrupt_main_thread
from tjscan.scanning.stopping import StopRequest

INTERRUPT_EXIT_CODE: Final = 130
"""Exit code of a program that was interrupted: 128 and the number of the signal."""


@contextmanager
def stop_request_on_ctrl_c() -> Iterator[StopRequest]:
    """While the block runs, Ctrl-C asks a scan to stop by the request that is yielded.

    Outside a scan, and from the third time on, Ctrl-C interrupts as ever. A handler of signals
    must wait for nothing, and writing or stopping an arm may wait: a thread of its own does that.
    """
    request, pressed = StopRequest(), SimpleQueue[bool]()
    times = 0

    def handle() -> None:
        nonlocal times
        if not request.scan_is_running or times == 2:
            raise KeyboardInterrupt
        times += 1
        pressed.put(True)

    listener = Thread(target=_stop_scan_on_presses, args=(request, pressed), daemon=True)
    listener.start()
    try:
        with handle_ctrl_c(handle):
            yield request
    finally:
        pressed.put(False)
        listener.join()


def _stop_scan_on_presses(request: StopRequest, pressed: SimpleQueue[bool]) -> None:
    if not pressed.get():
        return
    request.request_stop_after_section()
    print_message("stopping after the section under way; Ctrl-C again stops the arm at once")
    if pressed.get():
        request.request_stop_now()


def ctrl_c_presser() -> Callable[[], None]:
    """Return what does the same as Ctrl-C from another thread, and let it be heard.

    A program that a script started in the background hears no Ctrl-C; a Stop on its page must
    stop it all the same.
    """
    enable_ctrl_c()
    return interrupt_main_thread
