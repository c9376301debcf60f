"""Truth of a vehicle from the friction of each pad: two tracks of stick-slip brushes with weight.

It shares no equation with the slip ratios of `slip_plant`: slip, crab, drift and the centre of
rotation come out of what the pads can hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core.frames import Array, readonly_copy
from tjscan.core.units import DEG, KG, MM, SettingsTable
from tjscan.vehicle.plant import moved_pose
from tjscan.vehicle.tracks import TrackGeometry

GRAVITY: Final = 9.81
"""m/s²."""

UNBALANCED: Final = 1e-6
"""N and N m: forces that add up to less are in equilibrium."""

MOST_NEWTON_STEPS: Final = 40
MOST_HALVINGS: Final = 20
"""Both are far more than any step needs that has an equilibrium."""

RIDGE: Final = 1e-9
"""Share of the stiffness that is left where every pad slides."""

FARTHEST_STEP: Final = 0.01
"""Metres and radians in one period: a body that nothing holds falls no faster."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PadSettings(SettingsTable):
    """The table [simulation.vehicle.pads]: pads, friction, weight and how the surface lies.

    Parameters
    ----------
    pads : int
        In contact, of one track.
    contact_length : float
        Of a track, metres. Assumption.
    grip : float
        By which one magnet presses its pad on the steel, as the mass it could carry, kg.
    friction : float
        Coefficient of friction: 0.5 dry, 0.3 wet.
    shear : float
        By how far a pad's foot gives way before it slides, metres. Assumption.
    mass : float
        Of the vehicle with its cables, kg.
    mass_height : float
        Of the centre of mass over the surface, metres: it peels the upper pads off. Assumption.
    inclination : float
        Of the surface to the level, radians: 90° a wall, 0 a floor.
    down : float
        Where down is on the surface, from x of frame w towards y, radians: 90° where x runs
        level and y down, 180° where x climbs.
    """

    pads: Annotated[int, Ge(3), Le(500)] = 24
    contact_length: Annotated[float, Ge(50), Le(5000), MM] = 0.7
    grip: Annotated[float, Gt(0), Le(1000), KG] = 25.0
    friction: Annotated[float, Gt(0), Le(2)] = 0.5
    shear: Annotated[float, Ge(0.01), Le(20), MM] = 1e-3
    mass: Annotated[float, Ge(0), Le(10000), KG] = 100.0
    mass_height: Annotated[float, Ge(0), Le(2000), MM] = 0.15
    inclination: Annotated[float, Ge(0), Le(90), DEG] = pi / 2
    down: Annotated[float, Ge(-360), Le(360), DEG] = pi / 2


class PadPlant:
    """A body on two tracks of magnetic pads, behind the `VehiclePlant` protocol.

    Each pad sticks to the steel and shears until its friction is reached, then it slides. In
    each step the body takes the velocity (forward, sideways, turn) at which the forces of all
    pads and the weight are in equilibrium. Pads enter at one end of a track without shear and
    leave at the other.

    Parameters
    ----------
    settings : PadSettings
    tracks : TrackGeometry
    pose_w : array_like, shape (3,)
        Where it stands at first.
    """

    def __init__(self, settings: PadSettings, tracks: TrackGeometry, pose_w: Array) -> None:
        n, s = settings.pads, settings
        self.pose_w = readonly_copy(pose_w)
        self._settings, self._radius = s, tracks.sprocket_radius
        self._numbers = np.tile((np.arange(n) + 0.5) / n, 2)
        self._y = np.repeat((-tracks.gauge / 2, tracks.gauge / 2), n)
        self._run = np.zeros(2)  # of the tracks, in lengths of their contact
        self._shear = np.zeros((2 * n, 2))
        self._step = np.zeros(3)
        self._stiffness = np.zeros(2 * n)
        self._place_pads(np.zeros(2))
        self._settle(np.zeros(2))  # it has hung there for long

    @property
    def torques(self) -> tuple[float, ...]:
        """Torque of the left and right motor at its sprocket, N m, in the sense of its rate."""
        pull = -(self._stiffness * self._shear[:, 0]).reshape(2, -1).sum(axis=1)
        return float(pull[0] * self._radius), float(-pull[1] * self._radius)

    def advance(self, left: float, right: float, period: float) -> None:
        """Let the tracks run for a period. See `VehiclePlant.advance`."""
        run = np.array((left, right)) * period
        self._place_pads(run)
        step = self._settle(run)
        self.pose_w = moved_pose(self.pose_w, step / period, period)

    def _place_pads(self, run: Array) -> None:
        """Carry the pads along with their tracks, and find how hard each is pressed on."""
        s, n = self._settings, self._settings.pads
        laps = self._numbers + np.repeat(self._run, n)
        self._run = self._run + run / s.contact_length
        now = self._numbers + np.repeat(self._run, n)
        self._shear[np.floor(now) != np.floor(laps)] = 0.0  # it left, and another one entered
        self._x = s.contact_length * (0.5 - now % 1.0)
        weight = s.mass * GRAVITY
        angle = s.down - self.pose_w[2]
        down_v = sin(s.inclination) * np.array((cos(angle), sin(angle)))
        self._load = weight * np.array((down_v[0], down_v[1], 0.0))
        pressed = s.grip * GRAVITY + weight * cos(s.inclination) / (2 * n)
        along = self._x * down_v[0] + self._y * down_v[1]
        along -= along.mean()
        peel = weight * s.mass_height * float(down_v @ down_v) * along
        peel /= max(float(along @ along), 1e-12)  # on the level there is none
        self._stiffness = s.friction * np.maximum(pressed + peel, 0.0) / s.shear

    def _settle(self, run: Array) -> Array:
        """Shear the pads to equilibrium; returns the body's step (forward, sideways, turn).

        The equilibrium is where a convex potential is least (that of springs that give way, with
        the weight), so Newton steps that are halved until it falls reach it.
        """
        start = self._shear.copy()
        start[:, 0] -= np.repeat(run, self._settings.pads)
        step = self._step if run.any() else np.zeros(3)
        potential, force, hessian = self._equilibrium(start, step)
        for _ in range(MOST_NEWTON_STEPS):
            if float(np.abs(force).max()) < UNBALANCED:
                break
            newton = np.linalg.solve(hessian, force)
            newton *= min(1.0, FARTHEST_STEP / float(np.abs(newton).max()))
            for _ in range(MOST_HALVINGS):
                trial = self._equilibrium(start, step + newton)
                if trial[0] <= potential + 1e-15:
                    break
                newton = newton / 2
            step = step + newton
            potential, force, hessian = trial
        self._step = np.clip(step, -FARTHEST_STEP, FARTHEST_STEP)
        sheared, length = self._sheared(start, self._step)
        self._shear = (
            sheared * (self._settings.shear / np.maximum(length, self._settings.shear))[:, None]
        )
        return self._step

    def _sheared(self, start: Array, step: Array) -> tuple[Array, Array]:
        """Shear of each pad's foot if none slid, shape (n, 2), and its length."""
        forward, sideways, turn = step
        sheared = start.copy()
        sheared[:, 0] += forward - turn * self._y
        sheared[:, 1] += sideways + turn * self._x
        return sheared, np.sqrt(np.einsum("ij,ij->i", sheared, sheared))

    def _equilibrium(self, start: Array, step: Array) -> tuple[float, Array, Array]:
        """Potential, force (along, across, moment) that is left on the body, and its Hessian."""
        most, k = self._settings.shear, self._stiffness
        sheared, length = self._sheared(start, step)
        slides = length > most
        share = np.where(slides, most / np.maximum(length, most), 1.0)
        energy = np.where(slides, most * (length - most / 2), length**2 / 2)
        pull = (k * share)[:, None] * sheared
        force = self._load - np.array(
            (pull[:, 0].sum(), pull[:, 1].sum(), self._x @ pull[:, 1] - self._y @ pull[:, 0])
        )
        # Stiffness of each pad: all of it where it sticks, across its slide alone where it slides.
        unit = sheared / np.maximum(length, 1e-12)[:, None]
        along = np.where(slides, 1.0, 0.0)
        kxx = k * share * (1 - along * unit[:, 0] ** 2)
        kyy = k * share * (1 - along * unit[:, 1] ** 2)
        kxy = -k * share * along * unit[:, 0] * unit[:, 1]
        x, y = self._x, self._y
        xz, yz = kxy * x - kxx * y, kyy * x - kxy * y
        a, b, c, d = kxx.sum(), kxy.sum(), xz.sum(), yz.sum()
        e = float(x @ yz - y @ xz)
        hessian = np.array(((a, b, c), (b, kyy.sum(), d), (c, d, e)))
        hessian[np.diag_indices(3)] += RIDGE * k.sum()
        return float(k @ energy - self._load @ step), force, hessian
