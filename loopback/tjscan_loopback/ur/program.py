"""A program that the controller runs: its script, compiled, with the words it may use."""

from __future__ import annotations

from tjscan_loopback.ur.urscript.compile import compile_program
from tjscan_loopback.ur.urscript.controller_words import ControllerWords
from tjscan_loopback.ur.urscript.geometry import CALCULATION_WORDS
from tjscan_loopback.ur.urscript.host import ScriptHost
from tjscan_loopback.ur.urscript.machine import ScriptMachine
from tjscan_loopback.ur.urscript.motion_words import MotionWords


class RunningProgram:
    """Program under way.

    Parameters
    ----------
    script : str
        URScript: the client library's control script, or any other.
    host : ScriptHost
        The controller that runs it.

    Raises
    ------
    ScriptError
        If it is no URScript. A word that this controller lacks ends the program when it is met.
    """

    def __init__(self, script: str, host: ScriptHost) -> None:
        program = compile_program(script)
        moves = MotionWords(host, lambda: self._machine.current)
        self.runs_beside = program.beside
        """Whether it runs beside another program, and may not move the arm."""
        words = CALCULATION_WORDS | ControllerWords(host).words()
        self._machine = ScriptMachine(
            program, words if self.runs_beside else words | moves.words(), moves.thread_ended
        )

    def run_tick(self) -> bool:
        """Run it until it waits; returns whether it goes on. Raises ScriptError if it can't."""
        return self._machine.run_tick()

    def end(self) -> None:
        """End it."""
        self._machine.end()
