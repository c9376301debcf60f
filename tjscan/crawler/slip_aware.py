"""Follow a joint with a vehicle that slips: learn how it slips, and steer by that in arc length."""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, exp, hypot, nan, sqrt, tau
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core.errors import CrawlStopped
from tjscan.core.frames import Array
from tjscan.core.units import MM, PER_M, SettingsTable
from tjscan.crawler.method import OffsetEstimate, TorchEstimate
from tjscan.crawler.slip_estimator import (
    BEND_SPACING,
    RIPPLE_STATES,
    SETTLING_LENGTH,
    SLIP_STATES,
    CrawlerGeometry,
    SlipEstimate,
    SlipEstimator,
    SlipStateIndex,
    SlipUncertainty,
    TrackOdometry,
    laser_offset,
)
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import AT_REST, Twist, VehicleState

AVERAGING_TIME: Final = 0.5
"""Seconds over which encoders are averaged about what was asked, at most."""

QUIET_TURN_RATE: Final = 5e-5
"""rad/s: standard deviation that the averaged turn rate may have. It is averaged no longer, for
drives that lag by more than assumed make what was asked wrong."""

NOISE_MEMORY_TIME, MOST_NOISE_STEP = 2.0, 4.0
"""Seconds over which the encoders' noise is learned, and how many times its variance one step
counts at most: the vehicle's own turns are no noise."""

RAMP_SPEED_DIFFERENCE: Final = 2e-3
RAMP_TURN_RATE_DIFFERENCE: Final = 10e-3
"""m/s and rad/s: encoders this far from what was asked show a ramp, not noise, and count alone."""

CREEPING_SPEED: Final = 1e-3
"""m/s: what is slower shows no curvature, its turn being divided by hardly anything."""

DRIVE_LAG: Final = 0.05
"""Seconds: time constant of the drives (assumption)."""

LIKELY_DELAY: Final = 0.04
"""Seconds over which a turn is late that is late by the delay of the odometry: half of 80 ms."""

MOST_SLIP_MISFIT: Final = 20.0
"""Of what was learned of slip, over its variance before anything was measured, summed over the
eight quantities: one vehicle of a hundred. A joint that is not as assumed comes to more."""

LEAST_YAW_EFFICIENCY: Final = 0.2
"""A vehicle that turned less would not be one that follows a joint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SteeringSettings(SettingsTable):
    """How fast the torch is led back to the joint, and how tightly the vehicle may turn.

    Parameters
    ----------
    gain : float
        1/m: an offset dies out as (1 + gain s) exp(-gain s) over the travel s. Both poles.
    least_radius : float
        Of a turn, metres: below it the tracks ask for more torque than the motors have.
    """

    gain: Annotated[float, Gt(0), Le(50), PER_M] = 8.0
    least_radius: Annotated[float, Ge(500), Le(1e6), MM] = 8.0


def track_turn_rate(
    x: Array,
    speed: float,
    geometry: CrawlerGeometry,
    settings: SteeringSettings,
    *,
    turns_back: bool = False,
) -> float:
    """Turn rate to ask of the tracks so that the torch comes to the joint and stays there.

    In arc length along the travel, with y the offset of the centre of rotation and m = s theta +
    crab its slope: dy = m, dm = curvature - curvature of the joint. The law gives both poles
    -gain, forward and backward alike, and ends with the torch, not the centre, on the joint.

    Parameters
    ----------
    x : ndarray, shape (22,)
        As `SlipStateIndex` orders it.
    speed : float
        Forward, m/s; nothing is steered if it is 0.
    geometry : CrawlerGeometry
    settings : SteeringSettings
    turns_back : bool, optional
        Whether it is about to turn back. It then keeps aside of the joint, by as much as the crab
        will carry it over while it takes its new heading.

    Returns
    -------
    float
        rad/s, as the encoders would show it.
    """
    if speed == 0.0:
        return 0.0
    way, gain = copysign(1.0, speed), settings.gain
    ahead = x[SlipStateIndex.ROTATION_CENTRE] + x[SlipStateIndex.SETTLED_CENTRE]
    arm = geometry.centre_to_torch + x[SlipStateIndex.FIXED_CENTRE] + way * ahead
    offset = x[SlipStateIndex.OFFSET] + arm * x[SlipStateIndex.HEADING]
    slope = (
        way * x[SlipStateIndex.HEADING] + x[SlipStateIndex.CRAB] + x[SlipStateIndex.UNSTEADY_CRAB]
    )
    # If it goes straight along the joint, it is turned by the crab: so is the torch.
    asked = -arm * way * x[SlipStateIndex.CRAB]
    if turns_back:
        asked -= 2 * x[SlipStateIndex.CRAB] / gain
    limit, off = 1 / settings.least_radius, offset - asked
    # From farther off it comes back more gently: the tightest turn could not brake in time.
    if gain**2 * abs(off) > limit:
        gain = sqrt(limit / abs(off))
    curvature = x[SlipStateIndex.CURVATURE] - 2 * gain * slope - gain**2 * off
    curvature = min(max(curvature, -limit), limit)
    turn = (curvature - x[SlipStateIndex.DRIFT] - x[SlipStateIndex.UNSTEADY_DRIFT]) * speed
    return float(turn / max(x[SlipStateIndex.YAW_EFFICIENCY], LEAST_YAW_EFFICIENCY))


class OdometryFilter:
    """The tracks' motion: what drives of a known lag make of a command, corrected by the encoders.

    Noise of the encoders would else bias the yaw efficiency, which multiplies it: errors in a
    regressor make its coefficient too small.

    Parameters
    ----------
    tracks : TrackGeometry, optional
        Whose chains ripple.
    """

    def __init__(self, tracks: TrackGeometry | None = None) -> None:
        self._speed = self._turn_rate = self._asked_turn_rate = self._late_turn_rate = 0.0
        self._way, self._recent_turn = 0.0, 0.0
        self._tracks, self._chains = tracks or TrackGeometry(), np.zeros(2)
        self._off, self._noise, self._shown = (0.0, 0.0), QUIET_TURN_RATE**2, 0.0

    def smooth(self, measured: Twist, period: float, commanded: Twist = AT_REST) -> TrackOdometry:
        """Motion over the period that has just passed.

        Parameters
        ----------
        measured : Twist
            What the encoders show.
        period : float
            Seconds.
        commanded : Twist
            What the drives were asked for meanwhile.
        """
        follow = min(period / DRIVE_LAG, 1.0)
        speed = self._speed + follow * (commanded.speed - self._speed)
        turn_rate = self._turn_rate + follow * (commanded.turn_rate - self._turn_rate)
        correct = self._share_of_encoders(measured.turn_rate - turn_rate, period)
        if abs(measured.speed - speed) > RAMP_SPEED_DIFFERENCE or (
            abs(measured.turn_rate - turn_rate) > RAMP_TURN_RATE_DIFFERENCE
        ):
            correct = 1.0
        self._speed = speed + correct * (measured.speed - speed)
        self._turn_rate = turn_rate + correct * (measured.turn_rate - turn_rate)
        late = min(period / LIKELY_DELAY, 1.0) * (self._turn_rate - self._late_turn_rate)
        self._late_turn_rate += late
        turned_back = False
        if abs(self._speed) > CREEPING_SPEED:
            way = copysign(1.0, self._speed)
            turned_back = way == -self._way
            if way != self._way:
                self._way, self._recent_turn = way, 0.0
            new = 1 - exp(-abs(self._speed) * period / SETTLING_LENGTH)
            self._recent_turn += new * (self._turn_rate / abs(self._speed) - self._recent_turn)
        self._asked_turn_rate += follow * (commanded.turn_rate - self._asked_turn_rate)
        self._chains += self._tracks.track_speeds(measured) * period
        return TrackOdometry(
            self._speed,
            self._turn_rate,
            period,
            self._recent_turn,
            turned_back,
            self._asked_turn_rate,
            max(self._noise, QUIET_TURN_RATE**2) if self._shown > NOISE_MEMORY_TIME else None,
            turn_rate_parts=(*self._turn_by_ripple(), -late / period),
        )

    def _share_of_encoders(self, off: float, period: float) -> float:
        """Share of what they are off by that counts: as much as leaves their noise quiet."""
        quiet = QUIET_TURN_RATE**2
        last, before = self._off
        step = min((off - 2 * last + before) ** 2 / 6, MOST_NOISE_STEP * max(self._noise, quiet))
        self._off = off, last
        if abs(self._speed) > CREEPING_SPEED:  # encoders at rest show nothing of it
            self._shown += period
            self._noise += min(period / NOISE_MEMORY_TIME, 1.0) * (step - self._noise)
        share = max(period / AVERAGING_TIME, 2 * quiet / (self._noise + quiet))
        return min(share, 1.0)

    def _turn_by_ripple(self) -> tuple[float, ...]:
        """What each chain's ripple of its whole speed would add to the turn rate, rad/s."""
        phases = 2 * np.pi / self._tracks.pad_pitch * self._chains
        shares = np.stack((np.cos(phases), np.sin(phases)), axis=1) * ((1.0,), (-1.0,))
        return tuple((self._speed / self._tracks.gauge * shares).ravel().tolist())


class SlipAwareMethod:
    """A `FollowingMethod` that knows slip, crab and the joint's curvature.

    Parameters
    ----------
    geometry : CrawlerGeometry
    estimate : SlipEstimate
        What is known at first: from a calibration, or `SlipEstimate.before_any_reading`.
    uncertainty : SlipUncertainty
    steering : SteeringSettings
    tracks : TrackGeometry, optional
    """

    def __init__(
        self,
        geometry: CrawlerGeometry,
        estimate: SlipEstimate,
        uncertainty: SlipUncertainty,
        steering: SteeringSettings,
        tracks: TrackGeometry | None = None,
    ) -> None:
        self._estimator = SlipEstimator(geometry, estimate, uncertainty)
        self._first, self._uncertainty, self._steering = estimate, uncertainty, steering
        self._tracks = tracks or TrackGeometry()
        self._odometry = OdometryFilter(self._tracks)

    @property
    def slip(self) -> SlipEstimate:
        """What is known now."""
        return self._estimator.estimate

    def move(self, state: VehicleState, period: float, commanded: Twist) -> tuple[float, float]:
        """Take in a period of motion; see `FollowingMethod.move`."""
        odometry = self._odometry.smooth(state.odometry, period, commanded)
        self._estimator.move(odometry)
        return self._estimator.read_inertial(state.gyro, state.down, period)

    def read(self, d: float, sigma: float) -> tuple[float, float]:
        """Take in a reading of the joint; see `FollowingMethod.read`."""
        return self._estimator.read(d, sigma)

    def follow_bend(self) -> bool:
        """Take the joint for one that bends here; see `FollowingMethod.follow_bend`."""
        bend, first = self.slip.bend, self._first.at_new_start(self._uncertainty)
        geometry = self._estimator.geometry
        if any(abs(one - geometry.laser_to_torch) < BEND_SPACING for one in bend):
            return False
        seen_from = self._estimator.seen_from
        known = first.with_bend(bend, geometry.laser_to_torch, seen_from)
        self._estimator = SlipEstimator(geometry, known, self._uncertainty)
        self._estimator.seen_from = seen_from
        return True

    def forget_place(self) -> None:
        """Forget where the vehicle is; see `FollowingMethod.forget_place`."""
        self._estimator.estimate = self.slip.at_new_start(self._uncertainty)
        self._odometry = OdometryFilter(self._tracks)
        self._estimator.smoother.restart()

    def check_slip(self) -> None:
        """Look whether a vehicle can slip as was learned; see `FollowingMethod.check_slip`."""
        first = SlipEstimate.before_any_reading(self._uncertainty)
        off = (self.slip.x[SLIP_STATES] - first.x[SLIP_STATES]) / np.sqrt(
            np.diag(first.P)[SLIP_STATES]
        )
        if off @ off > MOST_SLIP_MISFIT:
            worst = int(np.abs(off).argmax())
            name = SlipStateIndex(SLIP_STATES[worst]).name.lower().replace("_", " ")
            raise CrawlStopped(
                "joint bends",
                f"the vehicle would slip as none does: its {name} is {abs(off[worst]):.1f} "
                "standard deviations off what [slip] states. The joint bends otherwise than was "
                "found, or has a radius: look at it, state course.radius_m, or make "
                "alignment.length_mm longer. If the vehicle slips so, state more there",
            )

    def keep_state(self) -> None:
        """Keep the state of now; see `FollowingMethod.keep_state`."""
        known = self.slip
        self._estimator.smoother.keep(known.x, known.P, known.torch_shares)

    def smoothed_offsets(self) -> tuple[Array, Array]:
        """Offsets at the kept states; see `FollowingMethod.smoothed_offsets`."""
        offsets, sigmas = self._estimator.smoother.smooth()
        return offsets, np.hypot(sigmas, self._hidden_sigma)

    @property
    def laser_to_centre(self) -> tuple[float, float]:
        """Not known as the paper has it; see `FollowingMethod.laser_to_centre`."""
        return nan, nan

    @property
    def torch(self) -> TorchEstimate:
        """The estimated place of the torch."""
        known = self.slip
        shares, x = known.torch_shares, known.beside_joint(self._estimator.geometry)
        offset, heading = x[[SlipStateIndex.OFFSET, SlipStateIndex.HEADING]].tolist()
        sigma = hypot(sqrt(float(shares @ known.P @ shares)), self._hidden_sigma)
        return TorchEstimate(offset, sigma, heading)

    @property
    def _hidden_sigma(self) -> float:
        """Standard deviation of what no reading shows of the torch: a crab by the chains' ripple.

        As a pad comes on and another one leaves, the middle of a contact goes to and fro by a pitch
        as a sawtooth, and about it the vehicle turns to and fro with the ripple. The mean of that
        product carries it aside: to one side forward, to the other backward, as a heading does. So
        no reversal shows it. It goes by how both chains lie on their sprockets: by chance.
        """
        ripple = float(np.linalg.norm(self.slip.x[RIPPLE_STATES])) / self._tracks.gauge
        crab = self.slip.x[SlipStateIndex.YAW_EFFICIENCY] * ripple * self._tracks.pad_pitch
        return self._estimator.geometry.laser_to_torch * float(crab) / (sqrt(2) * tau)

    @property
    def laser(self) -> OffsetEstimate:
        """The estimated place of the laser."""
        offset, H = laser_offset(self.slip.x, self._estimator.geometry, self.slip.bend)
        return OffsetEstimate(offset, sqrt(float(H @ self.slip.P @ H)))

    def turn_rate(self, speed: float, *, turns_back: bool = False) -> float:
        """Turn rate to ask of the tracks; see `FollowingMethod.turn_rate`."""
        geometry = self._estimator.geometry
        x = self.slip.beside_joint(geometry)
        return track_turn_rate(x, speed, geometry, self._steering, turns_back=turns_back)
