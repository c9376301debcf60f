"""One profile of a line laser, and whether it came before."""

from __future__ import annotations

from dataclasses import field
from functools import partial
from hashlib import sha256
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, Mask, array_dataclass


@array_dataclass
class Profile:
    """Points of one laser line in the sensor frame s, in the order of the sensor's columns.

    Parameters
    ----------
    x_s, z_s : ndarray, shape (n,)
        Coordinates in the laser plane, in metres; z along the central ray. Both are NaN
        if the sensor has no point.
    intensity : ndarray, shape (n,), optional
        Brightness of each point, 0 to 1, if the sensor reports it.
    time : float
        Seconds on the clock of the cell; 0 if the sensor reports none.
    time_uncertainty : float
        How far off the time may be, in seconds: the two clocks are read one after the other.
    columns : ndarray of int, shape (n,), optional
        The sensor's column of each point, if not all are here, or in another order.
    column_count : int, optional
        How many columns the sensor has, if not all are here.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        x and z together, in metres.
    """

    x_s: Array
    z_s: Array
    intensity: Array | None = None
    time: float = 0.0
    time_uncertainty: float = 0.0
    columns: NDArray[np.intp] = field(default_factory=partial(np.arange, 0))
    column_count: int = 0
    points: Array = field(init=False)

    def __post_init__(self) -> None:
        if self.x_s.ndim != 1 or self.x_s.shape != self.z_s.shape:
            raise ValueError(f"x_s {self.x_s.shape} and z_s {self.z_s.shape} are not two columns")
        if len(self.columns) != len(self.x_s):
            object.__setattr__(self, "columns", np.arange(len(self.x_s)))
            object.__setattr__(self, "column_count", len(self.x_s))
        elif self.column_count < min(len(self.columns), 1):
            raise ValueError("columns are stated, but not how many the sensor has: column_count")
        # Coordinates lie one after the other in memory: sums over all points are quicker.
        object.__setattr__(self, "points", np.array((self.x_s, self.z_s)).T)

    def __len__(self) -> int:
        return len(self.x_s)

    @property
    def valid(self) -> Mask:
        """Which columns hold a point, shape (n,)."""
        return np.asarray(np.isfinite(self.x_s) & np.isfinite(self.z_s))

    @property
    def digest(self) -> bytes:
        """Of its coordinates, to the last bit: profiles that measured other noise differ in it."""
        return sha256(self.z_s.tobytes() + self.x_s.tobytes()).digest()

    @property
    def points_s(self) -> Array:
        """The points there are, shape (m, 3), y = 0, in metres."""
        v = self.valid
        return np.column_stack((self.x_s[v], np.zeros(v.sum()), self.z_s[v]))


REMEMBERED_PROFILES: Final = 100_000
"""Profiles: a quarter of an hour at 100 a second, and more than any sensor's buffers hold."""


class ProfileRepeats:
    """Recognises profiles that came before, to the last bit.

    No sensor measures the same noise twice. Profiles without a point are all alike; none of them
    is a repeat.
    """

    def __init__(self) -> None:
        self._known: dict[bytes, None] = {}  # in the order in which they came

    def is_repeat(self, profile: Profile) -> bool:
        """Whether a profile is one of those before; it is one of them from now on."""
        if not profile.valid.any():
            return False
        digest = profile.digest
        if digest in self._known:
            return True
        self._known[digest] = None
        if len(self._known) > REMEMBERED_PROFILES:
            del self._known[next(iter(self._known))]
        return False
