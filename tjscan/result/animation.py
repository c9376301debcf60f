"""Something that moves in a plane, as a report shows it: lines and discs over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True, eq=False)
class MovingLine:
    """A line that changes its shape.

    Parameters
    ----------
    name, colour : str
        As the legend has it; the colour as CSS writes it.
    points : ndarray, shape (frames, n, 2)
        Metres.
    dashed : bool
    """

    name: str
    colour: str
    points: Array
    dashed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class MovingDiscs:
    """Discs that go about.

    Parameters
    ----------
    name, colour : str
        As of `MovingLine`.
    circles : ndarray, shape (frames, n, 3)
        x, y and radius, metres.
    """

    name: str
    colour: str
    circles: Array


@dataclass(frozen=True, slots=True, eq=False)
class PlaneAnimation:
    """What a report lets its reader scrub through.

    Parameters
    ----------
    title, caption : str
        What it shows, and what to see in it.
    times : ndarray, shape (frames,)
        Seconds.
    polygons : sequence of ndarray, shape (n, 2)
        What stands: the first is the floor, the others stand on it.
    path : ndarray, shape (n, 2)
        A line that stands.
    lines : sequence of MovingLine
    discs : sequence of MovingDiscs
    values : sequence of (str, ndarray of shape (frames,))
        Numbers to show at each time, with their names and units.
    notes : sequence of str
        A sentence for each frame, or nothing.
    """

    title: str
    caption: str
    times: Array
    polygons: Sequence[Array]
    path: Array
    lines: Sequence[MovingLine]
    discs: Sequence[MovingDiscs]
    values: Sequence[tuple[str, Array]] = ()
    notes: Sequence[str] = ()

    def as_json(self) -> dict[str, Any]:
        """The same as JSON holds it, in whole millimetres."""
        return {
            "times": [round(float(time), 1) for time in self.times],
            "polygons": [_mm(polygon) for polygon in self.polygons],
            "path": _mm(self.path),
            "lines": [
                {
                    "name": line.name,
                    "colour": line.colour,
                    "dashed": line.dashed,
                    "points": _mm(line.points),
                }
                for line in self.lines
            ],
            "discs": [
                {"name": discs.name, "colour": discs.colour, "circles": _mm(discs.circles)}
                for discs in self.discs
            ],
            "values": [
                {"name": name, "at": [None if v != v else round(v, 3) for v in values.tolist()]}
                for name, values in self.values
            ],
            "notes": list(self.notes),
        }


def _mm(values: Array) -> list[Any]:
    """Metres as whole millimetres, each frame in one row."""
    whole = np.rint(1e3 * np.asarray(values)).astype(int)
    flat: list[Any] = whole.reshape(len(whole), -1).tolist()
    return flat
