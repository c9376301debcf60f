"""The program's version, as files and the command line state it."""

from __future__ import annotations

from typing import Final

PROGRAM_VERSION: Final = "0.1.0"
