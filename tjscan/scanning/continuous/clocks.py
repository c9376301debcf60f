"""The laser's clock against the arm's: offset by a shuttle across the groove, drift by arrivals.

Moved along the groove, the laser sees the same section whatever the offset: that says nothing.
Across it, a corner stands still only if each profile is laid at the pose of its own moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt
from typing import Final

import numpy as np

from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array, array_dataclass, inverse_pose
from tjscan.groove.section import GrooveSection
from tjscan.scanning.continuous.poses import ActualPoses

LARGEST_DELAY: Final = 0.1
"""Seconds from a profile's exposure until it is there, at most, of the one that was quickest."""

LARGEST_OFFSET_SIGMA: Final = 0.5e-3
"""Seconds, standard deviation of an offset that is still good enough."""

LARGEST_DRIFT: Final = 3e-4
"""Of a clock's rate: no clock in order runs so much faster than another."""

EARLIEST_ARRIVAL: Final = 0.02
LATEST_ARRIVAL: Final = 1.0
"""Seconds that a profile may be there before or after the quickest one would be: beyond them its
stamp is wrong. It seems to be there before where the arm's states are late: not for long."""

LONGEST_EARLY: Final = 0.5
"""Seconds of profiles that may all be there too early."""

USUAL_DELAY_SPAN: Final = 5e-3
"""Seconds by which a profile may be later than usual and still tell of the clocks' drift."""

ARRIVAL_BLOCK: Final = 0.5
"""Seconds of profiles whose median counts."""

CORRELATED_NOISE_FACTOR: Final = 2.0
"""By which the offset's standard deviation is larger than that of independent errors: what
neighbouring profiles err by is alike, and corners share the arm's error."""

DRIFT_SIGMA: Final = 1e-4
"""Of a clock's rate, standard deviation: quartz is good to 100 ppm."""

ARRIVAL_SIGMA: Final = 0.5e-3
"""Seconds, standard deviation of the time on the way of a profile, beside when the arm's states
come, which tell the time. Assumption."""

MOST_ROUNDS: Final = 20
CONVERGED_STEP: Final = 1e-7


@array_dataclass
class ShuttleViews:
    """Corners of the groove as they were seen while the laser went to and fro across it.

    Parameters
    ----------
    stamps : ndarray, shape (n,)
        Seconds on the laser's clock.
    corners : ndarray, shape (n, k, 2)
        x and z of each corner in the sensor frame, metres; not a number where it was not seen.
    """

    stamps: Array
    corners: Array

    @classmethod
    def of_sections(cls, seen: Sequence[tuple[float, GrooveSection]]) -> ShuttleViews:
        """The outer corners, p2 and p4, of sections read at stamps."""
        stamps = np.array([stamp for stamp, _ in seen])
        corners = np.array([groove.points_s[[1, 3]][:, [0, 2]] for _, groove in seen])
        for k, name in enumerate(("p2", "p4")):
            hidden = [name in groove.absent for _, groove in seen]
            corners[hidden, k] = np.nan
        return cls(stamps, corners)


def clock_offset(
    views: ShuttleViews, poses: ActualPoses, T_f_s: Array, largest: float
) -> tuple[float, float]:
    """By how much the arm's clock is ahead of the laser's, and its standard deviation, seconds.

    The offset that lets the corners stand still, by Gauss–Newton.

    Parameters
    ----------
    views : ShuttleViews
        What was seen.
    poses : ActualPoses
        Where the arm was.
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange, metres.
    largest : float
        Largest offset that is possible, seconds: no profile is there before it was taken.

    Raises
    ------
    LaserFault
        If no offset up to `LARGEST_DELAY` below that does, or it is not known well.
    """
    earliest, last = views.stamps + largest - LARGEST_DELAY, views.stamps + largest
    covered = (earliest > poses.first) & (last + EARLIEST_ARRIVAL < poses.latest)
    views = ShuttleViews(views.stamps[covered], views.corners[covered])
    T_first_b = inverse_pose(poses.at(poses.first).T_b_f @ T_f_s)
    offset = largest - 0.5 * LARGEST_DELAY

    def places(shift: float) -> Array:
        """Corners laid where they would be, in the plane of the first pose, shape (n, 2 k)."""
        rows = []
        for stamp, corners in zip(views.stamps, views.corners, strict=True):
            T = T_first_b @ poses.at(float(stamp) + shift).T_b_f @ T_f_s
            rows.append(corners @ T[:3, [0, 2]][[0, 2]].T + T[[0, 2], 3])
        flat = np.array(rows).reshape(len(rows), -1)
        return np.asarray(flat - np.nanmedian(flat, axis=0))

    step = 1e-4
    for _ in range(MOST_ROUNDS):
        left = places(offset)
        slope = (places(offset + step) - left) / step
        slope = slope - np.nanmean(slope, axis=0)
        left = left - np.nanmean(left, axis=0)
        sigma = max(1.4826 * float(np.nanmedian(np.abs(left))), 1e-6)
        weight = 1.0 / (1.0 + (left / (3 * sigma)) ** 2)
        information = float(np.nansum(weight * slope**2))
        if information == 0:
            break
        change = -float(np.nansum(weight * slope * left)) / information
        offset += change
        if not largest - LARGEST_DELAY <= offset <= largest + EARLIEST_ARRIVAL:
            break
        spread = CORRELATED_NOISE_FACTOR * sigma / sqrt(information)
        if abs(change) < CONVERGED_STEP and spread < LARGEST_OFFSET_SIGMA:
            return offset, spread
    raise LaserFault(
        "the laser's clock can't be laid on the arm's: no offset lets the groove stand still while "
        "the laser goes to and fro across it. See that its stamps tell when a profile was taken"
    )


class LaserClock:
    """The arm's time of a profile, from the laser's stamp.

    The offset is that of the shuttle. How fast the clocks drift apart since is estimated from when
    profiles arrive, those that are late left out.

    Parameters
    ----------
    offset, sigma : float
        By which the arm's clock is ahead at `since`, and its standard deviation, seconds.
    since : float
        Stamp of the offset, seconds.
    delays : tuple of float
        From exposure to arrival, of the quickest profile and as usual, seconds.
    state_period : float
        Seconds from one state of the arm to the next.
    """

    def __init__(
        self,
        offset: float,
        sigma: float,
        since: float,
        delays: tuple[float, float],
        state_period: float,
    ) -> None:
        self.offset, self.sigma, self.since = offset, sigma, since
        self._quickest, self._usual = delays
        self._drift, self._drift_sigma = 0.0, DRIFT_SIGMA
        self._variance = ARRIVAL_SIGMA**2 + state_period**2 / 12
        self._arrivals: list[tuple[float, float]] = [(0.0, self._usual)]
        self._block: list[tuple[float, float]] = []
        self._last, self._believed, self._arrived = -np.inf, np.inf, -np.inf

    def arm_time(self, stamp: float) -> float:
        """Seconds on the arm's clock."""
        return stamp + self.offset + self._drift * (stamp - self.since)

    def sigma_at(self, stamp: float) -> float:
        """Standard deviation of `arm_time`, seconds."""
        return hypot(self.sigma, self._drift_sigma * (stamp - self.since))

    def notice_arrival(self, stamp: float, arrival: float) -> None:
        """Take note of when a profile arrived, seconds on the arm's clock.

        Raises
        ------
        LaserFault
            If its stamp can't be true.
        """
        delay = arrival - self.arm_time(stamp)
        late = delay - self._quickest
        silent = arrival - self._arrived > LONGEST_EARLY
        if late > -EARLIEST_ARRIVAL or stamp < self._believed or silent:
            self._believed = stamp
        self._arrived = arrival
        early = stamp - self._believed > LONGEST_EARLY
        if stamp < self._last or early or late > LATEST_ARRIVAL:
            raise LaserFault(
                f"the laser's clock leaps: a profile came {1e3 * late:.0f} ms later than its stamp "
                f"lets expect, {1e3 * (stamp - self._last):.0f} ms after the one before. See that "
                "nothing sets the laser's clock while it measures"
            )
        self._last = stamp
        if abs(delay - self._usual) < USUAL_DELAY_SPAN:
            self._block.append((stamp - self.since, arrival - stamp - self.offset))
            if self._block[-1][0] - self._block[0][0] >= ARRIVAL_BLOCK:
                t, y = np.median(self._block, axis=0).tolist()
                self._arrivals.append((t, y))
                self._block = []
                self._estimate_drift()

    def _estimate_drift(self) -> None:
        t, y = np.array(self._arrivals).T
        t, y = t - t.mean(), y - y.mean()
        own = float(t @ t) + self._variance / DRIFT_SIGMA**2
        self._drift = float(np.clip(t @ y / own, -LARGEST_DRIFT, LARGEST_DRIFT))
        self._drift_sigma = sqrt(self._variance / own)
