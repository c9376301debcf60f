"""What can be drawn in the page's picture, as plain data in frame b."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.live.colours import Colour


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Line segments.

    Parameters
    ----------
    segments : ndarray, shape (n, 2, 3)
        Their ends, metres.
    colour : tuple of int
    width : float
        Pixels.
    """

    segments: Array
    colour: Colour
    width: float = 1.5

    @classmethod
    def through(cls, *polylines: Array, colour: Colour, width: float = 1.5) -> Lines:
        """Return the segments of polylines, each of shape (n, 3)."""
        parts = [np.stack((line[:-1], line[1:]), axis=1) for line in polylines]
        return cls(np.concatenate(parts) if parts else np.empty((0, 2, 3)), colour, width)


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A surface of triangles.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        Metres.
    triangles : ndarray of int, shape (m, 3)
        Numbers of each one's corners.
    colour : tuple of int
    opacity : float
        1 if nothing shines through.
    """

    vertices: Array
    triangles: NDArray[np.integer]
    colour: Colour
    opacity: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredPiece:
    """A piece of what was measured, coloured by whichever measure the page is asked for.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        The points themselves, metres; rows with NaN are left out.
    vertices : ndarray, shape (k, 3)
        Of the surface that joins it to the piece before; empty for the first.
    triangles : ndarray of int, shape (m, 3)
        Numbers of each one's corners.
    values : mapping of str to float
        Value of each measure, in its unit.
    """

    points: Array
    vertices: Array
    triangles: NDArray[np.integer]
    values: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class ArmPosture:
    """Joint angles of the arm, shape (n,), radians."""

    q: Array


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """Pose, shape (4, 4), of a body that the page was given before, under its name."""

    T: Array


Drawable = Lines | Surface | MeasuredPiece | ArmPosture | BodyPose
