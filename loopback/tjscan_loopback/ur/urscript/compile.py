"""From the text of a URScript program to Python generators, one for each function and thread.

A line break means no more than a space does, but behind ``return``: the client library's own
control script breaks lines behind a sign. Names reach Python only as texts.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from tjscan_loopback.ur.urscript.tokens import ScriptError, Token, split_into_tokens
from tjscan_loopback.ur.urscript.values import Pose

Run = Generator[None, None, Any]
"""A function under way: it yields once a tick while it waits."""

DEEPEST_NESTING: Final = 40
"""Blocks and brackets within each other."""

LARGEST_NUMBER: Final = 1e300

POSE_VALUES: Final = 6
"""Numbers of a pose."""

_COMPARISON_SIGNS: Final = ("==", "!=", "<", ">", "<=", ">=")
_BLOCK_ENDS: Final = ("end", "elif", "else")
_RESERVED_WORDS: Final = (
    *_BLOCK_ENDS,
    *("def", "sec", "thread", "global", "local", "if", "while", "return", "break", "continue"),
    *("run", "kill", "join", "enter_critical", "exit_critical", "halt", "pass"),
    *("and", "or", "xor", "not", "True", "False"),
)


@dataclass(frozen=True, slots=True)
class Function:
    """Function or thread of a program.

    Parameters
    ----------
    parameters : tuple of str
        Their names.
    run : callable
        Runs it in a frame, see `machine`.
    """

    parameters: tuple[str, ...]
    run: Callable[[Any, Any], Run]


@dataclass(frozen=True, slots=True)
class CompiledProgram:
    """A program: its name, and its functions by theirs; ``""`` is the program itself.

    Parameters
    ----------
    name : str
        As it follows ``def``; empty for a single line.
    beside : bool
        Whether it runs beside the program that runs already: ``sec`` in place of ``def``.
    functions : mapping
        Functions and threads by name.
    """

    name: str
    beside: bool
    functions: Mapping[str, Function]


def compile_program(script: str) -> CompiledProgram:
    """Compile a program.

    Parameters
    ----------
    script : str
        ``def NAME(): ... end``, the same with ``sec``, or statements outside of any.

    Raises
    ------
    ScriptError
        If it is no URScript.
    """
    try:
        return _Compiler(split_into_tokens(script)).program()
    except (SyntaxError, RecursionError, MemoryError):
        raise ScriptError("the program is nested too deep") from None


class _Compiler:
    """Recursive descent over the tokens; writes Python lines as it goes."""

    def __init__(self, tokens: list[Token]) -> None:
        self._tokens, self._at = tokens, 0
        self._lines: list[str] = []
        self._depth = self._nested = 0
        self._functions: dict[str, Function] = {}

    def program(self) -> CompiledProgram:
        name, beside = "", False
        if self._next.text in ("def", "sec"):
            beside = self._take().text == "sec"
            name = self._name()
            self._parameters()
            self._function("", ())
        else:
            self._function("", (), until="")
        if self._next.kind != "end":
            raise ScriptError(f"{self._next.text!r} behind the end of the program", self._next.line)
        return CompiledProgram(name, beside, self._functions)

    # Statements

    def _function(self, name: str, parameters: tuple[str, ...], until: str = "end") -> None:
        outer, self._lines = (self._lines, self._depth), ["def run(c, s):"]
        self._depth = 1
        self._write("if False: yield")
        while self._next.text != until or self._next.kind == "text":
            self._statement()
        if until:
            self._take()
        found: dict[str, Any] = {"__builtins__": {}, "Pose": Pose}
        exec(compile("\n".join(self._lines), f"<{name or 'program'}>", "exec"), found)
        self._functions[name] = Function(parameters, found["run"])
        self._lines, self._depth = outer

    def _block(self) -> None:
        self._expect(":")
        self._depth += 1
        if self._depth > DEEPEST_NESTING:
            raise ScriptError("the program is nested too deep", self._next.line)
        self._write("pass")
        while self._next.text not in _BLOCK_ENDS:
            self._statement()
        self._depth -= 1

    def _statement(self) -> None:
        token = self._next
        if token.kind == "end":
            raise ScriptError("the program breaks off: an 'end' is missing", token.line)
        if token.text in ("def", "thread"):
            self._take()
            name = self._name()
            self._function(name, self._parameters())
            return
        self._write(f"c.at({token.line})")
        writers: dict[str, Callable[[], None]] = {
            "if": self._if,
            "while": self._while,
            "return": self._return,
            "global": self._declaration,
            "local": self._declaration,
            "break": self._word,
            "continue": self._word,
            "pass": self._word,
            "enter_critical": self._nothing,
            "exit_critical": self._nothing,
            "halt": lambda: self._simple("c.halt()"),
            "kill": lambda: self._of_thread("c.kill({})"),
            "join": lambda: self._of_thread("yield from c.join({})"),
        }
        if token.kind == "name" and token.text in writers:
            writers[token.text]()
        elif token.kind == "pose" or self._after(1).text in ("=", "["):
            self._assignment("s")
        else:
            self._write(self._expression())

    def _if(self) -> None:
        self._take()
        self._write(f"if c.truth({self._expression()}):")
        self._block()
        while self._next.text == "elif":
            self._take()
            self._write(f"elif c.truth({self._expression()}):")
            self._block()
        if self._next.text == "else":
            self._take()
            self._write("else:")
            self._block()
        self._expect("end")

    def _while(self) -> None:
        line = self._take().line
        # A loop counts as a step each time, however empty it is.
        self._write(f"while c.at({line}) or c.truth({self._expression()}):")
        self._block()
        self._expect("end")

    def _return(self) -> None:
        line = self._take().line
        is_bare = self._next.line != line or self._next.text in _BLOCK_ENDS
        self._write("return None" if is_bare else f"return {self._expression()}")

    def _declaration(self) -> None:
        self._assignment(f"s.{self._take().text}s")

    def _assignment(self, where: str) -> None:
        if self._next.kind == "pose":  # the beginning of a pose, or an item of a variable named p
            self._tokens[self._at : self._at + 1] = [
                Token(kind, text, self._next.line) for kind, text in (("name", "p"), ("sign", "["))
            ]
        name = self._name()
        if self._next.text == "[":
            self._take()
            index = self._expression()
            self._expect("]")
            self._expect("=")
            self._write(f"s[{name!r}] = c.with_item(s[{name!r}], {index}, {self._expression()})")
        else:
            self._expect("=")
            self._write(f"{where}[{name!r}] = {self._expression()}")

    def _word(self) -> None:
        self._write(self._take().text)

    def _nothing(self) -> None:
        self._take()  # threads change turns at their waits alone: all between is critical

    def _simple(self, python: str) -> None:
        self._take()
        self._write(python)

    def _of_thread(self, python: str) -> None:
        self._take()
        self._write(python.format(self._expression()))

    # Expressions: each returns Python

    def _expression(self) -> str:
        self._nested += 1
        if self._nested > DEEPEST_NESTING:
            raise ScriptError("the program is nested too deep", self._next.line)
        left = self._conjunction()
        while self._next.text in ("or", "xor"):
            sign = "or" if self._take().text == "or" else "!="
            left = f"(c.truth({left}) {sign} c.truth({self._conjunction()}))"
        self._nested -= 1
        return left

    def _conjunction(self) -> str:
        left = self._negation()
        while self._next.text == "and":
            self._take()
            left = f"(c.truth({left}) and c.truth({self._negation()}))"
        return left

    def _negation(self) -> str:
        if self._next.text == "not":
            self._take()
            return f"(not c.truth({self._negation()}))"
        return self._operation(0)

    def _operation(self, level: int) -> str:
        signs = (_COMPARISON_SIGNS, ("+", "-"), ("*", "/", "%"))
        if level == len(signs):
            return self._signed()
        left = self._operation(level + 1)
        while self._next.kind == "sign" and self._next.text in signs[level]:
            sign = self._take().text
            left = f"c.calculate({sign!r}, {left}, {self._operation(level + 1)})"
        return left

    def _signed(self) -> str:
        if self._next.text in ("-", "+"):
            sign = self._take().text
            return f"c.calculate({sign!r}, 0, {self._signed()})"
        value = self._primary()
        while self._next.text == "[":
            self._take()
            value = self._items(value, self._values("]"))
        return value

    def _items(self, value: str, indices: list[str]) -> str:
        """An item of a list; of a matrix, with two indices."""
        for index in indices:
            value = f"c.item({value}, {index})"
        return value

    def _primary(self) -> str:
        token = self._take()
        if token.kind == "number":
            return repr(_number(token))
        if token.kind == "text":
            return repr(token.text[1:-1])
        if token.kind == "pose":
            values = self._values("]")
            if len(values) < POSE_VALUES:  # no pose, but an item of a variable named p
                return self._items("s['p']", values)
            return f"Pose(({', '.join(values)},))"
        if token.text == "[":
            return f"({''.join(value + ', ' for value in self._values(']'))})"
        if token.text == "(":
            value = self._expression()
            self._expect(")")
            return value
        if token.text in ("True", "False"):
            return token.text
        if token.text == "run":
            name = self._name()
            self._expect("(")
            return f"c.run({name!r}, [{', '.join(self._values(')'))}])"
        if token.kind == "name" and token.text not in _RESERVED_WORDS:
            return self._call(token.text) if self._next.text == "(" else f"s[{token.text!r}]"
        raise ScriptError(f"a value is wanted (found {token.text!r})", token.line)

    def _call(self, name: str) -> str:
        self._take()
        given, named = [], []
        while self._next.text != ")":
            if self._next.kind == "name" and self._after(1).text == "=":
                word = self._name()
                self._take()
                named.append(f"{word!r}: {self._expression()}")
            else:
                given.append(self._expression())
            if self._next.text != ")":
                self._expect(",")
        self._take()
        named_ = f", {{{', '.join(named)}}}" if named else ""
        return f"(yield from c.call({name!r}, [{', '.join(given)}]{named_}))"

    def _values(self, end: str) -> list[str]:
        values = []
        while self._next.text != end:
            values.append(self._expression())
            if self._next.text != end:
                self._expect(",")
        self._take()
        return values

    # Tokens

    @property
    def _next(self) -> Token:
        return self._tokens[self._at]

    def _after(self, count: int) -> Token:
        return self._tokens[min(self._at + count, len(self._tokens) - 1)]

    def _take(self) -> Token:
        token = self._next
        if token.kind != "end":
            self._at += 1
        return token

    def _expect(self, text: str) -> None:
        token = self._take()
        if token.text != text or token.kind == "text":
            raise ScriptError(f"{text!r} is wanted (found {token.text!r})", token.line)

    def _name(self) -> str:
        token = self._take()
        if token.kind != "name" or token.text in _RESERVED_WORDS:
            raise ScriptError(f"a name is wanted (found {token.text!r})", token.line)
        return token.text

    def _parameters(self) -> tuple[str, ...]:
        self._expect("(")
        names = []
        while self._next.text != ")":
            names.append(self._name())
            if self._next.text != ")":
                self._expect(",")
        self._take()
        self._expect(":")
        return tuple(names)

    def _write(self, python: str) -> None:
        self._lines.append("    " * self._depth + python)


def _number(token: Token) -> int | float:
    if token.text[:2] == "0x":
        return int(token.text, 16)
    value = int(token.text) if token.text.isdigit() else float(token.text)
    if abs(value) > LARGEST_NUMBER:
        raise ScriptError(f"{token.text} is too large", token.line)
    return value
