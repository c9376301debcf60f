"""The wheel, built from a copy of the tree: what an earlier build left there would come along."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]

FILES: Final = ("pyproject.toml", "README.md", "LICENSE")
FOLDERS: Final = ("tjscan", "examples", "cad")
"""What a wheel is made from."""


def copy_sources(to: Path) -> None:
    """Copy what a wheel is made from into a new folder."""
    to.mkdir()
    for name in FILES:
        shutil.copy(ROOT / name, to)
    for name in FOLDERS:
        made = shutil.ignore_patterns("__pycache__", "*.so")
        shutil.copytree(ROOT / name, to / name, ignore=made)
