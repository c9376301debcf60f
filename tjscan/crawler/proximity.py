"""Whether there is steel below each corner, from sensors that an arc disturbs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Gt, Le

from tjscan.core.units import MM, SettingsTable
from tjscan.vehicle.vehicle import PROXIMITY_CORNERS, Twist


@dataclass(frozen=True, slots=True, kw_only=True)
class ProximitySettings(SettingsTable):
    """When a corner counts as being without steel, and when it has steel again.

    Parameters
    ----------
    missing, present : float
        Distance beyond which a sample shows no steel, and below which it shows steel, metres;
        between them nothing changes.
    samples : int
        In a row, until a corner that had steel counts as without, or one without as with.
    """

    missing: Annotated[float, Gt(0), Le(2000), MM] = 0.060
    present: Annotated[float, Gt(0), Le(2000), MM] = 0.045
    samples: Annotated[int, Ge(1), Le(20)] = 3

    def __post_init__(self) -> None:
        if not self.present < self.missing:
            raise ValueError("present_mm must be smaller than missing_mm")


@dataclass(slots=True)
class ProximityFilter:
    """Two limits and samples in a row for each of `PROXIMITY_CORNERS`; at first none has steel.

    A sample that is no number shows no steel: a sensor that is broken is as dangerous as an edge.
    """

    settings: ProximitySettings
    _steel: list[bool] = field(default_factory=lambda: [False] * len(PROXIMITY_CORNERS))
    _against: list[int] = field(default_factory=lambda: [0] * len(PROXIMITY_CORNERS))

    def add_sample(self, distances: Sequence[float]) -> None:
        """Take in a sample: the distance at each corner, metres; nothing if there is none."""
        for i, distance in enumerate(distances):
            steel, limits = self._steel[i], self.settings
            shows_steel = distance <= (limits.missing if steel else limits.present)
            self._against[i] = self._against[i] + 1 if shows_steel != steel else 0
            if self._against[i] >= self.settings.samples:
                self._steel[i], self._against[i] = not steel, 0

    @property
    def missing_corners(self) -> tuple[str, ...]:
        """Corners without steel."""
        corners = zip(PROXIMITY_CORNERS, self._steel, strict=True)
        return tuple(name for name, steel in corners if not steel)


@dataclass(frozen=True, slots=True)
class CornerPlaces:
    """Where the proximity sensors are on the vehicle.

    Parameters
    ----------
    length, width : float
        Between the front and the rear ones, and between the left and the right ones, metres.
    """

    length: float
    width: float

    def moves_towards_edge(self, twist: Twist, missing_corners: Sequence[str]) -> bool:
        """Whether a twist moves a corner without steel outward, away from the vehicle's middle.

        Parameters
        ----------
        twist : Twist
        missing_corners : sequence of str
            Among `PROXIMITY_CORNERS`.
        """
        for corner in missing_corners:
            x = self.length / 2 * (1 if "front" in corner else -1)
            y = self.width / 2 * (1 if "right" in corner else -1)
            forward = twist.speed - twist.turn_rate * y
            right = twist.sideways + twist.turn_rate * x
            # Either part outward is one too many: the sensor does not show which edge it is.
            if forward * x > 0 or right * y > 0:
                return True
        return False
