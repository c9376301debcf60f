"""A carrier's kinematics from a few numbers: a chain of linear and rotary axes.

Product of exponentials, after K. Lynch, F. Park, *Modern Robotics*, 2017, eq. (4.14).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from tjscan.core import units
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, pose, unit_vector
from tjscan.core.pose_vector import rotation_from_vector

Direction = Annotated[tuple[float, float, float], units.LIST_OR_WORD_IN_FILE]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisSettings(units.SettingsTable):
    """The table [[carrier.axis]]: one axis of a carrier.

    Parameters
    ----------
    name : str
        Of the axis, unlike any other's.
    kind : str
        ``linear`` or ``rotary``.
    direction : tuple of float
        Of motion, or of the axis of rotation by the right-hand rule, in frame w while all axes are
        at 0.
    point : tuple of float, optional
        On the axis of rotation, likewise, metres; of a rotary axis alone.
    limits : tuple of float, optional
        Least and greatest value of a linear axis, metres; required of one.
    angular_limits : tuple of float, optional
        The same of a rotary axis, radians.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,31}$")]
    kind: Literal["linear", "rotary"]
    direction: Direction
    point: units.Position | None = None
    limits: Annotated[tuple[float, float] | None, units.MM] = None
    angular_limits: Annotated[tuple[float, float] | None, units.DEG.with_key("limits_deg")] = None

    def __post_init__(self) -> None:
        rotary = self.kind == "rotary"
        key, other = ("limits_deg", "limits_mm")[:: 1 if rotary else -1]
        if not np.linalg.norm(self.direction) > 0:
            raise ValueError(f"direction: axis {self.name!r} has none")
        if rotary != (self.point is not None):
            raise ValueError(
                f"point_mm: axis {self.name!r} is {self.kind}: "
                + ("state a point that it goes through" if rotary else "it goes through no point")
            )
        given = (self.angular_limits, self.limits)[:: 1 if rotary else -1]
        if given[0] is None or given[1] is not None:
            raise ValueError(
                f"{key}: axis {self.name!r} has no limits: write {key} = [least, greatest]"
                + (f", and no {other}" if given[1] is not None else "")
            )
        if not given[0][0] < given[0][1]:
            raise ValueError(f"{key}: of axis {self.name!r}, the least comes first")

    @property
    def unit(self) -> units.FileUnit:
        """Of its values in a file."""
        return units.DEG if self.kind == "rotary" else units.MM

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and greatest value, metres or radians."""
        return self.limits or self.angular_limits or (0.0, 0.0)

    def motion(self, value: float) -> Array:
        """Motion of what the axis carries, from 0 to a value, shape (4, 4), in frame w."""
        direction = unit_vector(np.array(self.direction))
        if self.point is None:
            return pose(p=value * direction)
        R, point = rotation_from_vector(value * direction), np.array(self.point)
        return pose(R, point - R @ point)


@dataclass(frozen=True, slots=True, eq=False)
class CarrierKinematics:
    """Where an arm's base is in frame w, by the values of the axes that carry it or the joint.

    Frame w is fixed to the joint. Where the axes carry the joint, it is fixed to the plate.

    Parameters
    ----------
    axes : tuple of AxisSettings
        The first one is fixed to the ground and carries the second, and so on.
    T_w_b_zero : ndarray, shape (4, 4)
        The base while all axes are at 0, metres.
    carries_joint : bool
        Whether the axes carry the joint, and the arm stands.
    """

    axes: tuple[AxisSettings, ...]
    T_w_b_zero: Array
    carries_joint: bool

    def T_w_b(self, values: ArrayLike) -> Array:
        """The arm's base in frame w, shape (4, 4), metres.

        Parameters
        ----------
        values : array_like, shape (n,)
            Of the axes, metres and radians.
        """
        T_w_b = self.T_w_b_zero
        for axis, value in self.from_base(values):
            T_w_b = axis.motion(value) @ T_w_b
        return np.asarray(T_w_b)

    def from_base(self, values: ArrayLike) -> tuple[tuple[AxisSettings, float], ...]:
        """Axes from the arm's base to the joint, with values by which each moves the base in w."""
        given = np.asarray(values, dtype=float)
        pairs = zip(self.axes, (-given if self.carries_joint else given).tolist(), strict=True)
        return tuple(pairs) if self.carries_joint else tuple(pairs)[::-1]

    def check_values(self, values: ArrayLike) -> None:
        """Refuse values of another number than the axes, or beyond their limits.

        Raises
        ------
        ConfigurationError
            Naming the first axis.
        """
        given = np.asarray(values, dtype=float).ravel()
        if given.size != len(self.axes):
            names = ", ".join(axis.name for axis in self.axes)
            raise ConfigurationError(f"has {given.size} values; the axes are {names}")
        for axis, value in zip(self.axes, given.tolist(), strict=True):
            low, high = axis.bounds
            if not low - 1e-9 <= value <= high + 1e-9:
                raise ConfigurationError(
                    f"axis {axis.name} at {axis.unit.to_file(value):g} is beyond its limits, "
                    f"{axis.unit.to_file(low):g} to {axis.unit.to_file(high):g} {axis.unit.suffix}"
                )

    def describe(self, values: ArrayLike) -> str:
        """Values of the axes in words, millimetres and degrees."""
        pairs = zip(self.axes, np.asarray(values, dtype=float).tolist(), strict=True)
        return ", ".join(f"{a.name} {a.unit.to_file(v):.6g} {a.unit.suffix}" for a, v in pairs)
