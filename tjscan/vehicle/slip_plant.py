"""Truth of a vehicle whose tracks slip by given ratios.

Longitudinal slip, yaw efficiency, yaw drift, crab and an instantaneous centre of rotation that
is ahead in the direction of travel.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, cos, pi, radians, sin
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core.frames import Array, readonly_copy
from tjscan.core.units import DEG, MM, FileUnit, SettingsTable
from tjscan.vehicle.pad_plant import GRAVITY_M_S2, PadSettings
from tjscan.vehicle.tracks import TrackGeometry, moved_pose

MERRITT_COEFFICIENTS: Final = (0.925, 0.15)
"""Of Merritt's formula, as Wong, Theory of Ground Vehicles, prints it."""


class TrackLoad:
    """Torques of a climb and of a turn, in closed form.

    The weight along the tracks is borne by both alike. A turn is resisted by the moment
    mu_t N L / 4 of pads that slide sideways under the normal force N over the length L, with
    Merritt's mu_t = mu / (0.925 + 0.15 R / b) for the radius R and the gauge b. The pads take some
    way to be sheared, here an L: the moment follows over the way of the tracks.

    Parameters
    ----------
    pads : PadSettings
        Friction, grip, weight, and the surface's inclination.
    tracks : TrackGeometry
    """

    def __init__(self, pads: PadSettings, tracks: TrackGeometry) -> None:
        self._pads, self._tracks = pads, tracks
        weight = pads.mass * GRAVITY_M_S2
        self._along = weight * sin(pads.inclination)
        pressed = 2 * pads.pads * pads.grip * GRAVITY_M_S2 + weight * cos(pads.inclination)
        self._most = pads.friction * pressed * pads.contact_length / 4
        self._moment = 0.0

    def advance(self, left: float, right: float) -> None:
        """Let the left and right track run by some metres."""
        run, turn = abs(left) + abs(right), left - right
        if run == 0.0:
            return
        # R / b = |left + right| / 2 |turn|, multiplied out: straight on there is no R.
        own, by_radius = MERRITT_COEFFICIENTS
        wanted = self._most * turn / (own * abs(turn) + by_radius * abs(left + right) / 2)
        share = min(run / 2 / self._pads.contact_length, 1.0)
        self._moment += share * (wanted - self._moment)

    def torques(self, heading: float) -> tuple[float, float]:
        """Torque of the left and right motor at its sprocket, N m, in the sense of its rate.

        Parameters
        ----------
        heading : float
            Of the vehicle on the surface, from x of frame w towards y, radians.
        """
        climb = -self._along * cos(self._pads.down - heading) / 2
        turn = self._moment / self._tracks.gauge
        radius = self._tracks.sprocket_radius
        return radius * (climb + turn), -radius * (climb - turn)


DEG_PER_M: Final = FileUnit("deg_per_m", radians(1.0))

SLIPPING_YAW_DRIFT: Final = 0.01
"""rad/m: what unequal tracks turn a vehicle that slips at all and drives straight on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlipSettings(SettingsTable):
    """The table [simulation.vehicle.slip]: how the tracks slip, by one ratio or by each number.

    What is left out follows from the ratio p.

    Parameters
    ----------
    ratio : float
        p, 0 to 0.5: nothing slips if it is 0.
    longitudinal : float, optional
        Share of the tracks' speed that is lost; p / 10.
    yaw_efficiency : float, optional
        Mean of η, the turn rate over the encoders' one; 1 - p.
    yaw_variation : float, optional
        How far η swings along the path; p / 4.
    yaw_period : float, optional
        Way after which it swings again, metres. Assumption.
    yaw_drift : float, optional
        β, what the vehicle turns while it should drive straight, rad/m; 10 mrad/m where p > 0.
    crab : float, optional
        γ, sideways over forward speed, radians; p · 50 mrad. It is towards y of frame v however
        the vehicle drives, for it is the weight that pulls: down is to the right.
    turning_crab : float, optional
        c, what crab gains with the turn rate, metres. Nothing: the ratio leaves it out.
    icr_ahead : float, optional
        δ, the centre of rotation ahead of the vehicle's origin in the direction of travel,
        metres; 0.3 m · p.
    """

    ratio: Annotated[float, Ge(0), Le(0.5)] = 0.0
    longitudinal: Annotated[float | None, Ge(0), Le(0.9)] = None
    yaw_efficiency: Annotated[float | None, Gt(0), Le(1.5)] = None
    yaw_variation: Annotated[float | None, Ge(0), Le(0.5)] = None
    yaw_period: Annotated[float, Ge(50), Le(1e5), MM] = 2.0
    yaw_drift: Annotated[float | None, Ge(-30), Le(30), DEG_PER_M] = None
    crab: Annotated[float | None, Ge(-30), Le(30), DEG] = None
    turning_crab: Annotated[float, Ge(-1000), Le(1000), MM] = 0.0
    icr_ahead: Annotated[float | None, Ge(-500), Le(500), MM] = None


class SlipPlant:
    """A body whose tracks slip by given ratios, behind the `VehiclePlant` protocol.

    With track speeds u_t and ω_e = (left - right) / b: u = u_t (1 - longitudinal),
    ω = η ω_e + β u, and sideways γ|u| + c|ω| - ω δ sign(u).

    Parameters
    ----------
    settings : SlipSettings
    gauge : float
        b, between the tracks, metres.
    pose_w : array_like, shape (3,)
        Its first pose.
    seed : int or Generator, optional
        Of where along the path η begins to swing.
    load : TrackLoad, optional
        What its motors have to turn the tracks with; no torques are known if left out.
    """

    def __init__(
        self,
        settings: SlipSettings,
        gauge: float,
        pose_w: Array,
        seed: int | np.random.Generator = 0,
        load: TrackLoad | None = None,
    ) -> None:
        self._load = load
        p, s = settings.ratio, settings
        self.pose_w = readonly_copy(pose_w)
        self._gauge, self._settings = gauge, settings
        self._kept = 1 - _value_or(s.longitudinal, p / 10)
        self._yaw = _value_or(s.yaw_efficiency, 1 - p), _value_or(s.yaw_variation, p / 4)
        self._drift = _value_or(s.yaw_drift, SLIPPING_YAW_DRIFT if p > 0 else 0.0)
        self._crab = _value_or(s.crab, 0.05 * p)
        self._icr_ahead = _value_or(s.icr_ahead, 0.3 * p)
        self._phase = 2 * pi * np.random.default_rng(seed).random()
        self._travelled = 0.0

    @property
    def torques(self) -> tuple[float, ...]:
        """Torque of the left and right motor; see `VehiclePlant.torques`."""
        return () if self._load is None else self._load.torques(float(self.pose_w[2]))

    def advance(self, left: float, right: float, period: float) -> None:
        """Let the tracks run for a period. See `VehiclePlant.advance`."""
        if self._load is not None:
            self._load.advance(left * period, right * period)
        u = self._kept * (left + right) / 2
        mean, swing = self._yaw
        eta = mean + swing * sin(2 * pi * self._travelled / self._settings.yaw_period + self._phase)
        turn = eta * (left - right) / self._gauge + self._drift * u
        ahead = copysign(self._icr_ahead, u) if u else 0.0
        sideways = self._crab * abs(u) + self._settings.turning_crab * abs(turn) - turn * ahead
        self._travelled += u * period
        self.pose_w = moved_pose(self.pose_w, np.array((u, sideways, turn)), period)


def _value_or(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value
