"""What each colour stands for, in every picture."""

from __future__ import annotations

from typing import Final

STEEL: Final = "#9aa5b1"
LASER: Final = "#2f7ed8"
ROOT: Final = "#d62728"
CORNER: Final = "#1b1b1b"
PATH: Final = "#2ca02c"
