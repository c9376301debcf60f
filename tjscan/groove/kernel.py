"""The loops over a profile's points, compiled, where they are built.

`_kernel.c` holds them; it needs a C compiler at installation. Without it, or with the variable
`WITHOUT_KERNEL` in the environment, NumPy does the same, more slowly.
"""

from __future__ import annotations

import os
from importlib import import_module
from types import ModuleType
from typing import Final

KERNEL_VERSION: Final = 7
"""Rises with every change of what the compiled loops take and give: sources that were updated may
lie beside loops that were not built again."""

WITHOUT_KERNEL: Final = "TJSCAN_WITHOUT_KERNEL"
"""Set to anything but nothing, it keeps the compiled loops out."""


def load_kernel() -> ModuleType | None:
    """The compiled loops; None where they were not built, of another version, or switched off."""
    if os.environ.get(WITHOUT_KERNEL):
        return None
    try:
        found = import_module("tjscan.groove._kernel")
    except ImportError:
        return None
    return found if getattr(found, "KERNEL_VERSION", 0) == KERNEL_VERSION else None


compiled: ModuleType | None = load_kernel()
"""The compiled loops; None where NumPy does them."""
