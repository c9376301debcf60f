"""Where a vehicle is: its odometry, corrected by measured poses that can be true."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import hypot, inf, isfinite, sqrt
from typing import Final

import numpy as np

from tjscan.core.frames import Array, readonly_copy
from tjscan.core.robust import MAD_TO_SIGMA
from tjscan.towing.following import velocity_from_twist, wrap_angle
from tjscan.vehicle.localisation import VehiclePose
from tjscan.vehicle.vehicle import Twist

SLIP_SHARE: Final = 0.05
"""Share of its way by which a vehicle's odometry may be wrong along it: wheels slip as they drive,
wear, and climb what lies on the floor."""

SLIP_ANGLE: Final = 0.01
"""The same across its way, radians: the slip angle of wheels at a side force of a tenth of their
load, more than the cable's. Their cornering stiffness is ten times the load at least (Pacejka,
Tire and Vehicle Dynamics, 2012)."""

ODOMETRY_NOISE: Final = (1e-4, 3e-4)
"""What odometry may miss without any way, metres and radians per square root of a second."""

OUTLIER_SIGMAS: Final = 5.0
"""Standard deviations by which a pose that is true is off at most."""

KEPT_UPDATES: Final = 40
"""Updates that are kept, 2 s of them, so that a late pose meets the estimate of its own time."""

SCATTER_FROM: Final = 30
"""Poses from whose differences their scatter is found."""

SAME_POSES: Final = 10
"""Poses equal in every digit, while the vehicle drives, that show a frozen measurement."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """Where a vehicle is believed to be.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        x, y in metres and heading in radians, frame w.
    position_sigma, heading_sigma : float
        Standard deviations, metres and radians.
    age : float
        Seconds since a measured pose was last taken.
    refused : str
        Why measured poses are not taken now: ``none comes``, ``jumped``, ``frozen``; else empty.
    """

    pose: Array
    position_sigma: float
    heading_sigma: float
    age: float
    refused: str = ""


class VehiclePoseFilter:
    """An extended Kalman filter of one vehicle's pose, which drives where it heads.

    Between measured poses the odometry goes on. A pose further off than the vehicle may have
    driven at top speed since the last one that was taken, and five standard deviations, is
    refused. So is one that is older than the last, and one that never changes on the way.

    Measured poses count for as much as they are stated to, and for less where they are seen to
    scatter more. How much is read off the second differences of measured poses less odometry: the
    autocovariances of what is measured tell its noise from what drives the state (Mehra, On the
    identification of variances and adaptive Kalman filtering, 1970), and neither a push nor wheels
    that slip all the time add to the median of these differences.

    Parameters
    ----------
    position_sigma, heading_sigma : float
        Of measured poses, metres and radians, at least.
    top_speed : float
        Of the vehicle, m/s.
    top_turn_rate : float
        rad/s.
    longest_gap : float
        Seconds: with a longer one, no more way is allowed for.
    """

    def __init__(
        self,
        position_sigma: float,
        heading_sigma: float,
        *,
        top_speed: float,
        top_turn_rate: float,
        longest_gap: float,
    ) -> None:
        self._stated = np.array((position_sigma, position_sigma, heading_sigma))
        self._sigma = self._stated
        self._taken_before: tuple[float, Array] | None = None
        self._step: Array | None = None
        self._bends: deque[Array] = deque(maxlen=SCATTER_FROM)
        self._top = np.array((top_speed, top_speed, top_turn_rate))
        self._longest_gap = longest_gap
        self._pose: Array | None = None
        self._covariance = np.diag(np.square(self._sigma))
        self._trail: deque[tuple[float, Array]] = deque(maxlen=KEPT_UPDATES)
        self._taken = self._newest = -inf
        self._last: tuple[float, ...] = ()
        self._equal, self._way = 0, 0.0
        self._refused = ""
        self._denied: Array | None = None

    @property
    def known(self) -> bool:
        """Whether a pose was ever taken."""
        return self._pose is not None

    @property
    def scatter(self) -> Array:
        """Standard deviation that measured poses count with, metres and radians, shape (3,)."""
        return readonly_copy(self._sigma)

    def begin_at(self, pose: Array, time: float) -> None:
        """Begin with a pose that is known, at a time in seconds."""
        self._pose, self._covariance = np.array(pose, dtype=float), np.diag(np.square(self._sigma))
        self._taken, self._refused, self._denied = time, "", None
        self._equal, self._way, self._last = 0, 0.0, ()
        self._taken_before = self._step = None
        self._trail.clear()
        self._trail.append((time, self._pose.copy()))

    def update(
        self, time: float, period: float, odometry: Twist, measured: VehiclePose | None
    ) -> PoseEstimate:
        """Go on to a time, and take in the pose that was measured, if one came.

        Parameters
        ----------
        time : float
            Seconds on the team's clock.
        period : float
            Since the last update, seconds.
        odometry : Twist
            Mean of the period.
        measured : VehiclePose or None
        """
        if self._pose is not None:
            self._go_on(period, odometry)
            self._trail.append((time, self._pose.copy()))
        if measured is None:
            self._refused = self._refused or "none comes"
        elif measured.time > self._newest:
            self._newest = measured.time
            self._take(measured, time)
        return self.estimate(time)

    def estimate(self, time: float) -> PoseEstimate:
        """What is believed now."""
        pose = np.full(3, np.nan) if self._pose is None else self._pose
        sigma = np.sqrt(np.diag(self._covariance))
        age = time - self._taken
        late = age > self._longest_gap / 2
        return PoseEstimate(
            readonly_copy(pose),
            float(sigma[:2].max()),
            float(sigma[2]),
            age,
            (self._refused or "none comes") if late else "",
        )

    @property
    def denied(self) -> Array | None:
        """Last measured pose where poses are refused as jumps, moved on to now; shape (3,)."""
        return self._denied

    def _go_on(self, period: float, odometry: Twist) -> None:
        assert self._pose is not None
        velocity = velocity_from_twist(odometry, self._pose[2] + odometry.turn_rate * period / 2)
        step = velocity * period
        self._pose = self._pose + step
        way = hypot(step[0], step[1])
        self._way += way
        turned = np.array(((1.0, 0.0, -step[1]), (0.0, 1.0, step[0]), (0.0, 0.0, 1.0)))
        across = (SLIP_ANGLE * way) ** 2 + ODOMETRY_NOISE[0] ** 2 * period
        doubt = np.diag(
            (across, across, (SLIP_SHARE * step[2]) ** 2 + ODOMETRY_NOISE[1] ** 2 * period)
        )
        doubt[:2, :2] += (SLIP_SHARE**2 - SLIP_ANGLE**2) * np.outer(step[:2], step[:2])
        self._covariance = turned @ self._covariance @ turned.T + doubt
        if self._denied is not None:
            self._denied = self._denied + step

    def _take(self, measured: VehiclePose, time: float) -> None:
        found = np.array((measured.x, measured.y, measured.heading))
        if not np.isfinite(found).all() or not isfinite(measured.time):
            self._refused = "not a number"
            return
        if self._pose is None:
            self.begin_at(found, time)
            return
        if self._is_frozen(found):
            self._refused = "frozen"
            return
        late = self._moved_since(measured.time)
        off = found + late - self._pose
        off[2] = wrap_angle(off[2])
        gap = min(time - self._taken, self._longest_gap)
        noise = np.diag(np.square(self._sigma))
        spread = OUTLIER_SIGMAS * np.sqrt(np.diag(noise + self._covariance))
        reach = self._top * gap + spread
        if hypot(off[0], off[1]) > reach[0] or abs(off[2]) > reach[2]:
            self._refused, self._denied = "jumped", self._pose + off
            return
        self._learn_scatter(found, measured.time)
        if (np.abs(off) > spread).any():  # within reach but not as odometry has it: it slipped
            self._covariance = noise
        else:
            gain = self._covariance @ np.linalg.inv(self._covariance + noise)
            off, self._covariance = gain @ off, gain @ noise
        self._pose = self._pose + off
        self._trail = deque(((t, p + off) for t, p in self._trail), maxlen=KEPT_UPDATES)
        self._taken, self._refused, self._denied = time, "", None

    def _learn_scatter(self, found: Array, time: float) -> None:
        """Take the poses' scatter from how they bend away from the odometry."""
        before, self._taken_before = self._taken_before, (time, found)
        if before is None:
            return
        step = found - before[1] - (self._moved_since(before[0]) - self._moved_since(time))
        step[2] = wrap_angle(step[2])
        if self._step is not None:
            self._bends.append(step - self._step)
        self._step = step
        if len(self._bends) == SCATTER_FROM:
            # Weights 1, -2 and 1 of three independent poses.
            sigma = np.median(np.abs(self._bends), axis=0) * MAD_TO_SIGMA / sqrt(6)
            place = hypot(sigma[0], sigma[1]) / sqrt(2)
            self._sigma = np.maximum(self._stated, (place, place, sigma[2]))

    def _moved_since(self, time: float) -> Array:
        """Way from a time until now, shape (3,)."""
        assert self._pose is not None
        times, trail = zip(*self._trail, strict=True)
        before = np.array([np.interp(time, times, column) for column in np.transpose(trail)])
        return np.asarray(self._pose - before)

    def _is_frozen(self, found: Array) -> bool:
        """Whether the pose stayed the same in every digit while the vehicle drove."""
        if tuple(found) == self._last:
            self._equal += 1
        else:
            self._last, self._equal, self._way = tuple(found), 0, 0.0
        return self._equal >= SAME_POSES and self._way > OUTLIER_SIGMAS * self._sigma[0]
