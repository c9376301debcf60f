"""Truth of a vehicle from the friction of each pad: two tracks of stick-slip brushes with weight.

It shares no equation with the slip ratios of `slip_plant`: slip, crab, drift and the centre of
rotation come out of what the pads can hold.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from tjscan.core.frames import Array, readonly_copy
from tjscan.core.units import DEG, KG, MM, SettingsTable
from tjscan.vehicle.tracks import TrackGeometry, moved_pose

GRAVITY_M_S2: Final = 9.81
"""m/s²."""

EQUILIBRIUM_TOLERANCE: Final = 1e-6
"""N and N m: forces that add up to less are in equilibrium."""

MOST_NEWTON_STEPS: Final = 40
MOST_STEP_HALVINGS: Final = 20
"""Both are far more than any step needs that has an equilibrium."""

LEAST_STIFFNESS_SHARE: Final = 1e-9
"""Share of the stiffness that is left if every pad slides."""

ROUNDING_ENERGY: Final = 1e-15
"""J: by so much a potential may seem to rise that falls."""

LEAST_DIVISOR_LENGTH: Final = 1e-15
"""Metres: keeps what is divided by a length of nothing finite."""

FARTHEST_BODY_STEP: Final = 0.01
"""Metres and radians in one period: a body that nothing holds falls no faster."""


ComplexArray = NDArray[np.complex128]

_DIAGONAL_INDICES: Final = np.diag_indices(3)


@dataclass(frozen=True, slots=True, kw_only=True)
class PadSettings(SettingsTable):
    """The table [simulation.vehicle.pads]: pads, friction, weight and the surface's inclination.

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
        Of the surface to the level, radians: 0 a floor, 90° a wall, 180° a ceiling.
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
    inclination: Annotated[float, Ge(0), Le(180), DEG] = pi / 2
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
        Its first pose.
    """

    def __init__(self, settings: PadSettings, tracks: TrackGeometry, pose_w: Array) -> None:
        n, s = settings.pads, settings
        self.pose_w = readonly_copy(pose_w)
        self._settings, self._radius = s, tracks.sprocket_radius
        self._numbers = np.tile((np.arange(n) + 0.5) / n, 2)
        self._coordinates_up_and_y = np.repeat((-0.5j, 0.5j), n) * tracks.gauge
        self._run = np.zeros(2)  # of the tracks, in lengths of their contact
        # Points and vectors on the surface are complex in frame v: x forward, y times i.
        self._shear = np.zeros(2 * n, dtype=complex)
        self._step = np.zeros(3)
        self._place_pads(np.zeros(2))
        self._settle_pads(np.zeros(2))  # it has hung there for long

    @property
    def torques(self) -> tuple[float, ...]:
        """Torque of the left and right motor at its sprocket, N m, in the sense of its rate."""
        held = (self._stiffness * self._shear.real).reshape(2, -1).sum(axis=1) * self._radius
        return float(-held[0]), float(held[1])

    def advance(self, left: float, right: float, period: float) -> None:
        """Let the tracks run for a period. See `VehiclePlant.advance`."""
        run = np.array((left, right)) * period
        self._place_pads(run)
        step = self._settle_pads(run)
        self.pose_w = moved_pose(self.pose_w, step / period, period)

    def _place_pads(self, run: Array) -> None:
        """Carry the pads along with their tracks, and find how hard each is pressed on."""
        s, n = self._settings, self._settings.pads
        laps = self._numbers + np.repeat(self._run, n)
        self._run = self._run + run / s.contact_length
        now = self._numbers + np.repeat(self._run, n)
        whole = np.floor(now)
        self._shear[whole != np.floor(laps)] = 0.0  # it left, and another one entered
        self._at = s.contact_length * (0.5 - (now - whole)) + self._coordinates_up_and_y
        self._lever = self._at.conj()
        self._lever_sq = self._lever**2
        weight = s.mass * GRAVITY_M_S2
        down = sin(s.inclination) * cmath.exp(1j * (s.down - float(self.pose_w[2])))
        self._load = weight * np.array((down.real, down.imag, 0.0))
        pressed = s.grip * GRAVITY_M_S2 + weight * cos(s.inclination) / (2 * n)
        along = (self._lever * down).real
        along = along - along.mean()
        peel = weight * s.mass_height * abs(down) ** 2 * along
        peel /= max(float(along @ along), 1e-12)  # on the level there is none
        self._stiffness = s.friction * np.maximum(pressed + peel, 0.0) / s.shear

    def _settle_pads(self, run: Array) -> Array:
        """Shear the pads to equilibrium; returns the body's step (forward, sideways, turn).

        The equilibrium is where a convex potential is least (that of springs that give way, with
        the weight), so Newton steps that are halved until it falls reach it.
        """
        start = self._shear - np.repeat(run, self._settings.pads)
        step = self._step if run.any() else np.zeros(3)
        potential, force, hessian = self._equilibrium_residual(start, step)
        for _ in range(MOST_NEWTON_STEPS):
            if float(np.abs(force).max()) < EQUILIBRIUM_TOLERANCE:
                break
            newton = np.linalg.solve(hessian, force)
            newton *= min(1.0, FARTHEST_BODY_STEP / float(np.abs(newton).max()))
            for _ in range(MOST_STEP_HALVINGS):
                trial = self._equilibrium_residual(start, step + newton)
                if trial[0] <= potential + ROUNDING_ENERGY:
                    break
                newton = newton / 2
            step = step + newton
            potential, force, hessian = trial
        self._step = np.clip(step, -FARTHEST_BODY_STEP, FARTHEST_BODY_STEP)
        sheared = self._pad_shears(start, self._step)
        self._shear = sheared * np.minimum(
            1.0, self._settings.shear / (np.abs(sheared) + LEAST_DIVISOR_LENGTH)
        )
        return self._step

    def _pad_shears(self, start: ComplexArray, step: Array) -> ComplexArray:
        """Shear of each pad's foot, if none slid."""
        forward, sideways, turn = step.tolist()
        return np.asarray(start + (complex(forward, sideways) + 1j * turn * self._at))

    def _equilibrium_residual(self, start: ComplexArray, step: Array) -> tuple[float, Array, Array]:
        """Potential, force (along, across, moment) that is left on the body, and its Hessian."""
        most, k = self._settings.shear, self._stiffness
        sheared = self._pad_shears(start, step)
        length = np.abs(sheared) + LEAST_DIVISOR_LENGTH
        slides = length > most
        share = k * np.minimum(1.0, most / length)
        energy = np.where(slides, most * (length - most / 2), length**2 / 2)
        pull = share * sheared
        both = pull.sum()
        force = self._load - (both.real, both.imag, (self._lever @ pull).imag)
        # A pad that sticks is stiff in all directions (a), one that slides across its slide
        # alone: half of it in all directions, and half that turns twice as its slide does (b).
        half = np.where(slides, share / 2, 0.0)
        a = share - half
        b = -half * (sheared / length) ** 2
        sa, sb = a.sum(), b.sum()
        ar, br = a @ self._at, b @ self._lever
        turn = a @ np.abs(self._lever_sq) - (b @ self._lever_sq).real
        hessian = np.array(
            (
                (sa + sb.real, sb.imag, br.imag - ar.imag),
                (sb.imag, sa - sb.real, ar.real - br.real),
                (br.imag - ar.imag, ar.real - br.real, turn),
            )
        )
        hessian[_DIAGONAL_INDICES] += LEAST_STIFFNESS_SHARE * k.sum()
        return float(k @ energy - self._load @ step), force, hessian
