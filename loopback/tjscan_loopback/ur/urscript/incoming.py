"""Scripts as they come over the wire: whole programs, and single lines outside of any."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from tjscan_loopback.ur.urscript.tokens import ScriptError

LONGEST_PROGRAM: Final = 2_000_000
"""Characters of a program."""

_PROGRAM_BEGIN: Final = re.compile(r"\s*(def|sec)\b")
_PROGRAM_END: Final = re.compile(r"^end[ \t\r]*\n", re.MULTILINE)


class IncomingScripts:
    """Collects the text of one client until programs are whole."""

    def __init__(self) -> None:
        self._text = ""

    def add(self, text: str) -> Iterator[str]:
        """Add text; gives the programs that are whole now.

        Raises
        ------
        ScriptError
            If a program is longer than the controller takes.
        """
        self._text += text
        while (length := self._whole()) is not None:
            script, self._text = self._text[:length], self._text[length:]
            if script.partition("#")[0].strip():
                yield script
        if len(self._text) > LONGEST_PROGRAM:
            raise ScriptError(f"a program is {LONGEST_PROGRAM} characters long at most")

    def _whole(self) -> int | None:
        """Length of the program or line that is whole; None while more must come."""
        if _PROGRAM_BEGIN.match(self._text):
            end = _PROGRAM_END.search(self._text)
            return None if end is None else end.end()
        line = self._text.find("\n")
        return None if line < 0 else line + 1
