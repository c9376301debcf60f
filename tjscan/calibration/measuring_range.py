"""The trapezoid a line laser measures in, and what it would see of a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True)
class MeasuringRange:
    """The laser's measuring range (its window) in the laser plane. Metres, radians.

    Parameters
    ----------
    near, far : float
        Limits of z in frame s.
    apex_z : float
        The sides of the trapezoid meet at (0, 0, apex_z) in frame s.
    half_angle : float
        Between the central ray and a side.
    columns : int
        Points on a line that crosses the whole width.
    """

    near: float
    far: float
    apex_z: float
    half_angle: float
    columns: int

    def __post_init__(self) -> None:
        if not self.apex_z < self.near < self.far:
            raise ValueError("a window needs apex_z < near < far")
        if not 0 < self.half_angle < np.pi / 2 or self.columns < 2:
            raise ValueError("a window needs an opening between 0 and 90° and at least two columns")


@dataclass(frozen=True, slots=True, eq=False)
class VisibleLines:
    """Where the laser sees planes as lines: their ends, length and columns, frame s.

    Parameters
    ----------
    ends_s : ndarray, shape (n, 2, 3)
        Both ends, by rising x; NaN if the plane is out of the window.
    span : ndarray, shape (n,)
        Length in metres; zero where nothing is seen.
    columns : ndarray, shape (n,)
        Points on each line.
    """

    ends_s: Array
    span: Array
    columns: Array


def visible_lines_on_plane(window: MeasuringRange, u_s: Array, u0_s: Array) -> VisibleLines:
    """Lines that the laser sees where planes cut its window.

    Parameters
    ----------
    window : MeasuringRange
        The measuring range.
    u_s, u0_s : ndarray, shapes (n, 3) and (n,)
        The planes ``u · p + u0 = 0`` in frame s.
    """
    tan = np.tan(window.half_angle)
    # A column at tangent t is the ray (t, 0, 1) from the apex; it meets the plane at depth d.
    with np.errstate(divide="ignore", invalid="ignore"):
        to_plane = -(u0_s + u_s[:, 2] * window.apex_z)
        # depth(t) = to_plane / (u_x t + u_z), so t(depth) limits the columns that see near..far.
        limits = to_plane[:, None] / np.array(
            (window.near - window.apex_z, window.far - window.apex_z)
        )
        at = (limits - u_s[:, 2:3]) / u_s[:, :1]
        level = np.abs(u_s[:, 0]) < 1e-12 * np.abs(u_s[:, 2])
        depth_0 = to_plane / u_s[:, 2]
        inside = (depth_0 >= window.near - window.apex_z) & (depth_0 <= window.far - window.apex_z)
        low = np.where(level, np.where(inside, -tan, np.inf), np.min(at, axis=1))
        high = np.where(level, np.where(inside, tan, -np.inf), np.max(at, axis=1))
        low, high = np.maximum(low, -tan), np.minimum(high, tan)
        t = np.stack((low, high), axis=1)
        depth = to_plane[:, None] / (u_s[:, :1] * t + u_s[:, 2:3])
        seen = (low < high) & (depth > 0).all(axis=1)
        ends = np.stack((depth * t, np.zeros_like(t), window.apex_z + depth), axis=2)
    ends[~seen] = np.nan
    span = np.where(seen, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), 0.0)
    columns = np.where(seen, (high - low) / (2 * tan) * (window.columns - 1) + 1, 0.0)
    return VisibleLines(ends, span, columns)
