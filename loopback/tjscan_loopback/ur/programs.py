"""The programs that run on the controller: one, and others beside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tjscan_loopback.ur.program import RunningProgram
from tjscan_loopback.ur.urscript.host import ScriptHost
from tjscan_loopback.ur.urscript.tokens import ScriptError

MOST_BESIDE: Final = 10
"""Programs that may run beside another."""


class ControllerPrograms:
    """Programs under way; at most one of them moves the arm.

    Parameters
    ----------
    host : ScriptHost
        The controller that runs them.
    report_line : callable
        Receives a line for each that starts, fails or stops.
    """

    def __init__(self, host: ScriptHost, report_line: Callable[[str], None]) -> None:
        self._host, self._report_line = host, report_line
        self._main: RunningProgram | None = None
        self._beside: list[RunningProgram] = []

    @property
    def running(self) -> bool:
        """Whether there is one that may move the arm."""
        return self._main is not None

    def start_beside(self, program: RunningProgram) -> None:
        """Let a program of kind ``sec`` run; raises ScriptError if there are too many."""
        if len(self._beside) >= MOST_BESIDE:
            raise ScriptError("too many programs run beside another")
        self._beside.append(program)

    def start(self, program: RunningProgram) -> None:
        """Let a program run that may move the arm; none does."""
        self._report_line("program started")
        self._main = program

    def run_tick(self) -> bool:
        """Run each until it waits; returns whether the one that may move the arm has ended."""
        for program in tuple(self._beside):
            if not self._goes_on(program):
                self._beside.remove(program)
        return self._main is not None and not self._goes_on(self._main)

    def end(self) -> None:
        """End all of them."""
        for program in self._beside:
            program.end()
        self._beside.clear()
        if self._main is not None:
            self._main.end()
            self._report_line("program stopped")
        self._main = None

    def _goes_on(self, program: RunningProgram) -> bool:
        try:
            return program.run_tick()
        except ScriptError as error:
            self._report_line(f"program failed: {error}")
            return False
