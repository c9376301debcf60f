"""URScript in pieces: numbers, texts, names, operators."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final


class ScriptError(Exception):
    """What is wrong in a program, and in which line; the program ends.

    Parameters
    ----------
    message : str
        What is wrong.
    line : int
        Counted from 1; 0 if it is in no line.
    """

    def __init__(self, message: str, line: int = 0) -> None:
        self.message, self.line = message, line
        super().__init__(f"line {line}: {message}" if line else message)


@dataclass(frozen=True, slots=True)
class Token:
    """A piece of a program.

    Parameters
    ----------
    kind : str
        number, text, pose (the beginning of one, ``p[``), name or sign; end after the last.
    text : str
        As it is written there.
    line : int
        Counted from 1.
    """

    kind: str
    text: str
    line: int


_TOKEN_PATTERN: Final = re.compile(
    r"""
    (?P<space>[ \t\r]+|\#[^\n]*)
  | (?P<newline>\n)
  | (?P<number>0x[0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
  | (?P<text>"[^"\n]*"|'[^'\n]*')
  | (?P<pose>p\[)
  | (?P<name>[A-Za-z_]\w*)
  | (?P<sign>==|!=|<=|>=|[-+*/%<>=()\[\],:])
    """,
    re.VERBOSE | re.ASCII,
)


def split_into_tokens(script: str) -> list[Token]:
    """Split a program into its tokens, one of kind ``end`` at last.

    Raises
    ------
    ScriptError
        If a character is none of the language.
    """
    tokens, line, at = [], 1, 0
    while at < len(script):
        found = _TOKEN_PATTERN.match(script, at)
        if found is None:
            raise ScriptError(f"{script[at]!r} is no URScript", line)
        kind = str(found.lastgroup)
        if kind == "newline":
            line += 1
        elif kind != "space":
            tokens.append(Token(kind, found[0], line))
        at = found.end()
    return [*tokens, Token("end", "", line)]
