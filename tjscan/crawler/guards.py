"""What stops the crawler: guards over every cycle, whatever its phase, and steel below its corners.

Proximity sensors show whether there is steel; an arc disturbs them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Annotated, Final

from annotated_types import Ge, Gt, Le

from tjscan.core.errors import CrawlStopped
from tjscan.core.units import MM, SettingsTable
from tjscan.crawler.method import OffsetEstimate
from tjscan.crawler.plan import GuardSettings
from tjscan.vehicle.vehicle import PROXIMITY_CORNERS, Twist, VehicleState

SENSOR_SILENCE_SECONDS: Final = 0.5
"""Seconds without a sample of the proximity sensors, five of theirs, after which it stops."""

LONGEST_VOUCHED_PERIOD: Final = 0.1
"""Seconds before it that a state holds for at most: a longer gap without a state shows nothing
against a sensor or a drive."""

STANDSTILL_TIME: Final = 1.0
"""Seconds by which more periods show less than half the speed asked for than show more: no drive
takes so long to get going."""


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
class ProximitySensorPlaces:
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


MOST_CYCLES_OFF: Final = 10
"""Cycles for which the estimate may have a burning torch off its path: 1 to 2 mm of weld. A dead
encoder puts it there at once, and is named within them."""


class Guards:
    """Watch over a crawl: edges, the joint, the drives, and what is commanded.

    Parameters
    ----------
    settings : GuardSettings
    proximity : ProximityFilter
    corners : ProximitySensorPlaces
        Where its sensors are.
    """

    def __init__(
        self, settings: GuardSettings, proximity: ProximityFilter, corners: ProximitySensorPlaces
    ) -> None:
        self._settings, self._proximity, self._corners = settings, proximity, corners
        self._blind_travel = self._blind_time = self._filled_travel = 0.0
        self._without_sample = self._stalled = 0.0
        self._cycles_off = 0

    def watch_vehicle(self, state: VehicleState, period: float = 0.0) -> None:
        """Look at what the vehicle reports.

        Parameters
        ----------
        state : VehicleState
        period : float, optional
            Since the last one, seconds.

        Raises
        ------
        CrawlStopped
            If a drive is at fault or overloaded, a number is none, or the proximity sensors are
            silent.
        """
        self._proximity.add_sample(state.proximity)
        silent = self._without_sample + min(period, LONGEST_VOUCHED_PERIOD)
        self._without_sample = 0.0 if state.proximity else silent
        if self._without_sample > SENSOR_SILENCE_SECONDS:
            raise CrawlStopped(
                "proximity",
                f"the proximity sensors have been silent for {self._without_sample:.1f} s: "
                "an edge would not be seen. Look at their cable",
            )
        if state.fault:
            raise CrawlStopped("drive fault", f"a drive reports: {state.fault}")
        motion = (state.odometry.speed, state.odometry.turn_rate, *state.torques)
        if not all(map(isfinite, (*motion, *state.gyro, *state.down))):
            raise CrawlStopped(
                "vehicle", "the vehicle's encoders, drives, gyro or inclinometer report no numbers"
            )
        torque = max(map(abs, state.torques), default=0.0)
        if torque > self._settings.torque:
            raise CrawlStopped(
                "torque",
                f"a motor turns its track with {torque:.0f} N m, more than "
                f"{self._settings.torque:g}. Make least_radius_mm greater",
            )

    def watch_progress(self, asked: float, shown: float, period: float) -> None:
        """Look whether the vehicle moves as it is asked to.

        Parameters
        ----------
        asked, shown : float
            Speed that the drives are asked for, and that the encoders show, m/s.
        period : float
            Seconds.

        Raises
        ------
        CrawlStopped
            If it does not move, or goes the other way.
        """
        stalled = asked != 0 and shown / asked < 0.5
        period = min(period, LONGEST_VOUCHED_PERIOD)
        self._stalled = max(self._stalled + (period if stalled else -period), 0.0)
        if self._stalled > STANDSTILL_TIME:
            raise CrawlStopped(
                "not moving",
                f"the drives were asked for {1e3 * asked:g} mm/s, and the encoders show "
                f"{1e3 * shown:.1f} mm/s. Look at brakes, motors and encoders",
            )

    def surely_in_view(self, estimated: OffsetEstimate) -> bool:
        """Whether the joint is surely within the laser's line, seen or not."""
        return estimated.surely_within(self._settings.field)

    def watch_joint(
        self,
        d: float | None,
        speed: float,
        period: float,
        estimated: OffsetEstimate | None = None,
        *,
        filled: bool = False,
    ) -> None:
        """Look at a reading of the joint, or at there being none.

        Parameters
        ----------
        d : float or None
            Laser minus joint, metres.
        speed : float
            Of the vehicle, m/s.
        period : float
            Since the last call, seconds.
        estimated : OffsetEstimate, optional
            The estimated place of the laser, if nothing is left to weld: the joint need not
            be seen then as long as it surely lies within the laser's line.
        filled : bool, optional
            Whether the laser shows even steel from plate to plate: a tack that fills the joint.

        Raises
        ------
        CrawlStopped
            If the joint was not seen for too long, or leaves the laser's line.
        """
        settings = self._settings
        if d is None and estimated is not None and self.surely_in_view(estimated):
            return
        if d is None:
            way = abs(speed) * period
            if filled and way:
                self._filled_travel += way
            else:
                self._blind_travel += way
                self._blind_time += period
            over = {
                "blind_travel_mm": self._blind_travel > settings.blind_travel,
                "blind_time_s": self._blind_time > settings.blind_time,
                "filled_travel_mm": self._filled_travel > settings.filled_travel,
            }
            if any(over.values()):
                unseen = self._blind_travel + self._filled_travel
                blind = f"{1e3 * unseen:.0f} mm and {self._blind_time:.1f} s"
                keys = " and ".join(f"guards.{key}" for key, is_over in over.items() if is_over)
                raise CrawlStopped(
                    "joint lost",
                    f"the joint was not seen for {blind}. If it ends there, put plates on that "
                    "prolong it by what the laser is ahead of the torch, or make "
                    "alignment.length_mm, weld.run_up_mm or weld.length_m shorter; if something "
                    f"hides it, take that away, or allow more in {keys}",
                )
            return
        self._blind_travel = self._blind_time = self._filled_travel = 0.0
        if abs(d) > settings.field:
            raise CrawlStopped(
                "joint at the edge",
                f"the joint is {1e3 * abs(d):.0f} mm off the middle of the laser's line, more "
                f"than {1e3 * settings.field:g} mm: the vehicle does not follow it",
            )

    def watch_weld(self, deviation: float, sigma: float, *, burning: bool = False) -> None:
        """Look at the torch if the arc burns, or is about to be struck.

        Parameters
        ----------
        deviation, sigma : float
            Of the torch from its path as estimated, and its standard deviation, metres.
        burning : bool, optional
            Whether the arc burns: it then may be off for `MOST_CYCLES_OFF`, and the cause shows.

        Raises
        ------
        CrawlStopped
            If it is not on its path, or this is not known.
        """
        settings = self._settings
        is_off = burning and abs(deviation) > settings.torch_off
        self._cycles_off = self._cycles_off + 1 if is_off else 0
        if not abs(deviation) <= settings.torch_off and not 0 < self._cycles_off <= MOST_CYCLES_OFF:
            raise CrawlStopped(
                "torch off its path",
                f"the torch is {1e3 * abs(deviation):.1f} mm beside its path, more than "
                f"{1e3 * settings.torch_off:g} mm: its axis does not reach there",
            )
        if not self.knows_torch(sigma):
            raise CrawlStopped(
                "torch not known",
                f"where the torch is beside the joint is known to {1e3 * sigma:.2f} mm, and "
                f"welding needs {1e3 * settings.torch_sigma:g} mm. Calibrate on this hull, make "
                "the run-up longer, or allow more in guards.torch_sigma_mm",
            )

    def knows_torch(self, sigma: float) -> bool:
        """Whether its place is known well enough to weld: to a standard deviation in metres."""
        return sigma <= self._settings.torch_sigma

    def check_command(self, twist: Twist) -> None:
        """Let nothing move towards an edge of the steel.

        Raises
        ------
        CrawlStopped
            If a corner without steel would move outward.
        """
        if self.leads_off_steel(twist):
            missing = self._proximity.missing_corners
            raise CrawlStopped("edge", f"there is no steel below: {', '.join(missing)}")

    def leads_off_steel(self, twist: Twist) -> bool:
        """Whether a twist moves a corner outward that has no steel below."""
        return self._corners.moves_towards_edge(twist, self._proximity.missing_corners)

    @property
    def is_on_steel(self) -> bool:
        """Whether there is steel below every corner."""
        return not self._proximity.missing_corners
