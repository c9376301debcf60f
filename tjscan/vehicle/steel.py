"""Where there is steel below a simulated vehicle, and what its proximity sensors read of it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Le, Len

from tjscan.core.frames import Array, readonly_copy
from tjscan.core.units import LIST_OR_WORD_IN_FILE, MM, SECONDS, FileUnit, SettingsTable

PERCENT_UNIT: Final = FileUnit("percent", 0.01)

Millimetres = Annotated[float, Ge(-1e6), Le(1e6)]

SurfacePoint = Annotated[tuple[Millimetres, Millimetres], MM]
"""x and y in frame w, metres: up to a kilometre away."""


class SteelArea:
    """Area of steel on the unrolled surface, frame w, inside a polygon.

    Parameters
    ----------
    outline_w : array_like, shape (n, 2)
        Corners in order, x and y in metres, none repeated; none at all is steel everywhere.
    """

    def __init__(self, outline_w: object = ()) -> None:
        self.outline_w = readonly_copy(np.reshape(np.asarray(outline_w, dtype=float), (-1, 2)))

    def holds(self, points_w: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Whether there is steel at points, shape (m, 2): a ray to +x leaves it an odd time."""
        if not len(self.outline_w):
            return np.ones(len(points_w), dtype=bool)
        a, b = self.outline_w, np.roll(self.outline_w, -1, axis=0)
        x, y = points_w[:, :1], points_w[:, 1:]
        across = (a[:, 1] > y) != (b[:, 1] > y)
        rise = np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
        meets = a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
        return np.asarray(np.sum(across & (x < meets), axis=1) % 2 == 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProximitySettings(SettingsTable):
    """The table [simulation.vehicle.proximity]: four sensors at the body's corners.

    Parameters
    ----------
    body_length, body_width : float
        Of the rectangle, its middle at the vehicle's origin, at whose corners they sit, metres.
    height : float
        Over the steel, metres. Assumption.
    noise : float
        Standard deviation of a reading, metres. Assumption.
    period : float
        Seconds between samples.
    irregular : float
        Share of the samples that read anything between nothing and five times the height, or
        see no steel at all, while the arc burns. Assumption.
    """

    body_length: Annotated[float, Ge(50), Le(5000), MM] = 0.8
    body_width: Annotated[float, Ge(50), Le(5000), MM] = 0.5
    height: Annotated[float, Ge(1), Le(500), MM] = 0.03
    noise: Annotated[float, Ge(0), Le(50), MM] = 5e-4
    period: Annotated[float, Ge(0.001), Le(10), SECONDS] = 0.1
    irregular: Annotated[float, Ge(0), Le(100), PERCENT_UNIT] = 0.005


class ProximitySensors:
    """Simulated proximity sensors at a vehicle's corners, in the order of `vehicle.CORNERS`.

    Parameters
    ----------
    settings : ProximitySettings
    steel : SteelArea
    seed : int or Generator
        Of their noise.
    """

    def __init__(
        self, settings: ProximitySettings, steel: SteelArea, seed: int | np.random.Generator
    ) -> None:
        self._settings, self._steel = settings, steel
        self._random = np.random.default_rng(seed)
        x, y = settings.body_length / 2, settings.body_width / 2
        self._corners_v = np.array([(x, -y), (x, y), (-x, -y), (-x, y)])

    def read(self, pose_w: Array, *, arc_burning: bool) -> tuple[float, ...]:
        """Readings in metres at the corners of a body at x, y and heading; inf over no steel."""
        cos, sin = np.cos(pose_w[2]), np.sin(pose_w[2])
        corners_w = pose_w[:2] + self._corners_v @ np.array([(cos, sin), (-sin, cos)])
        s = self._settings
        noise, odd, wild = self._random.random((3, len(corners_w)))
        readings = s.height + s.noise * np.sqrt(12) * (noise - 0.5)
        readings[~self._steel.holds(corners_w)] = inf
        if arc_burning:
            irregular = odd < s.irregular
            readings[irregular] = np.where(wild < 0.5, inf, 10 * s.height * (wild - 0.5))[irregular]
        return tuple(readings.tolist())


Outline = Annotated[tuple[SurfacePoint, ...], Len(0, 1000), LIST_OR_WORD_IN_FILE]
"""A polygon on the unrolled surface: corners in order, metres."""
