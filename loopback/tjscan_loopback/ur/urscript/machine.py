"""Runs a compiled program tick by tick: its frames, its threads, its calls."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from tjscan_loopback.ur.urscript.compile import CompiledProgram, Run
from tjscan_loopback.ur.urscript.tokens import ScriptError
from tjscan_loopback.ur.urscript.values import calculate, item, truth, with_item

MOST_STEPS: Final = 20_000
"""Statements that a program may run through in a tick without a wait."""

MOST_THREADS: Final = 100
MOST_CALLS: Final = 50
"""Functions that call each other."""

Word = Callable[..., Any]
"""A function of the language; one that waits is a generator that yields once a tick."""


class ProgramHalted(Exception):
    """The program has reached ``halt``."""


@dataclass(slots=True)
class Frame:
    """Variables that a function sees: its own and the program's.

    Parameters
    ----------
    globals, locals : dict
        By name.
    """

    globals: dict[str, Any]
    locals: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Any:
        for place in (self.locals, self.globals):
            if name in place:
                return place[name]
        raise ScriptError(f"there is no variable {name}")

    def __setitem__(self, name: str, value: Any) -> None:
        """Change the variable of that name, its own before the program's; its own if it is new."""
        is_global = name not in self.locals and name in self.globals
        (self.globals if is_global else self.locals)[name] = value


class ScriptMachine:
    """Machine that runs one program.

    Parameters
    ----------
    program : CompiledProgram
        The program.
    words : mapping
        The functions of the language, by name.
    thread_ended : callable
        Receives the number of each thread that ends or is killed.
    """

    def __init__(
        self,
        program: CompiledProgram,
        words: Mapping[str, Word],
        thread_ended: Callable[[int], object],
    ) -> None:
        self._program, self._words, self._thread_ended = program, words, thread_ended
        self._globals: dict[str, Any] = {}
        self._threads: dict[int, Run] = {}
        self._calls: dict[int, int] = {}
        self._count = self._steps = self._line = self.current = 0
        self.calculate, self.item, self.with_item, self.truth = calculate, item, with_item, truth
        self.run("", [])

    def run_tick(self) -> bool:
        """Run each thread to its next wait; returns whether the program goes on.

        Raises
        ------
        ScriptError
            If the program can't go on; it names the line.
        """
        self._steps = 0
        try:
            for number in list(self._threads):
                if number in self._threads:  # and not killed by one before
                    self._resume(number)
        except ProgramHalted:
            return False
        except ScriptError as error:
            raise ScriptError(error.message, error.line or self._line) from None
        except (ArithmeticError, ValueError, TypeError, LookupError, RecursionError) as error:
            raise ScriptError(f"{type(error).__name__}: {error}", self._line) from None
        return 1 in self._threads  # the program itself

    def end(self) -> None:
        """End all threads."""
        for number, thread in list(self._threads.items()):
            if number != self.current:  # which ends the program, and itself with it
                thread.close()
        self._threads.clear()

    def _resume(self, number: int) -> None:
        self.current = number
        try:
            next(self._threads[number])
        except StopIteration:
            self._forget(number)

    def _forget(self, number: int) -> None:
        del self._threads[number], self._calls[number]
        self._thread_ended(number)

    # What compiled functions ask of it

    def at(self, line: int) -> bool:
        """Note the line that is run; raises ScriptError if a tick never ends."""
        self._line = line
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise ScriptError("the program runs without a wait: a loop lacks sync() or sleep()")
        return False

    def call(self, name: str, given: Sequence[Any], named: Mapping[str, Any] = {}) -> Run:
        """Call a function of the program or a word of the language; raises ScriptError if none."""
        function = self._program.functions.get(name)
        if function is not None:
            if len(given) != len(function.parameters) or named:
                raise ScriptError(f"{name} takes {len(function.parameters)} values")
            number = self.current
            self._calls[number] += 1
            if self._calls[number] > MOST_CALLS:
                raise ScriptError(f"{name} calls itself for ever")
            frame = Frame(self._globals, dict(zip(function.parameters, given, strict=True)))
            result = yield from function.run(self, frame)
            self._calls[number] -= 1
            return result
        word = self._words.get(name)
        if word is None:
            raise ScriptError(f"this controller has no {name}")
        line = self._line
        try:
            result = word(*given, **named)
        except TypeError as error:
            raise ScriptError(f"{name}: {error}") from None
        if isinstance(result, Generator):
            result = yield from self._waiting(result, line)
        return result

    def run(self, name: str, given: Sequence[Any]) -> int:
        """Begin a thread; returns its number, which is never zero."""
        function = self._program.functions.get(name)
        if function is None or len(given) != len(function.parameters):
            raise ScriptError(f"there is no thread {name} of {len(given)} values")
        if len(self._threads) >= MOST_THREADS:
            raise ScriptError("the program runs too many threads")
        self._count += 1
        frame = Frame(self._globals, dict(zip(function.parameters, given, strict=True)))
        self._threads[self._count] = function.run(self, frame)
        self._calls[self._count] = 0
        return self._count

    def kill(self, number: Any) -> None:
        """End a thread, if it still runs."""
        thread = self._threads.get(number)
        if thread is None:
            return
        if number == self.current:
            raise ScriptError("a thread can't kill itself")
        thread.close()
        self._forget(number)

    def join(self, number: Any) -> Iterator[None]:
        """Wait for a thread's end."""
        while number in self._threads:
            yield

    def halt(self) -> None:
        """End the program."""
        raise ProgramHalted

    def _waiting(self, word: Run, line: int) -> Run:
        """Wait for a word, as the line that it is in."""
        while True:
            self._line = line
            try:
                next(word)
            except StopIteration as ended:
                return ended.value
            yield
