"""What a groove looks like: a template of long sides and the corners between them.

Sides run from the brace's wall (or the first plate) to the leg (or the second plate). A turn is
positive in a valley and negative on a ridge, as the sensor sees it. A new groove is a new value.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final


@dataclass(frozen=True, slots=True)
class Side:
    """A long side of a groove.

    Parameters
    ----------
    name : str
        What it is called in messages.
    shortest : float
        Shortest length that still counts as seen, in metres.
    curved : bool
        Whether its cross-section may be curved.
    """

    name: str
    shortest: float
    curved: bool = False


@dataclass(frozen=True, slots=True)
class Root:
    """A narrow face that cuts a valley off, such as a root bead.

    Parameters
    ----------
    narrowest, widest : float
        Bounds of its width, in metres.
    optional : bool
        Whether the valley may also be sharp.
    """

    narrowest: float = 0.8e-3
    widest: float = 14e-3
    optional: bool = False


@dataclass(frozen=True, slots=True)
class Corner:
    """Where a long side ends and the next one begins.

    Parameters
    ----------
    least, most : float
        Bounds of the turn from one long side to the next, in radians.
    root : Root, optional
        The narrow face between the two, if there is one.
    """

    least: float
    most: float
    root: Root | None = None


@dataclass(frozen=True, slots=True)
class GrooveModel:
    """A template: long sides and the corners between them, one fewer."""

    name: str
    sides: tuple[Side, ...]
    corners: tuple[Corner, ...]

    def __post_init__(self) -> None:
        if len(self.sides) < 3 or len(self.corners) != len(self.sides) - 1:
            raise ValueError("a groove has three long sides or more, and a corner between each two")


OPENING_LEAST: Final = radians(20)
OPENING_MOST: Final = radians(120)
"""Bounds of the angle between the two faces of any groove, in radians."""

_RIDGE = Corner(-radians(80), -radians(8))
_VALLEY_LEAST, _VALLEY_MOST = radians(180) - OPENING_MOST, radians(180) - OPENING_LEAST

TEE: Final = GrooveModel(
    "tee",
    (Side("wall", 4e-3, curved=True), Side("bevel", 6e-3), Side("leg", 4e-3, curved=True)),
    (_RIDGE, Corner(_VALLEY_LEAST, _VALLEY_MOST, Root())),
)
"""Tubular T-joint: wall, bevel, root and leg; five points."""

BUTT_V: Final = GrooveModel(
    "butt-v",
    (
        Side("plate", 4e-3, curved=True),
        Side("bevel", 3e-3),
        Side("other bevel", 3e-3),
        Side("other plate", 4e-3, curved=True),
    ),
    (_RIDGE, Corner(_VALLEY_LEAST, _VALLEY_MOST, Root(optional=True)), _RIDGE),
)
"""Butt joint: plate, bevel, root if there is one, bevel, plate; five or six points."""
