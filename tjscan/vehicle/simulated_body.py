"""A simulated vehicle without a driver: drives, plant, sensors, and the steel below it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import exp, inf, pi, radians, sin, sqrt
from typing import Annotated, Final, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Len

from tjscan.core import units
from tjscan.core.frames import Array, pose, readonly_copy, rot_z
from tjscan.core.units import SettingsTable
from tjscan.vehicle.pad_plant import PadPlant, PadSettings
from tjscan.vehicle.slip_plant import SlipPlant, SlipSettings, TrackLoad
from tjscan.vehicle.tracks import TrackGeometry, VehiclePlant
from tjscan.vehicle.vehicle import Twist, VehicleState

Millimetres = Annotated[float, Ge(-1e6), Le(1e6)]

SurfacePoint = Annotated[tuple[Millimetres, Millimetres], units.MM]
"""x and y in frame w, metres: up to a kilometre away."""


class SteelArea:
    """Area of steel on the unrolled surface, frame w, inside a polygon.

    Parameters
    ----------
    outline_w : array_like, shape (n, 2)
        Corners in order, x and y in metres, none repeated; none at all is steel everywhere.
    """

    def __init__(self, outline_w: object = ()) -> None:
        self.outline_w = readonly_copy(np.reshape(np.asarray(outline_w, dtype=float), (-1, 2)))

    def covers_points(self, points_w: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Whether there is steel at points, shape (m, 2): a ray to +x leaves it an odd time."""
        if not len(self.outline_w):
            return np.ones(len(points_w), dtype=bool)
        a, b = self.outline_w, np.roll(self.outline_w, -1, axis=0)
        x, y = points_w[:, :1], points_w[:, 1:]
        across = (a[:, 1] > y) != (b[:, 1] > y)
        rise = np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
        meets = a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
        return np.asarray(np.sum(across & (x < meets), axis=1) % 2 == 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProximitySettings(SettingsTable):
    """The table [simulation.vehicle.proximity]: four sensors at the body's corners.

    Parameters
    ----------
    body_length, body_width : float
        Of the rectangle, its middle at the vehicle's origin, at whose corners they sit, metres.
    height : float
        Over the steel, metres. Assumption.
    noise : float
        Standard deviation of a reading, metres. Assumption.
    period : float
        Seconds between samples.
    irregular : float
        Share of the samples that read anything between nothing and five times the height, or
        see no steel at all, while the arc burns. Assumption.
    """

    body_length: Annotated[float, Ge(50), Le(5000), units.MM] = 0.8
    body_width: Annotated[float, Ge(50), Le(5000), units.MM] = 0.5
    height: Annotated[float, Ge(1), Le(500), units.MM] = 0.03
    noise: Annotated[float, Ge(0), Le(50), units.MM] = 5e-4
    period: Annotated[float, Ge(0.001), Le(10), units.SECONDS] = 0.1
    irregular: Annotated[float, Ge(0), Le(100), units.PERCENT_UNIT] = 0.005


class ProximitySensors:
    """Simulated proximity sensors at a vehicle's corners, in the order of `PROXIMITY_CORNERS`.

    Parameters
    ----------
    settings : ProximitySettings
    steel : SteelArea
    seed : int or Generator
        Of their noise.
    """

    def __init__(
        self, settings: ProximitySettings, steel: SteelArea, seed: int | np.random.Generator
    ) -> None:
        self._settings, self._steel = settings, steel
        self._random = np.random.default_rng(seed)
        x, y = settings.body_length / 2, settings.body_width / 2
        self._corners_v = np.array([(x, -y), (x, y), (-x, -y), (-x, y)])

    def read(self, pose_w: Array, *, arc_burning: bool) -> tuple[float, ...]:
        """Readings in metres at the corners of a body at x, y and heading; inf over no steel."""
        cos, sin = np.cos(pose_w[2]), np.sin(pose_w[2])
        corners_w = pose_w[:2] + self._corners_v @ np.array([(cos, sin), (-sin, cos)])
        s = self._settings
        noise, odd, wild = self._random.random((3, len(corners_w)))
        readings = s.height + s.noise * np.sqrt(12) * (noise - 0.5)
        readings[~self._steel.covers_points(corners_w)] = inf
        if arc_burning:
            irregular = odd < s.irregular
            readings[irregular] = np.where(wild < 0.5, inf, 10 * s.height * (wild - 0.5))[irregular]
        return tuple(readings.tolist())


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialSettings(SettingsTable):
    """The table [simulation.vehicle.inertial]: a gyro about z, and an inclinometer.

    The defaults are those of small sensors of silicon (assumption).

    Parameters
    ----------
    gyro_noise : float
        Standard deviation of its turn rate over one second, rad/s.
    gyro_bias : float
        Standard deviation of what it is off by for good, rad/s.
    down_noise : float
        Standard deviation of a direction of down, radians. Of a level surface it shows none.
    down_bias : float
        Standard deviation of what it is off by for good, radians.
    """

    gyro_noise: Annotated[float, Ge(0), Le(60), units.DEG_S] = radians(0.01)
    gyro_bias: Annotated[float, Ge(0), Le(60), units.DEG_S] = radians(0.05)
    down_noise: Annotated[float, Ge(0), Le(60), units.DEG] = radians(0.05)
    down_bias: Annotated[float, Ge(0), Le(60), units.DEG] = radians(0.2)


LEAST_INCLINATION: Final = radians(10)
"""Of a surface on which an inclinometer shows the direction of down."""


class InertialSensors:
    """Simulated gyro and inclinometer of a vehicle.

    Parameters
    ----------
    settings : InertialSettings
    pads : PadSettings
        Whose surface shows where down is.
    random : Generator
    """

    def __init__(
        self, settings: InertialSettings, pads: PadSettings, random: np.random.Generator
    ) -> None:
        self._settings, self._pads, self._random = settings, pads, random
        sigmas = settings.gyro_bias, settings.down_bias
        self._bias, self._tilt = random.standard_normal(2) * sigmas

    def read(
        self, before: float, heading: float, period: float
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Sample of each after the heading changed over a period in seconds; radians."""
        own, (rate, level) = self._settings, self._random.standard_normal(2).tolist()
        turned = (heading - before) / period + self._bias + own.gyro_noise * rate / sqrt(period)
        if sin(self._pads.inclination) < sin(LEAST_INCLINATION):
            return (turned,), ()
        down = self._pads.down - heading + self._tilt + own.down_noise * level
        return (turned,), ((down + pi) % (2 * pi) - pi,)


Outline = Annotated[tuple[SurfacePoint, ...], Len(0, 1000), units.LIST_OR_WORD_IN_FILE]
"""A polygon on the unrolled surface: corners in order, metres."""


STANDSTILL_SPEED: Final = 1e-7
"""m/s: a track that is commanded to rest, and is slower than this, is at rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSettings(SettingsTable):
    """The table [simulation.vehicle.drives]: how the tracks' motors follow.

    Parameters
    ----------
    top_speed : float
        Of a track, m/s: the 6 m/min of the paper. If one would run faster, both are slowed by
        the same share, so that the path's curvature stays.
    lag : float
        Time constant of the speed loop, seconds. Assumption.
    acceleration : float
        Most that a track gains or loses on a command, m/s². Assumption.
    braking : float
        Most that it loses on a stop, m/s². Assumption: 200 N of the 1,680 N that both tracks
        pull.
    """

    top_speed: Annotated[float, Gt(0), Le(5000), units.MM_S] = 0.1
    lag: Annotated[float, Ge(0), Le(10), units.SECONDS] = 0.05
    acceleration: Annotated[float, Gt(0), Le(1e5), units.MM_S2] = 0.5
    braking: Annotated[float, Gt(0), Le(1e5), units.MM_S2] = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSimulationSettings(SettingsTable):
    """The table [simulation.vehicle]: where a simulated vehicle begins, and how it moves.

    Parameters
    ----------
    start : tuple of float
        x and y of its origin on the unrolled surface, frame w, metres.
    heading : float
        From x of w towards y of w, radians: clockwise seen from outside.
    plant : str
        ``slip``: the tracks slip by given ratios. ``pads``: by the friction of each pad.
    slip : SlipSettings
        For the plant ``slip``.
    pads : PadSettings
        For the plant ``pads``; of the other they give the motors' torques alone.
    drives : DriveSettings
        How the tracks follow.
    encoder_noise : float
        Standard deviation of a sprocket's rate as its encoder shows it, rad/s. Assumption.
    proximity : ProximitySettings
        Sensors at the corners.
    inertial : InertialSettings, optional
        Gyro and inclinometer; a vehicle without them if left out.
    steel : tuple of points
        Outline of the steel in frame w, metres; without one there is steel everywhere.
    """

    start: SurfacePoint = (0.0, 0.0)
    heading: Annotated[float, Ge(-360), Le(360), units.DEG] = 0.0
    plant: Literal["slip", "pads"] = "slip"
    slip: SlipSettings = field(default_factory=SlipSettings)
    pads: PadSettings = field(default_factory=PadSettings)
    drives: DriveSettings = field(default_factory=DriveSettings)
    encoder_noise: Annotated[float, Ge(0), Le(60), units.DEG_S] = 2e-3
    proximity: ProximitySettings = field(default_factory=ProximitySettings)
    inertial: InertialSettings | None = None
    steel: Outline = ()


VEHICLE_STATE_PERIOD: Final = 0.01
"""Seconds between states."""


class SimulatedBody:
    """Drives, plant and sensors of a simulated vehicle.

    Parameters
    ----------
    tracks : TrackGeometry
        Its tracks.
    settings : VehicleSimulationSettings
        Its first pose and how it moves.
    seed : int, optional
        Of all random numbers: the same seed and commands give the same states.
    pose_w : array_like, shape (3,), optional
        Its first pose, if not the settings': x, y in metres and heading in radians.
    time : float, optional
        What its clock shows at first, seconds.
    """

    def __init__(
        self,
        tracks: TrackGeometry,
        settings: VehicleSimulationSettings,
        *,
        seed: int = 0,
        pose_w: Array | None = None,
        time: float = 0.0,
    ) -> None:
        slip, encoders, sensors, inertial = np.random.default_rng(seed).spawn(4)
        start = np.array((*settings.start, settings.heading)) if pose_w is None else pose_w
        self.plant: VehiclePlant = (
            SlipPlant(settings.slip, tracks.gauge, start, slip, TrackLoad(settings.pads, tracks))
            if settings.plant == "slip"
            else PadPlant(settings.pads, tracks, start)
        )
        self.steel = SteelArea(settings.steel)
        self.time = time
        self.arc_burning = False
        """Whether an arc disturbs the proximity sensors."""
        self._tracks, self._settings, self._encoders = tracks, settings, encoders
        self._speeds = np.zeros(2)  # of the left and right track, m/s, forward positive
        self._sensors = ProximitySensors(settings.proximity, self.steel, sensors)
        self._sampled = -np.inf
        self._inertial = (
            None
            if settings.inertial is None
            else InertialSensors(settings.inertial, settings.pads, inertial)
        )

    @property
    def T_w_v(self) -> Array:
        """True pose of the vehicle on the unrolled surface, shape (4, 4)."""
        x, y, heading = self.plant.pose_w
        return pose(rot_z(heading), (x, y, 0.0))

    @property
    def braking_time(self) -> float:
        """Seconds in which it brakes from its top speed to rest."""
        drives = self._settings.drives
        return drives.top_speed / drives.braking

    @property
    def at_rest(self) -> bool:
        """Whether both tracks are at rest."""
        return not self._speeds.any()

    def advance(
        self, twist: Twist | None, *, period: float = VEHICLE_STATE_PERIOD, grip: float = 1.0
    ) -> VehicleState:
        """Go on by a period, and report the state then.

        Parameters
        ----------
        twist : Twist or None
            What to drive; None brakes to rest.
        period : float, optional
            Seconds.
        grip : float, optional
            Share of the tracks' motion that the body follows at most; less than 1 if they spin.
        """
        if twist is None:
            most = self._settings.drives.braking * period
            self._speeds = self._speeds - np.clip(self._speeds, -most, most)
        else:
            self._follow_speeds(self._tracks.track_speeds(twist), period)
        left, right = self._speeds.tolist()
        before = float(self.plant.pose_w[2])
        self.plant.advance(grip * left, grip * right, period)
        self.time += period
        odometry, torques = self._read_encoders(left, right), self.plant.torques
        state = VehicleState(self.time, odometry, torques, self._read_proximity())
        if self._inertial is None:
            return state
        gyro, down = self._inertial.read(before, float(self.plant.pose_w[2]), period)
        return replace(state, gyro=gyro, down=down)

    def _follow_speeds(self, wanted: Array, period: float) -> None:
        """Run after wanted speeds, shape (2,): a first-order lag and a limit to what is gained."""
        s = self._settings.drives
        wanted = wanted * min(1.0, s.top_speed / max(float(np.abs(wanted).max()), 1e-12))
        share = 1.0 if s.lag == 0 else 1 - exp(-period / s.lag)
        most = s.acceleration * period
        self._speeds = self._speeds + np.clip(share * (wanted - self._speeds), -most, most)
        self._speeds[(wanted == 0) & (np.abs(self._speeds) < STANDSTILL_SPEED)] = 0.0

    def _read_encoders(self, left: float, right: float) -> Twist:
        r = self._tracks.sprocket_radius
        noise = self._settings.encoder_noise * self._encoders.standard_normal(2)
        return self._tracks.twist(left / r + noise[0], -right / r + noise[1])

    def _read_proximity(self) -> tuple[float, ...]:
        due = self._sampled + self._settings.proximity.period
        if self.time < due - VEHICLE_STATE_PERIOD / 2:
            return ()
        self._sampled = self.time
        return self._sensors.read(self.plant.pose_w, arc_burning=self.arc_burning)
