"""Stepwise scanning of the weld groove of large tubular T-joints.

>>> import tjscan
>>> scan = tjscan.scan("examples/paper.toml", "runs/first")
>>> scan.points.shape  # section, point p1 to p5, coordinate
(16, 5, 3)

Lengths are metres, angles radians; ``docs/api.md`` shows more. Nothing is loaded before it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tjscan.core.version import PROGRAM_VERSION

if TYPE_CHECKING:
    from tjscan.api import Recording, Scan, calibrate, compare, read_groove, scan

__version__ = PROGRAM_VERSION

__all__ = ["Recording", "Scan", "__version__", "calibrate", "compare", "read_groove", "scan"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from tjscan import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
