"""A crawler of another make, from first principles: no equation of the product's simulation.

Rigid magnet pads under sharp Coulomb friction: each moment's motion is the one at which friction
and weight balance, solved exactly. Chains whose speed ripples at the pads' pitch, encoders that
count, states at 50 Hz that come one late, and a laser that images the joint from the true pose.

Frame w is in the hull: x along the joint at its start, y to the right, headings clockwise seen
from outside. Its devices come through the entry points of `tjscan.vehicle`, `tjscan.laser` and
`tjscan.torch`, as a package of another maker would register them.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import cos, exp, hypot, pi, sin, sqrt, tan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Self

import numpy as np
from numba import njit

from tjscan.core.devices import DriverFactory, LocalDevice, NoSettings
from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.job.crawl.job import TORCH_DRIVERS
from tjscan.laser.drivers import LASER_DRIVERS, LaserDriverFactory
from tjscan.laser.profile import Profile
from tjscan.vehicle.drivers import VEHICLE_DRIVERS, VehicleDriverFactory
from tjscan.vehicle.vehicle import LocalVehicle, Twist, VehicleState

NAME: Final = "other"
STATE_SECONDS: Final = 0.02
GAUGE, SPROCKET, PITCH, PADS = 0.4, 0.05, 0.7 / 24, 24
"""Metres between the tracks, of a sprocket's radius, between pads; pads of a track in contact."""

WEIGHT, GRIP, MASS_HEIGHT, MASS_AHEAD = 981.0, 245.0, 0.15, 0.03
"""N of the vehicle, N by which a magnet presses its pad on, and metres of the centre of mass."""

BALANCED: Final = 1e-7
"""Forces that are left over, as a share of the weight."""

COUNT: Final = 1.6e-6
"""Metres of chain for a count of an encoder."""

GYRO_NOISE, GYRO_BIAS, DOWN_NOISE, DOWN_BIAS = np.radians((0.01, 0.05, 0.05, 0.2)).tolist()
"""rad/s over one second, rad/s, radians, radians: standard deviations of the inertial sensors."""

DRIVE_LAG, DRIVE_GAIN, BRAKING = 0.08, 0.4, 1.5
"""Seconds by which the drives lag, m/s² that they gain, and that they lose on a stop."""

LASER_AHEAD: Final = 0.5
KINK_AT: Final = 0.2
"""Metres along the weld at which a kink begins: the laser comes to it after 100 mm of way."""
STAND_OFF, HALF_ANGLE, COLUMNS, LASER_NOISE = 0.149, 0.27, 320, 0.05e-3
HALF_WIDTH, HALF_ROOT, DEPTH, HIGH_LOW = 0.015, 0.015 - 0.02 * tan(pi / 6), 0.02, 1e-3
TACK: Final = (0.10, 0.03, 4e-3)
"""Metres: middle, length and height of a tack."""

LEVELS: Final = (5e-3, 10e-3, 15e-3)
"""Metres over the root to which each pass fills the groove."""

EDGE_LENGTH, UNEVEN_EDGE, READING_NOISE = 5e-3, 15e-6, 15e-6
"""Metres along the joint for which its edges are as uneven, by how much, and the noise of a
reading, as these profiles are read."""

NO_PROFILE: Final = Profile(np.empty(0), np.empty(0))

CAPPED_LEVELS: Final = (13e-3, 15e-3, 17e-3)
"""The same where the first pass covers an edge."""

TEXTURE_CELL, PLATE_TEXTURE, BEAD_TEXTURE = 0.4e-3, 8e-6, 60e-6
"""Metres: cells of what is uneven in the steel, and standard deviations of it."""

ACROSS: Final = np.union1d(
    np.linspace(-HALF_WIDTH, 19e-3, 69), (-0.3, HALF_WIDTH, -HALF_ROOT, HALF_ROOT, 0.3)
)

EDGE_BEAD: Final = np.where(
    ACROSS < 8e-3, 2 * ACROSS - 15.4e-3, 2e-3 * (1 - ((ACROSS - 13e-3) / 6e-3) ** 2)
)
"""Heights over the hull of a bead over the right edge."""


@dataclass(frozen=True)
class Hull:
    """What a crawl meets.

    Parameters
    ----------
    friction : float
        Of the pads: 0.5 dry, 0.3 wet.
    down : float
        Where down is in frame w, from x towards y, radians: the hull is a wall.
    ripple : float
        Amplitude of the chains' speed at the pads' pitch, as a share of it.
    lost : tuple of float
        Share of the left and right chain's speed that is lost on the ground.
    creep : float
        Metres to the right for each metre of way, whichever way it goes.
    curvature : float
        Of the joint, 1/m, to the right.
    kink : float
        Metres by which the joint goes aside within 100 mm, from `KINK_AT` on.
    tack : tuple of float
        Middle, length and height of a tack, metres.
    capped : bool
        Whether the first pass fills most of the groove and covers its right edge.
    arc : float
        Share of a profile's points that the arc spoils.
    inertial : bool
        Whether the vehicle has a gyro and an inclinometer.
    damped : float
        Time constant of the inclinometer, seconds.
    """

    friction: float = 0.5
    down: float = pi / 2
    ripple: float = 0.0
    lost: tuple[float, float] = (-2.5e-4, 2.5e-4)
    creep: float = 0.0
    curvature: float = 0.0
    kink: float = 0.0
    tack: tuple[float, float, float] = TACK
    capped: bool = False
    arc: float = 0.1
    inertial: bool = True
    damped: float = 0.0


@dataclass(frozen=True)
class Fault:
    """What breaks.

    Parameters
    ----------
    kind : str
        ``knock``, ``turn``, ``dead``, ``stuck``, ``scaled``, ``swapped``, ``spins``, ``frozen``,
        ``late``, ``mirrored``, ``neighbour``, ``gyro dead``, ``gyro biased``, ``level off``; empty
        while nothing is broken.
    size : float, optional
        Metres, radians, rad/s, a factor, a share or frames.
    side : int, optional
        Of a track: 0 left, 1 right.
    """

    kind: str = ""
    size: float = 0.0
    side: int = 0


@njit(cache=True)  # type: ignore[untyped-decorator]
def balance_pads(
    friction: float, down: float, into_pitch: float, belt: float, speed: Array
) -> float:
    """Find the speed, shape (3,), at which friction and weight balance; returns what is left, N.

    The chains run at `belt` and its negative.
    """
    sine, cosine = np.sin(down), np.cos(down)
    load = np.array((WEIGHT * cosine, WEIGHT * sine, MASS_AHEAD * WEIGHT * sine))
    x = np.empty(2 * PADS)
    for k in range(2 * PADS):
        x[k] = PITCH * (k % PADS + 0.5 - into_pitch) - PADS * PITCH / 2
    # The weight's lever over the hull presses the lower pads on, and pulls at the upper ones.
    tilt = MASS_HEIGHT * load[0] / (x * x).sum()
    roll = MASS_HEIGHT * load[1] / (2 * PADS * (GAUGE / 2) ** 2)
    left = np.inf
    for _ in range(80):
        force, stiffness, work = load.copy(), np.zeros((3, 3)), -(load * speed).sum()
        for k in range(2 * PADS):
            y, own = (-GAUGE / 2, belt) if k < PADS else (GAUGE / 2, -belt)
            grip = friction * max(GRIP + tilt * x[k] + roll * y, 0.0)
            along, across = speed[0] - speed[2] * y - own, speed[1] + speed[2] * x[k]
            slid = np.sqrt(along * along + across * across)
            ex, ey = along / slid, across / slid
            force -= grip * np.array((ex, ey, x[k] * ey - y * ex))
            # Friction changes with the slide's direction alone: across (ex, ey).
            turned = np.array((-ey, ex, x[k] * ex + y * ey))
            stiffness += grip / slid * np.outer(turned, turned)
            work += grip * slid
        left = np.abs(force).max()
        if left < BALANCED * WEIGHT:
            break
        step = np.linalg.solve(stiffness, force)
        share = 1.0
        while share > 1e-9:
            trial = speed + share * step
            trial_work = -(load * trial).sum()
            for k in range(2 * PADS):
                y, own = (-GAUGE / 2, belt) if k < PADS else (GAUGE / 2, -belt)
                grip = friction * max(GRIP + tilt * x[k] + roll * y, 0.0)
                along, across = trial[0] - trial[2] * y - own, trial[1] + trial[2] * x[k]
                trial_work += grip * np.sqrt(along * along + across * across)
            if trial_work <= work + 1e-12 * WEIGHT:
                break
            share /= 2
        speed += share * step
    return left


class PadTracks:
    """Two rows of rigid pads; `motion` balances their friction with the weight."""

    def __init__(self, friction: float) -> None:
        self._friction = friction
        self._last: dict[bool, Array] = {}

    def motion(self, left: float, right: float, down: float, into_pitch: float) -> Array:
        """Velocity (forward, right, clockwise) of a body whose chains run at these speeds, m/s.

        The work of friction less that of the weight is convex in the velocity, and least where
        forces and moments balance. While both chains run alike no pad slides; else none is at
        rest, for a turn takes friction along both tracks, and Newton's steps converge.

        Parameters
        ----------
        left, right : float
        down : float
            From the vehicle's x towards its y, radians.
        into_pitch : float
            Share of a pitch that the pads have gone on.
        """
        mean, difference = (left + right) / 2, left - right
        if difference == 0.0:
            return np.array((mean, 0.0, 0.0))
        known = self._last.get(difference > 0)
        belt = 0.5 if difference > 0 else -0.5
        speed = np.array((0.0, 0.0, belt / GAUGE)) if known is None else known
        left_over = balance_pads(self._friction, down, into_pitch, belt, speed)
        if left_over > BALANCED * WEIGHT:
            raise ArithmeticError(f"no balance of the pads: {left_over} N are left")
        self._last[difference > 0] = speed
        return np.asarray(np.array((mean, 0.0, 0.0)) + abs(difference) * speed)


class OtherWorld:
    """Hull, vehicle, laser and torch as they truly are.

    Parameters
    ----------
    hull : Hull
    start : tuple of float
        First x, y in metres and heading in radians.
    seed : int
        Of all random numbers.
    has_profiles : bool, optional
        Whether its laser gives profiles; else who needs the joint takes `reading`.
    """

    def __init__(
        self, hull: Hull, start: tuple[float, float, float], seed: int, *, has_profiles: bool = True
    ) -> None:
        self.has_profiles = has_profiles
        self.hull, self.pose, self.time, self.seed = hull, np.array(start), 0.0, seed
        self.random = np.random.default_rng([seed, 77])
        self.fault = Fault()
        self.torch_y, self.arc = 0.0, False
        self.welded: list[list[float]] = []
        self.speeds, self.way = np.zeros(2), np.zeros(2)
        self._phase = self.random.random(2)
        self._pads = PadTracks(hull.friction)
        cells = np.random.default_rng([seed, 78]).standard_normal((256, 256))
        self._texture = (cells + np.roll(cells, 1, 0) + np.roll(cells, 1, 1)) / sqrt(3)

    def joint_y(self, x: float) -> float:
        """Where the joint is across the hull at x, metres."""
        bend, into = self.hull.curvature, min(max((x - KINK_AT) / 0.1, 0.0), 1.0)
        curve = bend * x**2 / (1 + sqrt(1 - (bend * x) ** 2))
        return curve + self.hull.kink * into**2 * (3 - 2 * into)

    def beside_joint(self, ahead: float, right: float = 0.0) -> tuple[float, float]:
        """X of a point of the vehicle, and how far it is to the right of the joint, metres."""
        x, y, heading = self.pose
        px = x + ahead * cos(heading) - right * sin(heading)
        py = y + ahead * sin(heading) + right * cos(heading)
        slope = (self.joint_y(px + 1e-4) - self.joint_y(px - 1e-4)) / 2e-4
        return px, (py - self.joint_y(px)) / hypot(1.0, slope)

    def go_on(self, wanted: Twist | None) -> None:
        """Go on by a state: drives, chains, pads, in two steps."""
        for _ in range(2):
            period = STATE_SECONDS / 2
            if wanted is None:
                most = BRAKING * period
                self.speeds = self.speeds - np.clip(self.speeds, -most, most)
            else:
                half = wanted.turn_rate * GAUGE / 2
                gap = np.array((wanted.speed + half, wanted.speed - half)) - self.speeds
                most = DRIVE_GAIN * period
                gained = np.clip(gap * (1 - exp(-period / DRIVE_LAG)), -most, most)
                self.speeds = self.speeds + np.where(np.abs(gap) < 1e-7, gap, gained)
            self.way = self.way + self.speeds * period
            left, right = (self.speeds * self._chain_shares()).tolist()
            into = float(np.mean(self.way)) / PITCH % 1.0
            heading = self.pose[2]
            u, v, w = self._pads.motion(left, right, self.hull.down - heading, into)
            v += self.hull.creep * abs(u)
            middle = heading + w * period / 2
            going = u * cos(middle) - v * sin(middle), u * sin(middle) + v * cos(middle), w
            self.pose = self.pose + np.multiply(going, period)
        self.time += STATE_SECONDS
        if self.arc:
            self.welded[-1][1] = max(self.welded[-1][1], self.beside_joint(0.0)[0])

    def _chain_shares(self) -> Array:
        """Speed of each chain over the ground as a share of its sprocket's mean."""
        half = PITCH / 2 / SPROCKET
        cycle = (self.way / PITCH + self._phase) % 1.0 - 0.5
        chord = np.cos(2 * half * cycle)  # of a pad that turns in with the sprocket
        chord = (chord - sin(half) / half) / ((1 - cos(half)) / 2)
        shares = (1 + self.hull.ripple * chord) * (1 - np.array(self.hull.lost))
        if self.fault.kind == "spins":
            shares[self.fault.side] *= 1 - self.fault.size
        return np.asarray(shares)

    def set_arc(self, *, burning: bool) -> None:
        """Strike the arc, or end it."""
        if burning and not self.arc:
            self.welded.append([self.beside_joint(0.0)[0]] * 2)
        self.arc = burning

    def break_now(self, fault: Fault) -> None:
        """Let a fault begin; a knock is done at once, about the vehicle's middle."""
        self.fault = fault
        if fault.kind == "knock":
            heading = self.pose[2]
            self.pose = self.pose + fault.size * np.array((-sin(heading), cos(heading), 0.0))
        if fault.kind == "turn":
            self.pose = self.pose + np.array((0.0, 0.0, fault.size))

    def joint_in_line(self) -> tuple[float, float]:
        """Where the laser's line meets the joint: its x, and how far to the right it is, metres."""
        x, y, heading = self.pose
        px, py = x + LASER_AHEAD * cos(heading), y + LASER_AHEAD * sin(heading)
        to_joint = 0.0
        for _ in range(4):  # along the laser's line, which goes to (-sin, cos) of the heading
            along = px - to_joint * sin(heading)
            to_joint = (self.joint_y(along) - py) / cos(heading)
        return along, to_joint

    def reading(self) -> JointPlacement:
        """Where the joint is in the laser's line, as well as it is read off a profile."""
        along, to_joint = self.joint_in_line()
        edges = np.random.default_rng([self.seed, 80, int(along // EDGE_LENGTH) % 2**32])
        off = UNEVEN_EDGE * edges.standard_normal() + READING_NOISE * self.random.standard_normal()
        return JointPlacement(
            centre=to_joint + off, hull_z=STAND_OFF, roll=0.0, centre_sigma=READING_NOISE
        )

    def profile(self, beside: float = 0.0) -> Profile:
        """What the laser sees now, or would if the joint ran so far beside, in metres."""
        heading = self.pose[2]
        along, to_joint = self.joint_in_line()
        slope = (self.joint_y(along + 1e-4) - self.joint_y(along - 1e-4)) / 2e-4
        nodes = ACROSS / cos(heading - slope) + to_joint + beside
        filled = self._heights(along)
        rays = np.tan(np.linspace(-HALF_ANGLE, HALF_ANGLE, COLUMNS))
        seen = nodes / (STAND_OFF - filled)
        k = np.clip(np.searchsorted(seen, rays) - 1, 0, len(nodes) - 2)
        rise = (np.diff(filled) / np.diff(nodes))[k]
        z = (STAND_OFF - filled[k] + rise * nodes[k]) / (1 + rise * rays)
        across = z * rays - to_joint
        z = z + self._unevenness(along, across) + LASER_NOISE * self.random.standard_normal(COLUMNS)
        if self.arc:
            lit = 0
            while lit < self.hull.arc * COLUMNS:
                at, wide = int(self.random.integers(COLUMNS)), int(self.random.integers(1, 7))
                z[at : at + wide] += self.random.uniform(-0.04, 0.04)
                lit += wide
        return Profile(z * rays, z)

    def _passes_at(self, along: float) -> int:
        return sum(start <= along <= end for start, end in self.welded)

    def _heights(self, along: float) -> Array:
        """Height of the steel over the hull at `ACROSS`."""
        side = np.sign(ACROSS)
        inside = (np.abs(ACROSS) - HALF_ROOT) / (HALF_WIDTH - HALF_ROOT)
        steel = DEPTH * (np.clip(inside, 0.0, 1.0) - 1) + side * HIGH_LOW / 2
        at, length, height = self.hull.tack
        lift = min(height, length / 2 - abs(along - at))
        levels = CAPPED_LEVELS if self.hull.capped else LEVELS
        for k, level in enumerate((lift, *levels[: self._passes_at(along)])):
            bead = level - DEPTH + (0.0 if k else 3.0) * (HALF_ROOT**2 - ACROSS**2)
            steel = np.where(np.abs(ACROSS) < HALF_WIDTH, np.maximum(steel, bead), steel)
        if self.hull.capped and self._passes_at(along):
            steel = np.maximum(steel, EDGE_BEAD)
        return np.asarray(steel)

    def _unevenness(self, along: float, across: Array) -> Array:
        i, into = divmod(along / TEXTURE_CELL, 1.0)
        rows = self._texture[np.array((int(i), int(i) + 1)) % 256]
        j = np.floor(across / TEXTURE_CELL).astype(int) % 256
        welded = (np.abs(across) < HALF_ROOT) & (self._passes_at(along) > 0)
        rough = (1 - into) * rows[0, j] + into * rows[1, j]
        return np.asarray(np.where(welded, BEAD_TEXTURE, PLATE_TEXTURE) * rough)


class OtherVehicle(LocalVehicle):
    """The vehicle behind its protocol: orders act one state late, and states come one late."""

    def __init__(self, world: OtherWorld) -> None:
        self._world, self._heading = world, float(world.pose[2])
        self._damped = self._heading
        self._random = np.random.default_rng([world.seed, 79])
        self._biases = self._random.standard_normal(2) * (GYRO_BIAS, DOWN_BIAS)
        self._counted, self._shown, self._number = np.zeros(2), np.zeros(2), 0
        self._order: tuple[Twist, float] | None = None
        self._next: Twist | None = None
        self._states: deque[VehicleState] = deque(maxlen=2)

    @property
    def time(self) -> float:
        """What its clock shows, seconds."""
        return self._world.time

    def next_state(self) -> VehicleState:
        """Go on by a state; see `Vehicle.next_state`."""
        self.check_connected()
        self._world.go_on(self._next)
        self._next = self.twist_to_drive()
        self._number += 1
        distances = 0.03 + 5e-4 * self._world.random.standard_normal(4)
        proximity = tuple(distances.tolist()) if self._number % 5 == 0 else ()
        left, right = self._encoder_speeds().tolist()
        odometry = Twist((left + right) / 2, (left - right) / GAUGE)
        inertial = self._inertial() if self._world.hull.inertial else ((), ())
        self._states.append(VehicleState(self._world.time, odometry, (), proximity, "", *inertial))
        return self._states[0]

    def _inertial(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Turn rate by the gyro, and direction of down by the inclinometer."""
        world, before, self._heading = self._world, self._heading, float(self._world.pose[2])
        noise = GYRO_NOISE / sqrt(STATE_SECONDS), DOWN_NOISE
        follows = STATE_SECONDS / (world.hull.damped + STATE_SECONDS)
        self._damped += follows * (self._heading - self._damped)
        true = (self._heading - before) / STATE_SECONDS, world.hull.down - self._damped
        rate, down = (true + self._biases + noise * self._random.standard_normal(2)).tolist()
        match world.fault.kind:
            case "gyro dead":
                rate = 0.0
            case "gyro biased":
                rate += world.fault.size
            case "level off":
                down += world.fault.size
        return (rate,), (down,)

    def _encoder_speeds(self) -> Array:
        counts = np.floor(self._world.way / COUNT)
        speeds = (counts - self._counted) * COUNT / STATE_SECONDS
        self._counted, fault = counts, self._world.fault
        match fault.kind:
            case "dead":
                speeds[fault.side] = 0.0
            case "stuck":
                speeds[fault.side] = self._shown[fault.side]
            case "scaled":
                speeds[fault.side] *= fault.size
            case "swapped":
                speeds = speeds[::-1]
        self._shown = speeds
        return np.asarray(speeds)


class OtherLaser(LocalDevice):
    """The laser behind its protocol; its profiles bear no date."""

    not_connected = (LaserFault, "the laser is not connected")

    def __init__(self, world: OtherWorld) -> None:
        self._world = world
        self._seen: deque[Profile] = deque(maxlen=64)

    def capture(self) -> Profile:
        """Take a profile."""
        self.check_connected()
        if not self._world.has_profiles:
            return NO_PROFILE
        fault = self._world.fault
        if fault.kind == "frozen":
            last = self._seen[-1]
            noise = 1e-6 * self._world.random.standard_normal(COLUMNS)
            return replace(last, z_s=last.z_s + noise)
        beside = fault.size if fault.kind == "neighbour" else 0.0
        self._seen.append(self._world.profile(beside))
        match fault.kind:
            case "late":
                return self._seen[-min(int(fault.size), len(self._seen))]
            case "mirrored":
                return Profile(-self._seen[-1].x_s[::-1], self._seen[-1].z_s[::-1])
        return self._seen[-1]


class OtherTorch:
    """Torch on an axis that follows within 30 mm, 80 mm/s at most."""

    def __init__(self, world: OtherWorld) -> None:
        self._world = world

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._world.set_arc(burning=False)

    @property
    def arc(self) -> bool:
        """Whether the arc burns."""
        return self._world.arc

    def move(self, y: float, z: float, period: float) -> float:
        """Go towards a place; see `TorchAxes.move`."""
        step, gap = 0.08 * period, min(max(y, -0.03), 0.03) - self._world.torch_y
        self._world.torch_y += min(max(gap, -step), step)
        return self._world.torch_y

    def set_arc(self, *, burning: bool) -> None:
        """Strike the arc, or end it."""
        self._world.set_arc(burning=burning)


_PLUGGED: list[OtherWorld] = []

VEHICLE: Final = VehicleDriverFactory(lambda inputs, table: OtherVehicle(_PLUGGED[-1]), NoSettings)
LASER: Final = LaserDriverFactory(lambda inputs, table: OtherLaser(_PLUGGED[-1]), NoSettings)
TORCH: Final[DriverFactory[Any, Any]] = DriverFactory(
    lambda inputs, table: OtherTorch(_PLUGGED[-1]), NoSettings
)


@contextmanager
def plugged_in(world: OtherWorld) -> Iterator[None]:
    """Let the drivers named `NAME` make their devices in a world."""
    _PLUGGED.append(world)
    try:
        yield
    finally:
        _PLUGGED.pop()


def _register() -> TemporaryDirectory[str]:
    """Register the drivers as an installed package does: by its entry points."""
    folder = TemporaryDirectory()
    package = Path(folder.name) / "other_crawler-1.dist-info"
    package.mkdir()
    groups = {"vehicle": "VEHICLE", "laser": "LASER", "torch": "TORCH"}
    points = (f"[tjscan.{kind}]\n{NAME} = {__name__}:{it}\n" for kind, it in groups.items())
    (package / "entry_points.txt").write_text("\n".join(points), encoding="utf-8")
    about = "Name: other-crawler\nVersion: 1\nLicense-Expression: BSD-3-Clause\n"
    (package / "METADATA").write_text(about, encoding="utf-8")
    sys.path.append(folder.name)
    for registry in (VEHICLE_DRIVERS, LASER_DRIVERS, TORCH_DRIVERS):
        registry.__dict__.pop("_entries", None)  # may have been looked up before
    return folder


_REGISTERED: Final = _register()
