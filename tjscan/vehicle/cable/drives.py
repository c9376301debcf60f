"""How simulated wheels push a vehicle: a lag, speed control, and no more than motors and grip."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.vehicle.cable.model import TowingVehicleModel

GRAVITY_M_S2: Final = 9.81
"""m/s²."""

CONTROL_RATE: Final = 40.0
"""rad/s: natural frequency of the wheels' speed control, critically damped. Assumption: its
integral part holds a vehicle as a spring of mass times its square would, 16 N/mm for 10 kg."""


class OmnidirectionalDrives:
    """Wheels of several vehicles of one make, each a speed control of its own.

    Proportional and integral control of the speeds in the plane gives forces, limited by motors
    and grip. Beyond, wheels spin or stall, and the integral holds no more than what they give.

    Parameters
    ----------
    model : TowingVehicleModel
    vehicles : int
        How many: n.
    """

    def __init__(self, model: TowingVehicleModel, vehicles: int) -> None:
        self._model = model
        inertia = 0.5 * model.mass * model.body_radius**2
        self._mass = np.array((model.mass, model.mass, inertia))
        self.grip_force = model.grip * model.mass * GRAVITY_M_S2
        """Most that the floor gives the wheels of a vehicle, newton."""
        self.most_force = min(model.force, self.grip_force)
        """Most that a vehicle pushes with, newton."""
        self._most_moment = self.most_force * model.body_radius
        self.wanted = np.zeros((vehicles, 3))
        """Speeds that the wheels are controlled to, in each vehicle's frame, shape (n, 3)."""
        self.wheels = np.zeros((vehicles, 3))
        """Speeds that the wheels show, in each vehicle's frame, shape (n, 3)."""
        self._behind = np.zeros((vehicles, 3))

    def forces(
        self,
        commanded: Array,
        braked: NDArray[np.bool_],
        headings: Array,
        speeds: Array,
        drift: Array,
        period: float,
    ) -> Array:
        """Forces and moments of the wheels, in frame w.

        Parameters
        ----------
        commanded : ndarray, shape (n, 3)
            Speed, sideways speed and turn rate of each vehicle, in its frame.
        braked : ndarray of bool, shape (n,)
            Which of them brake to rest instead.
        headings : ndarray, shape (n,)
            Radians.
        speeds : ndarray, shape (n, 3)
            Of the bodies in frame w, m/s and rad/s.
        drift : ndarray, shape (n, 3)
            With which the floor carries the wheels away, unseen by them, in frame w.
        period : float
            Seconds that the forces will last.

        Returns
        -------
        ndarray, shape (n, 3)
            Newton and N m.
        """
        self._follow_commands(np.where(braked[:, None], 0.0, commanded), braked, period)
        wanted = _turn_velocities(self.wanted, headings)
        slow = wanted + drift - speeds
        self._behind = self._behind + slow * period
        rate = CONTROL_RATE
        asked = self._mass * (rate**2 * self._behind + 2 * rate * slow)
        given = asked * self._available_share(asked)
        # What the integral alone asks for is held to what there is, or it would wind up.
        held = self._mass * rate**2 * self._behind
        self._behind = self._behind * self._available_share(held)
        spins = np.any(given != asked, axis=1, keepdims=True)
        self.wheels = np.where(spins, self.wanted, _turn_velocities(speeds - drift, -headings))
        return given

    def _follow_commands(self, commanded: Array, braked: NDArray[np.bool_], period: float) -> None:
        m = self._model
        along = np.linalg.norm(commanded[:, :2], axis=1, keepdims=True)
        limited = commanded * np.minimum(1.0, m.top_speed / np.maximum(along, 1e-12))
        limited[:, 2] = np.clip(commanded[:, 2], -m.top_turn_rate, m.top_turn_rate)
        share = 1.0 if m.lag == 0 else -np.expm1(-period / m.lag)
        change = np.where(braked[:, None], 1.0, share) * (limited - self.wanted)
        most = np.where(braked, m.braking, m.acceleration)[:, None] * period
        most = most * np.array((1.0, 1.0, 1.0 / m.body_radius))
        self.wanted = self.wanted + np.clip(change, -most, most)

    def _available_share(self, forces: Array) -> Array:
        """Which share of each vehicle's force and moment there is, shape (n, 3)."""
        along = np.linalg.norm(forces[:, :2], axis=1, keepdims=True)
        force = np.minimum(1.0, self.most_force / np.maximum(along, 1e-12))
        moment = np.minimum(1.0, self._most_moment / np.maximum(np.abs(forces[:, 2:]), 1e-12))
        return np.hstack((force, force, moment))


def _turn_velocities(speeds: Array, headings: Array) -> Array:
    """Speeds (n, 3) in the plane, turned by an angle each."""
    c, s = np.cos(headings), np.sin(headings)
    x, y, turn = speeds.T
    return np.column_stack((c * x - s * y, s * x + c * y, turn))
