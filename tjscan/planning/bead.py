"""A bead of the plan: its path, how the torch is held, speed, heat, and how sure they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from tjscan.core.frames import Array, array_dataclass


@array_dataclass
class PlannedBead:
    """A bead, sampled at q points in the order in which it is welded.

    Parameters
    ----------
    layer, place : int
        Layer from the root, and place in it from the bevel; from 1.
    kind : str
        root, fill or cap.
    feed : float
        Wire feed, m/s.
    power : float
        Of the arc, watts.
    s : ndarray, shape (q,)
        Length along the groove, metres; beyond the groove's own if a bead overlaps its start.
    T_r_torch : ndarray, shape (q, 4, 4)
        Tip of the wire in the frame of the sections: z into the work, x the way it travels.
    speed : ndarray, shape (q,)
        Of the tip, m/s.
    area : ndarray, shape (q,)
        Laid down a metre of the tip's path, m².
    heat : ndarray, shape (q,)
        Heat input, J/m.
    slope, rotation : ndarray, shape (q,)
        Radians, see `tjscan.planning.lay.slope_and_rotation`.
    positions : tuple of str
        Welding position at each point.
    width : ndarray, shape (q,)
        In the middle of its height, metres.
    relative_sigma : ndarray, shape (q,)
        Standard deviation of the section's area, and so of speed and fill, as a share of it.
    station : str
        That welds it, or this part of it; empty if no stations are named.
    open_root : bool
        Whether it is the root bead over an opening.
    number, zone : int
        In the order of welding, and of the length of groove with one arrangement, from 1; 0 as
        long as it is in no plan.
    part : int
        Of the bead, from 1: tacks or stations interrupt it, and the arc is off between two parts.
    """

    layer: int
    place: int
    kind: str
    feed: float
    power: float
    s: Array
    T_r_torch: Array
    speed: Array
    area: Array
    heat: Array
    slope: Array
    rotation: Array
    positions: tuple[str, ...]
    width: Array
    relative_sigma: Array
    station: str = ""
    open_root: bool = False
    number: int = 0
    zone: int = 0
    part: int = 1

    def cut(self, spans: Sequence[tuple[int, int]]) -> tuple[PlannedBead, ...]:
        """The parts of it from one point to another, both included, in the order of welding."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        sampled: dict[str, Any] = {
            name: value for name, value in values.items() if isinstance(value, np.ndarray | tuple)
        }
        return tuple(
            replace(self, **{name: value[a : b + 1] for name, value in sampled.items()})
            for a, b in spans
        )

    @property
    def begin(self) -> float:
        """Length along the groove at which it starts, metres."""
        return float(self.s[0])

    @property
    def end(self) -> float:
        """Length along the groove at which it ends, metres."""
        return float(self.s[-1])

    @property
    def points(self) -> Array:
        """Where the wire's tip goes, shape (q, 3), metres."""
        return np.asarray(self.T_r_torch[:, :3, 3])

    @property
    def path_steps(self) -> Array:
        """Lengths from point to point, shape (q - 1,), metres."""
        return np.asarray(np.linalg.norm(np.diff(self.points, axis=0), axis=1))

    @property
    def length(self) -> float:
        """Of its path, metres."""
        return float(self.path_steps.sum())

    @property
    def times(self) -> Array:
        """When the tip is at each point, shape (q,), seconds since the bead's start."""
        pace = 1 / self.speed
        return np.append(0.0, np.cumsum(self.path_steps * 0.5 * (pace[1:] + pace[:-1])))

    @property
    def arc_time(self) -> float:
        """Seconds with the arc on."""
        return float(self.times[-1])

    @property
    def volume(self) -> float:
        """Laid down, m³."""
        return float(np.sum(self.path_steps * 0.5 * (self.area[1:] + self.area[:-1])))

    @property
    def fill_sigma(self) -> float:
        """Standard deviation of what it should have laid down, as a share of that.

        Sections are taken to err alike, which is the worst they can do.
        """
        weights = self.area * np.abs(np.gradient(self.s))
        return float(np.sum(weights * self.relative_sigma) / np.sum(weights))
