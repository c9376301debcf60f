"""How a tracked vehicle that slips moves beside a joint, and what its laser sees of that.

Derived from (1), (9) and (10) of Kermorgant (2018), and extended by what they leave out: yaw
efficiency, drift, crab, the centre of rotation that moves with the travel direction and with the
turn that came before, and a joint that bends. Turn rates and headings are positive clockwise as
seen from outside the hull, offsets to the right: vehicle minus joint.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import copysign, cos, exp, sin, tan
from typing import Final

import numpy as np

from tjscan.core.frames import Array


class SlipState(IntEnum):
    """The place of each quantity in a state vector, shape (11,).

    OFFSET is that of the torch from the joint, metres; HEADING the angle from the joint to the
    vehicle; ROTATION_CENTRE how far the centre of rotation lies ahead of the vehicle's own, in
    travel direction, metres; YAW_EFFICIENCY the share of the tracks' turn rate that turns the
    vehicle; DRIFT its turn per metre when the tracks run alike, rad/m; CRAB its sideways travel per
    metre, whichever way it goes; CURVATURE that of the joint, 1/m, positive to the right;
    TURNING_CRAB its sideways travel per radian of turn, metres. SETTLED_CENTRE is how much farther
    ahead than ROTATION_CENTRE the centre of rotation comes to lie in a gentle turn that lasts,
    metres. UNSTEADY_CRAB and UNSTEADY_DRIFT are what crab and drift differ from those for now, and
    forget over `SETTLING_LENGTH`.
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
    UNSTEADY_CRAB = 9
    UNSTEADY_DRIFT = 10


STATE_COUNT: Final = len(SlipState)

SETTLING_LENGTH: Final = 0.1
"""Metres after which a track has forgotten how its feet were sheared: they leave at its end, at the
latest after its contact, and let go before where they slide (assumption)."""

TIGHT_CURVATURE: Final = 0.1
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
    """

    speed: float
    turn_rate: float
    period: float
    recent_turn: float = 0.0
    turned_back: bool = False


@dataclass(frozen=True, slots=True)
class CrawlerGeometry:
    """Where laser and torch sit on the vehicle.

    Parameters
    ----------
    laser_to_torch : float
        How far the laser's line lies ahead of the torch, metres: D.
    centre_to_torch : float
        How far the vehicle's centre lies ahead of the torch, metres: a0.
    """

    laser_to_torch: float
    centre_to_torch: float


def propagate_state(
    x: Array, odometry: TrackOdometry, geometry: CrawlerGeometry
) -> tuple[Array, Array]:
    """State after one period, and its derivative with respect to the state before.

    Parameters
    ----------
    x : ndarray, shape (11,)
        As `SlipState` orders it.
    odometry : TrackOdometry
    geometry : CrawlerGeometry

    Returns
    -------
    x : ndarray, shape (11,)
    F : ndarray, shape (11, 11)
    """
    q, heading, ahead, efficiency, drift, crab, curvature, turning_crab, settled, sways, veers = (
        x.tolist()
    )
    u, dt = odometry.speed, odometry.period
    way = copysign(1.0, u) if u else 0.0
    turn = efficiency * odometry.turn_rate + (drift + veers) * u
    arm = geometry.centre_to_torch + way * ahead
    # Travel sideways: by heading, by crab, and as the torch swings round the centre of rotation.
    q += dt * (u * sin(heading) + (crab + sways) * abs(u) + turning_crab * abs(turn) - turn * arm)
    # A turn that lasts shifts the centre farther, the less so the more feet slide.
    sticks = 1 / (1 + efficiency * abs(odometry.recent_turn) / TIGHT_CURVATURE)
    turned = u * odometry.recent_turn * sticks
    q -= dt * settled * efficiency * turned
    kept = exp(-abs(u) * dt / SETTLING_LENGTH)
    after = x.copy()
    after[SlipState.UNSTEADY_CRAB :] *= kept
    after[SlipState.OFFSET] = q
    after[SlipState.HEADING] = heading + dt * (turn - curvature * u)
    F = np.eye(STATE_COUNT)
    by_turn = turning_crab * (copysign(1.0, turn) if turn else 0.0) - arm
    F[0, 1:] = (
        dt * u * cos(heading),
        -dt * turn * way,
        dt * (by_turn * odometry.turn_rate - settled * turned * sticks),
        dt * by_turn * u,
        dt * abs(u),
        0.0,
        dt * abs(turn),
        -dt * efficiency * turned,
        dt * abs(u),
        dt * by_turn * u,
    )
    F[1, 3:5] = dt * odometry.turn_rate, dt * u
    F[1, 6] = -dt * u
    F[1, SlipState.UNSTEADY_DRIFT] = dt * u
    F[9, 9] = F[10, 10] = kept
    return after, F


def laser_offset(x: Array, geometry: CrawlerGeometry) -> tuple[float, Array]:
    """Offset of the laser from the joint, and its derivative with respect to the state.

    Equation (1) of the paper, with the torch instead of the centre of rotation and a joint that
    bends: d = q + D tan(theta) - curvature D² / 2.

    Parameters
    ----------
    x : ndarray, shape (11,)
    geometry : CrawlerGeometry

    Returns
    -------
    d : float
        Metres.
    H : ndarray, shape (11,)
    """
    D, slope = geometry.laser_to_torch, tan(x[SlipState.HEADING])
    H = np.zeros(STATE_COUNT)
    states = [SlipState.OFFSET, SlipState.HEADING, SlipState.CURVATURE]
    H[states] = 1, D * (1 + slope**2), -D * D / 2
    return float(x[SlipState.OFFSET] + D * slope - x[SlipState.CURVATURE] * D * D / 2), H
