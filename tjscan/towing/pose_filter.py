"""Where vehicles are: odometry, corrected by measured poses that can be true for the cable."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import degrees, hypot, inf, sqrt
from typing import Final

import numpy as np

from tjscan.core.devices import EventListener
from tjscan.core.frames import Array, readonly_copy
from tjscan.core.robust import MAD_TO_SIGMA
from tjscan.towing.following import velocity_from_twist, wrap_angle
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.tables import LocalisationSettings
from tjscan.vehicle.localisation import VehiclePose
from tjscan.vehicle.vehicle import Twist

WHEEL_SLIP_SHARE: Final = 0.05
"""Share of its way by which a vehicle's odometry may be wrong along it: wheels slip as they drive,
wear, and climb what lies on the floor."""

WHEEL_SLIP_ANGLE: Final = 0.01
"""The same across its way, radians: the slip angle of wheels at a side force of a tenth of their
load, more than the cable's. Their cornering stiffness is ten times the load at least (Pacejka,
Tire and Vehicle Dynamics, 2012)."""

ODOMETRY_NOISE: Final = (1e-4, 3e-4)
"""What odometry may miss without any way, metres and radians per square root of a second."""

OUTLIER_SIGMAS: Final = 5.0
"""Standard deviations by which a pose that is true is off at most."""

FASTEST_PUSH: Final = 1.0
"""Metres a second at which a vehicle's rim may be pushed: what is further off at once is no motion
of a vehicle whose place was known."""

MOST_KEPT_UPDATES: Final = 40
"""Updates that are kept, 2 s of them, so that a late pose meets the estimate of its own time."""

FEWEST_POSES_FOR_SCATTER: Final = 30
"""Poses from whose differences their scatter is found."""

NOISY_SCATTER_RATIO: Final = 2.0
"""Scatter over what is stated from which on poses count as noisier, and their estimate as known
worse by as much: from 30 poses it is wrong by a quarter (one standard deviation)."""

NOISY_POSE_COUNT: Final = 40
"""Poses for which that must last: more than those that one scatter is found from."""

SLIPPED_POSE_COUNT: Final = 5
"""Poses in a row that must agree that a vehicle slipped: single ones are off by noise alone."""

COMPARED_POSES: Final = 160
"""Poses, 8 s of them, over which measured way and odometry are compared."""

AVERAGED_POSES: Final = 10
"""Of these at the beginning and at the end, whose means are compared."""

LEAST_UNEXPLAINED_WAY: Final = 3e-3
"""Metres by which measured way and odometry may differ in that time without a cause."""

UNEXPLAINED_WAY_SHARE: Final = 0.2
"""The same as a share of the way: four times what wheels on a floor slip, see
`WHEEL_SLIP_SHARE`."""

SLIP_FORGETTING: Final = 0.999
"""Share of a slip found that is still expected a pose later: half of it after 35 s."""

FROZEN_POSE_COUNT: Final = 10
"""Poses equal in every digit, while the vehicle drives, that show a frozen measurement."""


@dataclass(frozen=True, slots=True, eq=False)
class VehiclePoseEstimate:
    """Where a vehicle is, as estimated.

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
    way, unexplained : ndarray, shape (2,)
        Way by odometry over the last `COMPARED_POSES`, and by how much the measured one differs
        from it, if that is more than noise and wheels on a floor explain, else 0; metres along x
        and y.
    """

    pose: Array
    position_sigma: float
    heading_sigma: float
    age: float
    refused: str = ""
    way: Array = field(default_factory=lambda: np.zeros(2))
    unexplained: Array = field(default_factory=lambda: np.zeros(2))


class VehiclePoseFilter:
    """An extended Kalman filter of one vehicle's pose, which drives along its heading.

    Between measured poses the odometry goes on. A pose further off than the vehicle may have
    driven at top speed since the last one that was taken, and five standard deviations, is
    refused. So is one that is older than the last, and one that never changes on the way. Poses
    that are refused for long may be a push, see `denied`: not if one was further off from the one
    before than `FASTEST_PUSH` explains.

    Measured poses count for as much as they are stated to, and for less where they are seen to
    scatter more. How much is read off the second differences of measured poses less odometry: the
    autocovariances of what is measured separate its noise from what drives the state (Mehra, On the
    identification of variances and adaptive Kalman filtering, 1970), and neither a push nor wheels
    that slip all the time add to the median of these differences.

    Parameters
    ----------
    settings : LocalisationSettings
        How well poses are measured at best. After its `lost` no more way is allowed for.
    top_speed : float
        Of the vehicle, m/s.
    top_turn_rate : float
        rad/s.
    """

    def __init__(
        self, settings: LocalisationSettings, top_speed: float, top_turn_rate: float
    ) -> None:
        place = settings.position_sigma
        self._stated = np.array((place, place, settings.heading_sigma))
        self.scatter = self._stated
        """Standard deviation that measured poses count with, metres and radians, shape (3,)."""
        self._bends: deque[Array] = deque(maxlen=FEWEST_POSES_FOR_SCATTER)
        self._slip_share, self._noisy_for, self._newest = WHEEL_SLIP_SHARE, 0, -inf
        self._top = np.array((top_speed, top_speed, top_turn_rate))
        self._push = FASTEST_PUSH * np.array((1.0, 1.0, top_turn_rate / top_speed))
        self._longest_gap = settings.lost
        self.begin_at(np.full(3, np.nan), -inf)

    @property
    def known(self) -> bool:
        """Whether a pose was ever taken."""
        return bool(np.isfinite(self._pose).all())

    def begin_at(self, pose: Array, time: float) -> None:
        """Begin with a pose that is known, at a time in seconds; NaN is a pose to be waited for."""
        self._pose, self._covariance = np.array(pose, dtype=float), np.diag(np.square(self.scatter))
        self._trail = np.array([(time, *self._pose)])
        self._taken, self._refused = time, ""
        self.denied: Array | None = None
        """Last measured pose if poses are refused as jumps that may be a push; shape (3,)."""
        self._last: tuple[float, ...] = ()
        self._equal, self._way, self._sudden = 0, 0.0, False
        self._jump: tuple[float, float, Array] | None = None
        self._taken_before: tuple[float, Array] | None = None
        self._step: Array | None = None
        self._steps, self._way_and_unexplained = np.zeros((0, 4)), np.zeros((2, 2))
        self._offs: deque[Array] = deque(maxlen=SLIPPED_POSE_COUNT)

    def update(
        self, time: float, period: float, odometry: Twist, measured: VehiclePose | None
    ) -> VehiclePoseEstimate:
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
        if self.known:
            self._predict_by_odometry(period, odometry)
            kept = self._trail[-MOST_KEPT_UPDATES + 1 :]
            self._trail = np.vstack((kept, (time, *self._pose)))
        if measured is None:
            self._refused = self._refused or "none comes"
        elif measured.time > self._newest:
            self._newest = measured.time
            self._correct_by_measured_pose(measured, time)
        return self.estimate(time)

    def estimate(self, time: float) -> VehiclePoseEstimate:
        """The estimate now."""
        sigma = np.sqrt(np.diag(self._covariance))
        age = time - self._taken
        late = age > self._longest_gap / 2
        refused = (self._refused or "none comes") if late else ""
        known = readonly_copy(self._pose), float(sigma[:2].max()), float(sigma[2]), age, refused
        return VehiclePoseEstimate(*known, *self._way_and_unexplained)

    @property
    def is_noisy(self) -> bool:
        """Whether measured poses scatter more than is stated."""
        return self._noisy_for >= NOISY_POSE_COUNT

    def _compare_way_with_odometry(self) -> None:
        """Find by how much the measured way differs without a known cause, and trust wheels so."""
        places = np.cumsum(self._steps, axis=0)
        went = places[-AVERAGED_POSES:].mean(0) - places[:AVERAGED_POSES].mean(0)
        off, way = went.reshape(2, 2)
        noise = self._place_noise() * sqrt(2 / AVERAGED_POSES)
        allowed = LEAST_UNEXPLAINED_WAY + UNEXPLAINED_WAY_SHARE * hypot(*way)
        self._slip_share = max(WHEEL_SLIP_SHARE, SLIP_FORGETTING * self._slip_share)
        if hypot(*off) < allowed + OUTLIER_SIGMAS * noise:
            off = np.zeros(2)
        elif hypot(*way) > LEAST_UNEXPLAINED_WAY:
            self._slip_share = max(self._slip_share, min(1.0, hypot(*off) / hypot(*way)))
        self._way_and_unexplained = np.array((way, off))

    def _predict_by_odometry(self, period: float, odometry: Twist) -> None:
        velocity = velocity_from_twist(odometry, self._pose[2] + odometry.turn_rate * period / 2)
        step = np.nan_to_num(velocity * period)
        self._pose = self._pose + step
        way = hypot(step[0], step[1])
        self._way += way
        turned = np.array(((1.0, 0.0, -step[1]), (0.0, 1.0, step[0]), (0.0, 0.0, 1.0)))
        across = (WHEEL_SLIP_ANGLE * way) ** 2 + ODOMETRY_NOISE[0] ** 2 * period
        turn = (WHEEL_SLIP_SHARE * step[2]) ** 2 + ODOMETRY_NOISE[1] ** 2 * period
        doubt = np.diag((across, across, turn))
        doubt[:2, :2] += (self._slip_share**2 - WHEEL_SLIP_ANGLE**2) * np.outer(step[:2], step[:2])
        self._covariance = turned @ self._covariance @ turned.T + doubt
        if self.denied is not None:
            self.denied = self.denied + step

    def _correct_by_measured_pose(self, measured: VehiclePose, time: float) -> None:
        found = np.array((measured.x, measured.y, measured.heading))
        if not np.isfinite((*found, measured.time)).all():
            self._refused = "not a number"
            return
        if not self.known:
            self.begin_at(found, time)
            return
        if self._is_frozen(found):
            self._refused = "frozen"
            return
        late = self._way_since(measured.time)
        off = found + late - self._pose
        off[2] = wrap_angle(off[2])
        gap = min(time - self._taken, self._longest_gap)
        noise = np.diag(np.square(self.scatter * (self._place_noise() / self.scatter[0])))
        spread = OUTLIER_SIGMAS * np.sqrt(np.diag(noise + self._covariance))
        reach = self._top * gap + np.abs(self._way_since(self._taken)).max() + spread
        if hypot(off[0], off[1]) > reach[0] or abs(off[2]) > reach[2]:
            since, before, last = self._jump or (time, self._taken, np.zeros(3))
            step, most = off - last, reach + self._push * (time - before)
            further = hypot(step[0], step[1]) > most[0] or abs(wrap_angle(step[2])) > most[2]
            self._sudden |= further and len(self._steps) >= AVERAGED_POSES
            self._jump, lasts = (since, time, off), time - since >= self._longest_gap
            self._refused = "jumped"
            self.denied = self._pose + off if lasts and not self._sudden else None
            return
        self._learn_scatter(found, measured.time)
        self._offs.append(off)
        agreed = np.abs(np.sum(np.sign(self._offs) * (np.abs(self._offs) > spread), axis=0))
        if agreed.max() == SLIPPED_POSE_COUNT:  # not as odometry has it, time and again: it slipped
            self._covariance = noise
            self._offs.clear()
        else:
            off = np.clip(off, -spread, spread)
            gain = self._covariance @ np.linalg.inv(self._covariance + noise)
            off, self._covariance = gain @ off, gain @ noise
        self._pose = self._pose + off
        self._trail[:, 1:] += off
        self._taken, self._refused, self.denied = time, "", None
        self._jump, self._sudden = None, False

    def _learn_scatter(self, found: Array, time: float) -> None:
        """Take the poses' scatter from how they bend away from the odometry."""
        before, self._taken_before = self._taken_before, (time, found)
        if before is None:
            return
        way = self._way_since(before[0]) - self._way_since(time)
        step = found - before[1] - way
        step[2] = wrap_angle(step[2])
        now = np.concatenate((step[:2], way[:2]))
        self._steps = np.vstack((self._steps[-COMPARED_POSES + 1 :], now))
        if len(self._steps) >= 2 * AVERAGED_POSES:
            self._compare_way_with_odometry()
        if self._step is not None:
            self._bends.append(step - self._step)
        self._step = step
        if len(self._bends) == FEWEST_POSES_FOR_SCATTER:
            # Weights 1, -2 and 1 of three independent poses.
            sigma = _median(np.abs(self._bends)) * MAD_TO_SIGMA / sqrt(6)
            place = hypot(sigma[0], sigma[1]) / sqrt(2)
            scatter = np.maximum(self._stated, (place, place, sigma[2]))
            worse = scatter / self.scatter
            if worse.max() > NOISY_SCATTER_RATIO:  # what was taken before was as noisy
                self._covariance = self._covariance * np.outer(worse, worse)
            self.scatter = scatter
            is_noisy = (scatter > NOISY_SCATTER_RATIO * self._stated).any()
            self._noisy_for = self._noisy_for + 1 if is_noisy else 0

    def _place_noise(self) -> float:
        """Standard deviation of measured places, metres; larger at once if the last scatter."""
        known = float(self.scatter[0])
        if len(self._steps) < AVERAGED_POSES:
            return known
        steps = self._steps[-AVERAGED_POSES:, :2]
        deviations = np.abs(steps - _median(steps))
        found = float(_median(deviations.ravel())) * MAD_TO_SIGMA / sqrt(2)
        return found if found > NOISY_SCATTER_RATIO * known else known

    def _way_since(self, time: float) -> Array:
        """Way from a time until now, shape (3,)."""
        times, poses = self._trail[:, 0], self._trail[:, 1:]
        k = int(np.searchsorted(times, time))
        if k in {0, len(times)}:
            return np.asarray(self._pose - poses[min(k, len(times) - 1)])
        share = (time - times[k - 1]) / (times[k] - times[k - 1])
        return np.asarray(self._pose - poses[k - 1] - share * (poses[k] - poses[k - 1]))

    def _is_frozen(self, found: Array) -> bool:
        """Whether the pose stayed the same in every digit while the vehicle drove."""
        if tuple(found) == self._last:
            self._equal += 1
        else:
            self._last, self._equal, self._way = tuple(found), 0, 0.0
        return self._equal >= FROZEN_POSE_COUNT and self._way > OUTLIER_SIGMAS * self.scatter[0]


def _median(values: Array) -> Array:
    """Median of a few rows; NumPy's own takes ten times as long."""
    middle = len(values) // 2
    rows = np.sort(values, axis=0)
    return np.asarray((rows[middle] + rows[-1 - middle]) / 2)


@dataclass(frozen=True, slots=True, eq=False)
class TeamEstimate:
    """Where the vehicles are, as estimated.

    Parameters
    ----------
    estimates : tuple of VehiclePoseEstimate
        One each.
    """

    estimates: tuple[VehiclePoseEstimate, ...]

    @property
    def poses(self) -> Array:
        """x, y, heading of each, shape (vehicles, 3)."""
        return np.array([one.pose for one in self.estimates])

    @property
    def sigmas(self) -> Array:
        """Standard deviations of position and heading, shape (vehicles, 2)."""
        return np.array([(one.position_sigma, one.heading_sigma) for one in self.estimates])


class TeamPoseFilter:
    """Filters of the vehicles' poses, one each, and a check of those that jumped.

    A vehicle may be pushed farther than it drives, and a measurement may jump, or take one
    vehicle for another. Where poses were refused for as long as `LocalisationSettings.lost`, they
    are taken after all if none was further off at once than a push explains, the cable reaches
    from one vehicle to the next, and no two bodies overlap; else the vehicle counts as lost. So
    does the welder in any case: it would weld on where it is taken to be.

    Parameters
    ----------
    cable : Cable
    team : TowingTeam
    settings : LocalisationSettings
    report : callable
        Receives events: a name and a sentence.
    """

    def __init__(
        self, cable: Cable, team: TowingTeam, settings: LocalisationSettings, report: EventListener
    ) -> None:
        self._cable, self._team, self._settings, self._report = cable, team, settings, report
        turn_rate = team.top_speed / team.body_radius
        self._filters = [
            VehiclePoseFilter(settings, team.top_speed, turn_rate) for _ in team.held_links
        ]
        self._refused = [""] * len(self._filters)
        self._noisy: set[int] = set()

    @property
    def unknown(self) -> tuple[int, ...]:
        """Vehicles without a pose yet."""
        return tuple(v for v, one in enumerate(self._filters) if not one.known)

    def update(
        self,
        time: float,
        period: float,
        odometry: Sequence[Twist],
        measured: Sequence[VehiclePose | None],
    ) -> TeamEstimate:
        """Go on to a time with what was measured since the last update."""
        found = [
            one.update(time, period, twist, pose)
            for one, twist, pose in zip(self._filters, odometry, measured, strict=True)
        ]
        late = [v for v, one in enumerate(found) if one.age > self._settings.lost]
        if late and self._accept_refused_poses(time, late, found):
            found = [one.estimate(time) for one in self._filters]
        self._report_changes(found)
        return TeamEstimate(tuple(found))

    def lost(self, estimate: TeamEstimate) -> dict[int, str]:
        """Vehicles whose poses are lost, and why in a word or two."""
        return {
            v: one.refused or "none comes"
            for v, one in enumerate(estimate.estimates)
            if one.age > self._settings.lost
        }

    def _accept_refused_poses(
        self, time: float, late: Sequence[int], found: list[VehiclePoseEstimate]
    ) -> bool:
        towing = [v for v in late if v != self._team.welder]
        denied = {v: pose for v in towing if (pose := self._filters[v].denied) is not None}
        poses = np.array([denied.get(v, one.pose) for v, one in enumerate(found)])
        if not denied or not self._is_possible_for_cable(poses):
            return False
        for v, pose in denied.items():
            x, y, turn = pose - found[v].pose
            way = f"{1e3 * hypot(x, y):.0f} mm and {degrees(abs(wrap_angle(turn))):.0f}°"
            self._filters[v].begin_at(pose, time)
            self._report("moved", f"vehicle {v + 1} was moved by {way}, and not by itself")
        return True

    def _is_possible_for_cable(self, poses: Array) -> bool:
        """Whether the cable reaches from each vehicle to the next, and no bodies overlap."""
        doubt = OUTLIER_SIGMAS * self._settings.position_sigma
        places = np.vstack((self._cable.root[:2], poses[:, :2]))
        lengths = self._cable.link_length * np.diff(self._team.held_links, prepend=-1)
        steps = np.diff(places, axis=0)
        if (np.hypot(steps[:, 0], steps[:, 1]) > lengths + doubt).any():
            return False
        apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=-1)
        np.fill_diagonal(apart, np.inf)
        return bool(apart.min() > 2 * self._team.body_radius - doubt)

    def _report_changes(self, found: Sequence[VehiclePoseEstimate]) -> None:
        for v, one in enumerate(found):
            if not self._filters[v].known:
                continue
            self._report_noise(v)
            if one.refused and not self._refused[v]:
                self._report("no pose", f"of vehicle {v + 1}: {one.refused}")
            elif self._refused[v] and not one.refused:
                self._report("pose again", f"of vehicle {v + 1}")
            self._refused[v] = one.refused

    def _report_noise(self, v: int) -> None:
        """Report poses that scatter more than the job states, and that they do so no more."""
        one, stated = self._filters[v], self._settings
        if one.is_noisy and v not in self._noisy:
            self._report(
                "noisy poses",
                f"of vehicle {v + 1}: they scatter by {1e3 * one.scatter[0]:.1f} mm and "
                f"{np.degrees(one.scatter[2]):.2f}°, and the job states "
                f"{1e3 * stated.position_sigma:.1f} mm and "
                f"{np.degrees(stated.heading_sigma):.2f}°. They count for less now",
            )
            self._noisy.add(v)
        elif not one.is_noisy:
            self._noisy.discard(v)
