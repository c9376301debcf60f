"""Steer along a joint by the estimated slip: state feedback in arc length."""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, sqrt
from typing import Annotated

from annotated_types import Ge, Gt, Le

from tjscan.core.frames import Array
from tjscan.core.units import MM, PER_M, SettingsTable
from tjscan.crawler.slip_model import CrawlerGeometry, SlipState


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
    x : ndarray, shape (11,)
        As `SlipState` orders it.
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
    ahead = x[SlipState.ROTATION_CENTRE] + x[SlipState.SETTLED_CENTRE]
    arm = geometry.centre_to_torch + way * ahead
    offset = x[SlipState.OFFSET] + arm * x[SlipState.HEADING]
    slope = way * x[SlipState.HEADING] + x[SlipState.CRAB] + x[SlipState.UNSTEADY_CRAB]
    # If it goes straight along the joint, it is turned by the crab: so is the torch.
    asked = -arm * way * x[SlipState.CRAB]
    if turns_back:
        asked -= 2 * x[SlipState.CRAB] / gain
    limit, off = 1 / settings.least_radius, offset - asked
    # From farther off it comes back more gently: the tightest turn could not brake in time.
    if gain**2 * abs(off) > limit:
        gain = sqrt(limit / abs(off))
    curvature = x[SlipState.CURVATURE] - 2 * gain * slope - gain**2 * off
    curvature = min(max(curvature, -limit), limit)
    turn = (curvature - x[SlipState.DRIFT] - x[SlipState.UNSTEADY_DRIFT]) * speed
    return float(turn / max(x[SlipState.YAW_EFFICIENCY], LEAST_EFFICIENCY))


LEAST_EFFICIENCY = 0.2
"""A vehicle that turned less would not be one that follows a joint."""
