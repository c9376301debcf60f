"""How a tracked vehicle that slips moves beside a joint, and its estimate from encoders and laser.

Derived from (1), (9) and (10) of Kermorgant (2018), and extended by what they leave out: yaw
efficiency, drift, crab, the centre of rotation that moves with the travel direction and with the
turn that came before, and a joint that bends. Turn rates and headings are positive clockwise as
seen from outside the hull, offsets to the right: vehicle minus joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import copysign, cos, exp, inf, remainder, sin, sqrt, tan, tau
from operator import mul
from typing import Annotated, Final, Self

import numpy as np
from annotated_types import Gt, Le

from tjscan.core.frames import Array
from tjscan.core.units import MM, MRAD, MRAD_S, SECONDS, SettingsTable
from tjscan.crawler.state_smoother import StateSmoother


class SlipStateIndex(IntEnum):
    """The place of each quantity in a state vector, shape (22,); what bends the joint comes after.

    OFFSET is the torch's from the joint, metres; HEADING the angle from the joint to the
    vehicle; ROTATION_CENTRE how far the centre of rotation is ahead of the vehicle's own, in
    travel direction, metres; YAW_EFFICIENCY the share of the tracks' turn rate that turns the
    vehicle; DRIFT its turn per metre when the tracks run alike, rad/m; CRAB its sideways travel per
    metre, whichever way it goes; CURVATURE the joint's, 1/m, positive to the right;
    TURNING_CRAB its sideways travel per radian of turn, metres. SETTLED_CENTRE is how much farther
    ahead than ROTATION_CENTRE the centre of rotation comes to be in a gentle turn that lasts,
    metres. FIXED_CENTRE is how far ahead it is whichever way the vehicle goes, metres, and
    TURNING_DRIFT the share by which the vehicle turns farther to the right than to the left: the
    weight presses some pads on and hangs off the vehicle's middle. The ripples are shares of the
    speed by which each chain runs faster and slower as its pads come on, as cosine and sine of the
    way from pad to pad. ODOMETRY_DELAY is how much later than shown the tracks turn, seconds:
    drives lag by more than assumed. GYRO_BIAS is in rad/s; JOINT_DOWN the direction of down from
    that of the joint, as the inclinometer shows it, radians, and INCLINOMETER_LAG the seconds by
    which that is damped. UNEVENNESS is how far to the left of its course the joint is where the
    laser sees it, metres: for `UNEVEN_LENGTH`, as its edges are cut. UNSTEADY_CRAB and
    UNSTEADY_DRIFT are what crab and drift differ from those for now, and forget over
    `SETTLING_LENGTH`.
    """

    OFFSET = 0
    HEADING = 1
    ROTATION_CENTRE = 2
    YAW_EFFICIENCY = 3
    DRIFT = 4
    CRAB = 5
    CURVATURE = 6
    TURNING_CRAB = 7
    SETTLED_CENTRE = 8
    FIXED_CENTRE = 9
    TURNING_DRIFT = 10
    LEFT_RIPPLE_COSINE = 11
    LEFT_RIPPLE_SINE = 12
    RIGHT_RIPPLE_COSINE = 13
    RIGHT_RIPPLE_SINE = 14
    ODOMETRY_DELAY = 15
    GYRO_BIAS = 16
    JOINT_DOWN = 17
    INCLINOMETER_LAG = 18
    UNEVENNESS = 19
    UNSTEADY_CRAB = 20
    UNSTEADY_DRIFT = 21


STATE_COUNT: Final = len(SlipStateIndex)

UNSTEADY_STATES: Final = [SlipStateIndex.UNSTEADY_CRAB, SlipStateIndex.UNSTEADY_DRIFT]
SLIP_STATES: Final = [*range(2, 6), *range(7, 11)]
"""What a vehicle's slip is described by, without what is off for now: from ROTATION_CENTRE to CRAB,
and from TURNING_CRAB to TURNING_DRIFT."""

TURNING_STATES: Final = [
    SlipStateIndex.YAW_EFFICIENCY,
    SlipStateIndex.DRIFT,
    SlipStateIndex.UNSTEADY_DRIFT,
]
"""What the turn rate is linear in."""

LASER_STATES: Final = [
    SlipStateIndex.OFFSET,
    SlipStateIndex.HEADING,
    SlipStateIndex.CURVATURE,
    SlipStateIndex.UNEVENNESS,
]
"""What a reading of the joint depends on."""

RIPPLE_STATES: Final = slice(
    SlipStateIndex.LEFT_RIPPLE_COSINE, SlipStateIndex.RIGHT_RIPPLE_SINE + 1
)
ODOMETRY_STATES: Final = slice(SlipStateIndex.LEFT_RIPPLE_COSINE, SlipStateIndex.ODOMETRY_DELAY + 1)
"""What the tracks' turn rate is wrong by."""

SIDEWAYS_STATE_INDICES: Final = [
    SlipStateIndex.HEADING,
    SlipStateIndex.ROTATION_CENTRE,
    SlipStateIndex.FIXED_CENTRE,
    SlipStateIndex.CRAB,
    SlipStateIndex.UNSTEADY_CRAB,
    SlipStateIndex.TURNING_CRAB,
    SlipStateIndex.SETTLED_CENTRE,
]
"""What the vehicle goes aside by, other than by how far it turns."""

SETTLING_LENGTH: Final = 0.1
"""Metres after which a track has forgotten how its feet were sheared: they leave at its end, at the
latest after its contact, and let go before where they slide (assumption)."""

UNEVEN_LENGTH: Final = 2.5e-3
"""Metres over which the joint's edges are off alike, before and after a place: what a cut wanders
by lasts for 5 mm in all (assumption). As noise of single readings it would count thirty times too
little."""

HALF_STICKING_CURVATURE: Final = 0.1
"""1/m: a turn in which most feet slide, so that half of what a turn that lasts shifts the centre of
rotation by is gone. Feet that stuck over a contact of 0.7 m would be sheared by 6 mm, and give way
by 1 mm (assumption)."""


@dataclass(frozen=True, slots=True)
class TrackOdometry:
    """What the tracks' encoders show of the vehicle's motion over a period.

    Parameters
    ----------
    speed : float
        Forward, m/s.
    turn_rate : float
        That of a vehicle that does not slip, rad/s.
    period : float
        Seconds.
    recent_turn : float, optional
        What such a vehicle turned per metre of its way lately, rad/m: the mean over the way since
        it last turned back, faded over `SETTLING_LENGTH`.
    turned_back : bool, optional
        Whether it now goes the other way than in the periods before.
    asked_turn_rate : float, optional
        The turn rate that the drives were asked for, by their lag: one without the encoders' noise;
        that of this period if left out.
    turn_rate_variance : float, optional
        Of the noise of the tracks' turn rate as the encoders show it, new in each period, (rad/s)²;
        if left out, that of `SlipUncertainty.turn_rate`.
    turn_rate_parts : tuple of float, optional
        What each of `ODOMETRY_STATES`, were it 1, would add to the turn rate, rad/s.
    """

    speed: float
    turn_rate: float
    period: float
    recent_turn: float = 0.0
    turned_back: bool = False
    asked_turn_rate: float | None = None
    turn_rate_variance: float | None = None
    turn_rate_parts: tuple[float, ...] = (0.0,) * 5


@dataclass(frozen=True, slots=True)
class CrawlerGeometry:
    """Where laser and torch sit on the vehicle.

    Parameters
    ----------
    laser_to_torch : float
        How far the laser's line is ahead of the torch, metres: D.
    centre_to_torch : float
        How far the vehicle's centre is ahead of the torch, metres: a0.
    """

    laser_to_torch: float
    centre_to_torch: float


def propagate_state(
    x: Array, odometry: TrackOdometry, geometry: CrawlerGeometry
) -> tuple[Array, Array]:
    """State after one period, and its derivative with respect to the state before.

    Parameters
    ----------
    x : ndarray, shape (n,)
        As `SlipStateIndex` orders it, and more that stays as it is.
    odometry : TrackOdometry
    geometry : CrawlerGeometry

    Returns
    -------
    x : ndarray, shape (n,)
    F : ndarray, shape (n, n)
    """
    q, heading, ahead, efficiency, drift, crab, curvature, turning_crab, settled = x[:9].tolist()
    fixed, turning_drift, *wrong, _, _, _, _, sways, veers = x[9:STATE_COUNT].tolist()
    u, dt = odometry.speed, odometry.period
    way = copysign(1.0, u) if u else 0.0
    wrongly = list(map(mul, wrong, odometry.turn_rate_parts))
    tracks_turn = odometry.turn_rate + sum(wrongly)
    # What goes by how much it turns, whichever way, is of what was asked: noise adds up there.
    asked_turn = (
        odometry.turn_rate if odometry.asked_turn_rate is None else odometry.asked_turn_rate
    )
    asked_turn += sum(wrongly[:-1])
    level = efficiency * asked_turn + (drift + veers) * u
    side = copysign(1.0, level) if level else 0.0
    turn = efficiency * tracks_turn + (drift + veers) * u + turning_drift * abs(level)
    most = abs(level) + turning_drift * level
    arm = geometry.centre_to_torch + fixed + way * ahead
    # Travel sideways: by heading, by crab, and as the torch swings round the centre of rotation.
    q += dt * (u * sin(heading) + (crab + sways) * abs(u) + turning_crab * most - turn * arm)
    # A turn that lasts shifts the centre farther, the less so the more feet slide.
    sticks = 1 / (1 + efficiency * abs(odometry.recent_turn) / HALF_STICKING_CURVATURE)
    turned = u * odometry.recent_turn * sticks
    q -= dt * settled * efficiency * turned
    kept = exp(-abs(u) * dt / SETTLING_LENGTH)
    after = x.copy()
    evenly = exp(-abs(u) * dt / UNEVEN_LENGTH)
    after[UNSTEADY_STATES] *= kept
    after[SlipStateIndex.UNEVENNESS] *= evenly
    after[SlipStateIndex.OFFSET] = q
    after[SlipStateIndex.HEADING] = heading + dt * (turn - curvature * u)
    after[SlipStateIndex.JOINT_DOWN] -= dt * curvature * u
    # How far it turns by each quantity of slip, and so goes aside with that.
    by_slip, by_level = np.zeros(STATE_COUNT), np.zeros(STATE_COUNT)
    by_slip[TURNING_STATES], by_level[TURNING_STATES] = (tracks_turn, u, u), (asked_turn, u, u)
    by_slip[ODOMETRY_STATES] = np.multiply(odometry.turn_rate_parts, efficiency)
    by_level[RIPPLE_STATES] = by_slip[RIPPLE_STATES]
    by_slip += side * turning_drift * by_level
    by_slip[SlipStateIndex.TURNING_DRIFT] = abs(level)
    by_level *= side + turning_drift
    by_level[SlipStateIndex.TURNING_DRIFT] = level
    F = np.eye(len(x))
    F[1, :STATE_COUNT] += dt * by_slip
    F[[SlipStateIndex.HEADING, SlipStateIndex.JOINT_DOWN], SlipStateIndex.CURVATURE] = -dt * u
    F[0, :STATE_COUNT] += dt * (turning_crab * by_level - arm * by_slip)
    F[0, SlipStateIndex.YAW_EFFICIENCY] -= dt * settled * turned * sticks
    F[0, SIDEWAYS_STATE_INDICES] = np.multiply(
        dt, (u * cos(heading), -turn * way, -turn, abs(u), abs(u), most, -efficiency * turned)
    )
    F[UNSTEADY_STATES, UNSTEADY_STATES] = kept
    F[SlipStateIndex.UNEVENNESS, SlipStateIndex.UNEVENNESS] = evenly
    return after, F


def bend_shares(places: Sequence[float], at: float) -> Array:
    """Share of each state of a bend in how far the joint is aside of its course at a place.

    The joint is straight between the bend's places, and goes on as straight beyond the last one.

    Parameters
    ----------
    places : sequence of float
        Of the k states along the joint, ascending; none, or two at least.
    at : float

    Returns
    -------
    ndarray, shape (k,)
    """
    shares = np.zeros(len(places))
    if len(places) and at > places[0]:
        last = min(int(np.searchsorted(places, at)), len(places) - 1)
        share = (at - places[last - 1]) / (places[last] - places[last - 1])
        shares[[last - 1, last]] = 1 - share, share
    return shares


def laser_offset(
    x: Array, geometry: CrawlerGeometry, bend: Sequence[float] = ()
) -> tuple[float, Array]:
    """Offset of the laser from the joint, and its derivative with respect to the state.

    Equation (1) of the paper, with the torch instead of the centre of rotation and a joint that
    bends: d = q + D tan(theta) - curvature D² / 2.

    Parameters
    ----------
    x : ndarray, shape (n,)
    geometry : CrawlerGeometry
    bend : sequence of float, optional
        As in `SlipEstimate`.

    Returns
    -------
    d : float
        Metres.
    H : ndarray, shape (n,)
    """
    D, slope = geometry.laser_to_torch, tan(x[SlipStateIndex.HEADING])
    H = np.zeros(len(x))
    H[LASER_STATES] = 1, D * (1 + slope**2), -D * D / 2, 1
    H[STATE_COUNT:] = -bend_shares(bend, D)
    offset, _, curvature, uneven = x[LASER_STATES].tolist()
    aside = float(H[STATE_COUNT:] @ x[STATE_COUNT:])
    return offset + D * slope - curvature * D * D / 2 + uneven + aside, H


STUDENT_DEGREES_OF_FREEDOM: Final = 4.0
"""Of Student's t distribution of a reading's error: what is farther off counts less."""

MATCHING_WINDOW_LENGTH: Final = 0.05
"""Metres over which differences between readings and what was expected are added up."""

MISFIT_MEMORY_LENGTH: Final = 0.15
"""Metres of such windows that show how unsteady slip is: three, so that what is learned scatters by
a factor of two, and a steady vehicle is known as one before the arc is struck."""

MOST_WINDOW_MISFIT: Final = 9.0
"""A window's misfit counts as no more: one that was disturbed shows little about the others."""

UNKNOWN_DIRECTION_SIGMA: Final = 2.0
"""Radians: of a direction of which nothing is known."""

UNSTEADINESS_BOUNDS: Final = (0.0003, 1.0)
"""Least and most that the variances of slip's changes are multiplied by: as stated they are what a
track does at most, and with none of them the filter would learn no more. The least is of pads that
give way by 17 µm instead of 1 mm, as rigid ones do: readings hardly show less."""

MOST_SIDEWAYS_SHARE: Final = 0.1
"""Metres by which torch or laser go aside at most while the vehicle goes on by one: by its slope
against the joint, and by how it turns."""

LIKELY_YAW_EFFICIENCY: Final = 0.75
"""Before anything was measured: pads give 0.5 to 0.75 in a turn, tracks that do not slip 1."""

INERTIAL_MEAN_TIME: Final = 1.0
"""Seconds over which what an inertial sensor is off by is averaged: no drive takes so long to do
what it is asked for, and a gyro's noise is small by then."""

LONGEST_INCLINOMETER_LAG: Final = 1.0
"""Seconds: none is damped for longer, and none is ahead of the turn."""

BEND_REACH, BEND_SPACING = 0.25, 10e-3
"""Metres to either side of where a bend showed within which the joint may bend, and metres between
the places there at which it is estimated."""

BEND_STEP, STRAIGHT_STEP = 0.2e-3, 0.02e-3
"""Metres by which the joint may be off the straight line through the last two places, as standard
deviations: in a bend (of a radius of half a metre), and behind what lies between two bends."""

Deviation = Annotated[float, Gt(0), Le(1000)]


@dataclass(frozen=True, slots=True, kw_only=True)
class SlipUncertainty(SettingsTable):
    """Standard deviations of slip: before anything was measured, and of its change over a metre.

    All defaults are assumptions, wide enough for dry and wet steel.

    Parameters
    ----------
    offset, heading, rotation_centre, yaw_efficiency, drift, crab, turning_crab : float
    settled_centre, fixed_centre, turning_drift, odometry_delay, gyro_bias, inclinometer_lag : float
        Before anything was measured; named as in `SlipStateIndex`, in its units.
    ripple : float
        Likewise, of each of the four ripples.
    gyro, down : float
        Of a gyro's turn rate over one second, rad/s, and of a direction of down, radians.
    rotation_centre_walk, yaw_efficiency_walk, drift_walk, crab_walk, turning_crab_walk : float
    settled_centre_walk, gyro_bias_walk, joint_down_walk : float
        Of the change over one metre of travel. They are of vehicle and hull, which change slowly;
        what differs for now is unsteady. A gyro's bias wanders with its temperature; the direction
        of down from the joint's as the plates are not straight, and by the inclinometer's own.
    unsteady_crab, unsteady_drift : float
        Of what crab and drift are off for now, going straight. By default what feet do that give
        way by 1 mm either way within a contact of 0.7 m, or of half of it to turn.
    unsteady_centre, unsteady_efficiency : float
        The same in a turn: how far off for now the centre of rotation and the yaw efficiency are.
        By default anything between a track without a sliding foot (a sixth of the contact ahead,
        0.75) and one that slides all over (none, 0.5) is as likely.
    turn_rate : float
        Of the tracks' turn rate, rad/s, over one second, until the encoders have shown it.
    unevenness : float
        Of a reading beyond its own, metres: the plates' edges are cut, not ground.
    """

    offset: Annotated[Deviation, MM] = 8e-3
    heading: Annotated[Deviation, MRAD] = 25e-3
    rotation_centre: Annotated[Deviation, MM] = 80e-3
    yaw_efficiency: Deviation = 0.15
    drift: Annotated[Deviation, MRAD] = 10e-3
    crab: Annotated[Deviation, MRAD] = 6e-3
    turning_crab: Annotated[Deviation, MM] = 80e-3
    settled_centre: Annotated[Deviation, MM] = 80e-3
    fixed_centre: Annotated[Deviation, MM] = 30e-3
    turning_drift: Deviation = 0.05
    ripple: Deviation = 3e-3
    odometry_delay: Annotated[Deviation, SECONDS] = 0.05
    gyro_bias: Annotated[Deviation, MRAD_S] = 2e-3
    inclinometer_lag: Annotated[Deviation, SECONDS] = 0.2
    gyro: Annotated[Deviation, MRAD_S] = 2e-4
    down: Annotated[Deviation, MRAD] = 1e-3
    rotation_centre_walk: Annotated[Deviation, MM] = 10e-3
    yaw_efficiency_walk: Deviation = 0.01
    drift_walk: Annotated[Deviation, MRAD] = 0.2e-3
    crab_walk: Annotated[Deviation, MRAD] = 0.1e-3
    turning_crab_walk: Annotated[Deviation, MM] = 10e-3
    settled_centre_walk: Annotated[Deviation, MM] = 10e-3
    gyro_bias_walk: Annotated[Deviation, MRAD_S] = 0.02e-3
    joint_down_walk: Annotated[Deviation, MRAD] = 0.5e-3
    unsteady_crab: Annotated[Deviation, MRAD] = 0.8e-3
    unsteady_drift: Annotated[Deviation, MRAD] = 2.4e-3
    unsteady_centre: Annotated[Deviation, MM] = 34e-3
    unsteady_efficiency: Deviation = 0.07
    turn_rate: Deviation = 4e-5
    unevenness: Annotated[Deviation, MM] = 0.02e-3


@dataclass(frozen=True, slots=True, eq=False)
class SlipEstimate:
    """What is known of a vehicle beside a joint: a state and its covariance.

    Parameters
    ----------
    x : ndarray, shape (22 + k,)
        As `SlipStateIndex` orders it; then how far to the right the joint is, metres, of the course
        that it has before it bends, at each place of `bend`.
    P : ndarray, shape (22 + k, 22 + k)
        Its covariance.
    bend : tuple of float, optional
        How far along the joint from the torch each of these places is, metres, ascending.
    """

    x: Array
    P: Array
    bend: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.x) != STATE_COUNT + len(self.bend):
            raise ValueError(f"{len(self.x)} states with {len(self.bend)} of a bend")
        object.__setattr__(self, "P", np.reshape(self.P, (len(self.x), len(self.x))))

    @classmethod
    def before_any_reading(
        cls, uncertainty: SlipUncertainty, *, curvature: float = 0.0, curvature_sigma: float = 1e-6
    ) -> Self:
        """What is known before anything was measured.

        Parameters
        ----------
        uncertainty : SlipUncertainty
        curvature, curvature_sigma : float, optional
            Of the joint, 1/m, as the job states them.
        """
        x = np.zeros(STATE_COUNT)
        x[SlipStateIndex.YAW_EFFICIENCY] = LIKELY_YAW_EFFICIENCY
        x[SlipStateIndex.CURVATURE] = curvature
        sigmas = [getattr(uncertainty, one.name.lower(), curvature_sigma) for one in SlipStateIndex]
        sigmas[ODOMETRY_STATES] = [*[uncertainty.ripple] * 4, uncertainty.odometry_delay]
        sigmas[SlipStateIndex.JOINT_DOWN] = UNKNOWN_DIRECTION_SIGMA
        return cls(x, np.diag(np.square(sigmas)))

    @property
    def torch_shares(self) -> Array:
        """Derivative of the torch's offset from the joint with respect to the state, shape (n,)."""
        shares = np.zeros(len(self.x))
        shares[SlipStateIndex.OFFSET] = 1.0
        shares[STATE_COUNT:] = -bend_shares(self.bend, 0.0)
        return shares

    @property
    def bends(self) -> list[tuple[float, float, float, float]]:
        """From where to where along the joint it bends; how far aside, and its sigma; metres each.

        That is the farthest to the right of the straight line through the bend's first two places.
        """
        found, ends = [], np.flatnonzero(np.diff(self.bend) > 2 * BEND_SPACING) + 1
        for k in np.split(np.arange(len(self.bend)), ends) if self.bend else ():
            at, own = np.array(self.bend)[k], STATE_COUNT + k
            along = (at - at[0]) / (at[1] - at[0])
            shares = np.eye(len(k))
            shares[:, 0] -= 1 - along
            shares[:, 1] -= along
            aside, P = shares @ self.x[own], shares @ self.P[np.ix_(own, own)] @ shares.T
            far = int(np.abs(aside).argmax())
            found.append((at[0], at[-1], float(aside[far]), sqrt(max(P[far, far], 0.0))))
        return found

    def beside_joint(self, geometry: CrawlerGeometry) -> Array:
        """State as it is against the joint where the torch is, and not against its course, (n,).

        The joint's direction is that from the torch to what the laser sees: a vehicle that follows
        that makes up for a short bend before it comes there.
        """
        x = self.x.copy()
        x[SlipStateIndex.OFFSET] = self.torch_shares @ x
        ahead = bend_shares(self.bend, geometry.laser_to_torch) - bend_shares(self.bend, 0.0)
        x[SlipStateIndex.HEADING] -= float(ahead @ x[STATE_COUNT:]) / geometry.laser_to_torch
        return x

    def with_bend(self, before: tuple[float, ...], at: float, seen_from: float = -inf) -> Self:
        """The same of a joint that bends, too, at a place.

        Parameters
        ----------
        before : tuple of float
            Of places at which it bends already, as in `bend`.
        at : float
            Along the joint from the torch, metres.
        seen_from : float, optional
            The first place that the laser saw: before it nothing can show a bend.
        """
        reach = at + np.arange(-BEND_REACH, BEND_REACH, BEND_SPACING)
        reach = reach[reach > seen_from]
        new = [x for x in reach if all(abs(x - one) > BEND_SPACING / 2 for one in before)]
        places = tuple(sorted((*before, *new)))
        n, shares = STATE_COUNT, np.zeros((len(places), len(places)))
        x, P = np.zeros(n + len(places)), np.zeros((n + len(places),) * 2)
        x[:n], P[:n, :n] = self.x[:n], self.P[:n, :n]
        for k in range(2, len(places)):
            # On a straight line with the two before, and a step of its own.
            shares[k] = bend_shares(places[:k], places[k]) @ shares[:k]
            gap = places[k] - places[k - 1] > 2 * BEND_SPACING
            shares[k, k] = STRAIGHT_STEP if gap else BEND_STEP
        P[n:, n:] = shares @ shares.T
        return type(self)(x, P, places)

    def sigma(self, which: SlipStateIndex) -> float:
        """Standard deviation of one quantity."""
        return sqrt(self.P[which, which])

    def at_new_start(self, uncertainty: SlipUncertainty, moved: float | None = None) -> Self:
        """What stays known if the vehicle is set down again: how it slips, not where it is.

        Nor in which direction the joint runs there, nor how its chains lie on their sprockets.

        Parameters
        ----------
        uncertainty : SlipUncertainty
        moved : float, optional
            How far it was moved along the joint, metres; if left out, no bend is known any more.
        """
        new = type(self).before_any_reading(uncertainty)
        place: list[int] = [
            SlipStateIndex.OFFSET,
            SlipStateIndex.HEADING,
            SlipStateIndex.JOINT_DOWN,
            SlipStateIndex.UNEVENNESS,
            *range(SlipStateIndex.LEFT_RIPPLE_COSINE, SlipStateIndex.RIGHT_RIPPLE_SINE + 1),
        ]
        bend = () if moved is None else tuple(one - moved for one in self.bend)
        kept = slice(STATE_COUNT + len(bend))
        x, P = self.x[kept].copy(), self.P[kept, kept].copy()
        x[place], P[place, :], P[:, place] = 0.0, 0.0, 0.0
        P[place, place] = new.P[place, place]
        return type(self)(x, P, bend)

    def with_unseen_travel(self, way: float, least_radius: float) -> Self:
        """What is still known if the vehicle went on by up to a way that was not seen.

        It may have turned there as tightly as it is ever steered, and gone aside with that. Without
        this doubt the next reading would contradict the estimate, and lead it astray.

        Parameters
        ----------
        way : float
            Metres.
        least_radius : float
            Of the tightest turn, metres.
        """
        P = self.P.copy()
        P[SlipStateIndex.OFFSET, SlipStateIndex.OFFSET] += (MOST_SIDEWAYS_SHARE * way) ** 2
        P[SlipStateIndex.HEADING, SlipStateIndex.HEADING] += (way / least_radius) ** 2
        return type(self)(self.x, P, self.bend)


class SlipEstimator:
    """Extended Kalman filter of `SlipStateIndex`; it learns through reversals and passes.

    How much slip changes differs from hull to hull, and a filter with wrong values states a wrong
    sigma. So it learns that too, by matching covariances (Mehra 1972): differences between
    readings and what was expected, each over its standard deviation, are white if the noise is
    right; the square of their sum over a window, over their number, is 1 in the mean. It is more
    if slip changes more than assumed, and less if it changes less.

    Parameters
    ----------
    geometry : CrawlerGeometry
        Where laser and torch sit.
    estimate : SlipEstimate
        What is known at first.
    uncertainty : SlipUncertainty
        How slip changes, and how uneven the joint is.

    Attributes
    ----------
    unsteadiness : float
        By how much the variances of slip's changes are multiplied, as learned.
    smoother : StateSmoother
        Which takes in each step.
    seen_from : float
        How far ahead of the torch the first place is that the laser was over, metres.
    """

    def __init__(
        self, geometry: CrawlerGeometry, estimate: SlipEstimate, uncertainty: SlipUncertainty
    ) -> None:
        self.geometry, self.estimate, self._uncertainty = geometry, estimate, uncertainty
        walks = [getattr(uncertainty, f"{one.name.lower()}_walk", 0.0) for one in SlipStateIndex]
        self._walk_per_metre = np.square(walks)
        self._turns = 0.0
        self.unsteadiness = 1.0
        self._turn = self._damped_turn = self._left = self._aside = 0.0
        self._by_turn = np.zeros(STATE_COUNT)
        self.smoother = StateSmoother()
        self.seen_from = geometry.laser_to_torch
        self._misfit, self._readings, self._window = 0.0, 0, 0.0

    def move(self, odometry: TrackOdometry) -> None:
        """Go on by one period in which the tracks moved as the encoders show."""
        if odometry.turned_back:
            self._forget_unsteady_slip()
        x, F = propagate_state(self.estimate.x, odometry, self.geometry)
        self.smoother.add_move(F)
        self._by_turn = F[SlipStateIndex.HEADING] / odometry.period
        self._by_turn[[SlipStateIndex.HEADING, SlipStateIndex.CURVATURE]] = 0.0
        gone = x - self.estimate.x
        turned = gone[SlipStateIndex.HEADING] - gone[SlipStateIndex.JOINT_DOWN]
        self._turn = turned / odometry.period
        P = F @ self.estimate.P @ F.T
        travel = abs(odometry.speed) * odometry.period
        kept = float(F[SlipStateIndex.UNSTEADY_DRIFT, SlipStateIndex.UNSTEADY_DRIFT])
        efficiency = float(self.estimate.x[SlipStateIndex.YAW_EFFICIENCY])
        by_turn = np.array([0.0, odometry.period]) * efficiency
        if odometry.speed:
            by_turn = F[:2, SlipStateIndex.DRIFT] / odometry.speed * efficiency
            curvature = efficiency * odometry.turn_rate / odometry.speed
            self._turns = kept * self._turns + (1 - kept) * curvature
        changes = self._walk_per_metre * travel
        # Variances of unsteady slip stay what they should be.
        changes[UNSTEADY_STATES] += (1 - kept**2) * np.array(self._unsteady_variances())
        changes *= self.unsteadiness
        uneven = SlipStateIndex.UNEVENNESS
        changes[uneven] = (1 - F[uneven, uneven] ** 2) * self._uncertainty.unevenness**2
        P[np.diag_indices(STATE_COUNT)] += changes
        variance = odometry.turn_rate_variance
        if variance is None:  # the spectral density of white noise does not depend on the period
            variance = self._uncertainty.turn_rate**2 / odometry.period
        P[:2, :2] += np.outer(by_turn, by_turn) * variance
        way = odometry.speed * odometry.period
        bend = tuple(place - way for place in self.estimate.bend)
        self.seen_from = min(self.seen_from - way, self.geometry.laser_to_torch)
        self.estimate = SlipEstimate(x, (P + P.T) / 2, bend)
        self._window += travel
        if self._window >= MATCHING_WINDOW_LENGTH:
            self._match_covariances()

    def _forget_unsteady_slip(self) -> None:
        """Take what slip was off by for as unknown: of the other way it shows nothing.

        A reversal shears every foot the other way, so it is as uncertain as a track makes it.
        """
        kept = np.ones(len(self.estimate.x))
        kept[UNSTEADY_STATES] = 0.0
        P = self.estimate.P * np.outer(kept, kept)
        P[UNSTEADY_STATES, UNSTEADY_STATES] = self._unsteady_variances()
        self.smoother.add_move(np.diag(kept))
        self.estimate = SlipEstimate(self.estimate.x * kept, P, self.estimate.bend)

    def _match_covariances(self) -> None:
        """Learn from a window how unsteady the slip is."""
        if self._readings:
            misfit = min(self._misfit**2 / self._readings, MOST_WINDOW_MISFIT)
            learned = self.unsteadiness * exp((misfit - 1) * self._window / MISFIT_MEMORY_LENGTH)
            self.unsteadiness = min(max(learned, UNSTEADINESS_BOUNDS[0]), UNSTEADINESS_BOUNDS[1])
        self._misfit, self._readings, self._window = 0.0, 0, 0.0

    def _unsteady_variances(self) -> tuple[float, float]:
        """Variances of unsteady crab and drift at the curvature that the track remembers.

        In a turn the feet shear and slide the more the tighter it is, and go on doing so until
        they have left.
        """
        own = self._uncertainty
        crab = own.unsteady_crab**2 + (own.unsteady_centre * self._turns) ** 2
        drift = own.unsteady_drift**2 + (own.unsteady_efficiency * self._turns) ** 2
        return crab, drift

    def read(self, d: float, sigma: float) -> tuple[float, float]:
        """Take in a reading of the joint.

        Parameters
        ----------
        d : float
            Laser minus joint, metres.
        sigma : float
            Its standard deviation.

        Returns
        -------
        surprise : float
            How far it is off from what was expected, metres, as far as the estimate's own
            uncertainty does not explain it; nothing of it is weighed down.
        aside : float
            How far readings went aside, metres, by more than the vehicle's motion between them
            explains: what the estimate makes of each of them is left out.
        """
        expected, H = laser_offset(self.estimate.x, self.geometry, self.estimate.bend)
        variance, off = sigma**2, d - expected
        known = float(H @ self.estimate.P @ H) + variance
        self._misfit += off / sqrt(known)
        self._readings += 1
        self._correct(off, H, variance)
        # What the corrected estimate left of the last reading was known before this one.
        self._aside += off - self._left
        self._left = d - laser_offset(self.estimate.x, self.geometry, self.estimate.bend)[0]
        own = min((variance + self._uncertainty.unevenness**2) / known, 1.0)
        return off * sqrt(own), self._aside

    def read_inertial(
        self, gyro: Sequence[float], down: Sequence[float], period: float
    ) -> tuple[float, float]:
        """Take in samples of the inertial sensors after a period in seconds.

        Parameters
        ----------
        gyro, down : sequence of float
            As in `VehicleState`.

        Returns
        -------
        tuple of float
            Of each how far a sample was off, over the deviation of a mean; 0 without one.
        """
        misfits, own = [0.0, 0.0], self._uncertainty
        for rate in gyro:
            H = self._by_turn.copy()
            H[SlipStateIndex.GYRO_BIAS] = 1.0
            off = rate - self._turn - self.estimate.x[SlipStateIndex.GYRO_BIAS]
            misfits[0] = self._correct_inertially(off, H, own.gyro**2 / period, period)
        for angle in down:
            H = np.zeros(len(self.estimate.x))
            lag = SlipStateIndex.INCLINOMETER_LAG
            # A damped one is behind by its time constant times the turn rate, damped likewise.
            share = period / max(float(self.estimate.x[lag]), period)
            self._damped_turn += share * (self._turn - self._damped_turn)
            H[[SlipStateIndex.JOINT_DOWN, SlipStateIndex.HEADING]] = 1.0, -1.0
            H[lag] = self._damped_turn
            off = remainder(angle - float(H @ self.estimate.x), tau)
            misfits[1] = self._correct_inertially(off, H, own.down**2, period)
            self.estimate.x[lag] = min(max(self.estimate.x[lag], 0.0), LONGEST_INCLINOMETER_LAG)
        return misfits[0], misfits[1]

    def _correct_inertially(self, off: float, H: Array, variance: float, period: float) -> float:
        """Take in a sample; returns what it is off by over the deviation of such means."""
        mean_variance = variance * period / INERTIAL_MEAN_TIME + float(H @ self.estimate.P @ H)
        self._correct(off, H, variance)
        return off / sqrt(mean_variance)

    def _correct(self, difference: float, H: Array, variance: float) -> None:
        """Take in a measurement that differs from what was expected."""
        x, P = self.estimate.x, self.estimate.P
        PH = P @ H
        before = float(H @ PH)
        off = difference**2 / (before + variance)
        nu = STUDENT_DEGREES_OF_FREEDOM
        variance *= (nu + off) / (nu + 1) if off > 1 else 1.0
        gain = PH / (before + variance)
        self.smoother.add_reading(H, gain, difference, before + variance)
        after = x + gain * difference, P - np.outer(gain, PH)
        self.estimate = SlipEstimate(*after, self.estimate.bend)
