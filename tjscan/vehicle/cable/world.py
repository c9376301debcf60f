"""A simulated work area: a plant, drives, passers-by, one clock, and what can go wrong in it."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from tjscan.core.frames import Array, Mask, array_dataclass, readonly_copy
from tjscan.vehicle.cable.model import TowingVehicleModel, TowingWorldModel
from tjscan.vehicle.cable.plant import TIME_STEP, CablePlant
from tjscan.vehicle.pad_plant import GRAVITY_M_S2
from tjscan.vehicle.vehicle import Twist, VehicleState

WHEEL_CONTROL_RATE: Final = 40.0
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
        self.most_force = min(model.force, model.grip * model.mass * GRAVITY_M_S2)
        """Most that a vehicle pushes with, newton: what its motors give, or the floor's grip."""
        self._most_moment = self.most_force * model.body_radius
        self.wanted = np.zeros((vehicles, 3))
        """Speeds that the wheels are controlled to, in each vehicle's frame, shape (n, 3)."""
        self.wheels = np.zeros((vehicles, 3))
        """Speeds that the wheels show, in each vehicle's frame, shape (n, 3)."""
        self.pushes = np.zeros((vehicles, 3))
        """Forces and moment of the wheels on each vehicle, in its frame, shape (n, 3)."""
        self._behind = np.zeros((vehicles, 3))

    def forces(
        self,
        commanded: Array,
        braked: Mask,
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
        self._run_after_commands(np.where(braked[:, None], 0.0, commanded), braked, period)
        wanted = _turn_velocities(self.wanted, headings)
        slow = wanted + drift - speeds
        self._behind = self._behind + slow * period
        rate = WHEEL_CONTROL_RATE
        asked = self._mass * (rate**2 * self._behind + 2 * rate * slow)
        given = asked * self._available_share(asked)
        # What the integral alone asks for is held to what there is, or it would wind up.
        held = self._mass * rate**2 * self._behind
        self._behind = self._behind * self._available_share(held)
        spins = np.any(given != asked, axis=1, keepdims=True)
        self.pushes = _turn_velocities(given, -headings)
        self.wheels = np.where(spins, self.wanted, _turn_velocities(speeds - drift, -headings))
        return given

    def _run_after_commands(self, commanded: Array, braked: Mask, period: float) -> None:
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


POSE_HISTORY_DURATION: Final = 5.0
"""Seconds for which the world remembers where the vehicles were."""

PUSH_DURATION: Final = 0.5
"""Seconds that a push takes."""

JAMMED_WHEELS_FAULT: Final = "wheels: jammed"


@array_dataclass
class TowingTruth:
    """What is true in a simulated world, and no algorithm may see.

    Parameters
    ----------
    time : float
        Seconds on the world's clock.
    points : Array
        The root and the far end of each link in the plane, metres, shape (N + 1, 2).
    angles : Array
        Of the joints in the plane, radians, shape (N,).
    poses : Array
        Of the vehicles: x, y, heading, shape (n, 3).
    forces : Array
        Of the cable on each vehicle, and of all else that touches it: newton and N m about its
        origin, frame w, shape (n, 3); the mean since the truth was last asked for.
    drive_forces : Array
        Of each vehicle's wheels, newton, shape (n,); the largest since then.
    passers_by : Array
        x, y, radius, and the speed along x and y, shape (k, 5).
    touches : tuple of str
        What touched what since then, but for the floor, in alphabetical order.
    """

    time: float
    points: Array
    angles: Array
    poses: Array
    forces: Array
    drive_forces: Array
    passers_by: Array
    touches: tuple[str, ...]


class TowingWorld:
    """Vehicles that hold a cable, and everything around them.

    The same seed and orders give the same motion, to the last bit on one machine.

    Parameters
    ----------
    model : TowingWorldModel
        What there is.
    angles : ndarray, shape (N,)
        Of the cable's joints at first, radians.
    seed : int, optional
        Of the encoders' noise.
    time : float, optional
        What the clock shows at first, seconds.
    settle : float, optional
        Seconds for which all are at rest before that: the cable settles as friction lets it.
    step : float, optional
        Of the plant, seconds.
    """

    def __init__(
        self,
        model: TowingWorldModel,
        angles: Array,
        *,
        seed: int = 0,
        time: float = 0.0,
        settle: float = 1.0,
        step: float = TIME_STEP,
    ) -> None:
        self.model, self.plant = model, CablePlant(model, angles, step=step)
        self.vehicles: int = len(model.cable.held)
        """How many: n."""
        self._drives = OmnidirectionalDrives(model.vehicle, self.vehicles)
        self._encoders = np.random.default_rng(seed)
        body, cable = model.vehicle, model.cable
        mass = body.mass + cable.link_mass
        turning = body.mass * body.body_radius**2 / 2
        turning += cable.link_mass * cable.link_length**2 / 3
        self._inertia = np.array((mass, mass, turning))
        self._forces = np.zeros((self.vehicles, 3))
        self._summed, self._most_push = 0, np.zeros(self.vehicles)
        self._commanded = np.zeros((self.vehicles, 3))
        self._braked = np.ones(self.vehicles, dtype=bool)
        self._jammed = np.zeros(self.vehicles, dtype=bool)
        self._pushed = np.zeros((self.vehicles, 3))
        self._push_ends = np.full(self.vehicles, -np.inf)
        self._held_passers = np.zeros(len(model.passers_by), dtype=bool)
        self._met_passers = self._held_passers.copy()
        # A passer-by walks by a clock of its own, which stops while it is held.
        self._walked = np.full(len(model.passers_by), time)
        self._asked, self._gone, self._began = 0.0, 0, time - settle
        self._place_passers_by()
        self._reset_sums()
        self.poses_before: deque[tuple[float, Array]] = deque()
        """When, and where the vehicles were, x, y and heading, (n, 3), of the last seconds."""
        self._remember_poses()
        self.advance(settle)
        self._walked[:] = time

    @property
    def time(self) -> float:
        """What the clock shows, seconds."""
        return self._began + self._gone * self.plant.step

    def order(self, vehicle: int, twist: Twist | None) -> None:
        """Let a vehicle drive a twist until the next order; None brakes it to rest."""
        self._braked[vehicle] = twist is None
        if twist is not None:
            self._commanded[vehicle] = (twist.speed, twist.sideways, twist.turn_rate)

    def advance(self, period: float) -> None:
        """Go on by a period, seconds: by as many whole steps of the plant as it has room for.

        Raises
        ------
        VehicleFault
            If the simulation diverges.
        """
        self._asked += period
        while self._asked - self._gone * self.plant.step > self.plant.step / 2:
            self._advance_by_step()
        self._remember_poses()

    def state(self, vehicle: int) -> VehicleState:
        """What a vehicle reports of itself now."""
        noise = self.model.vehicle.encoder_noise * self._encoders.standard_normal(3)
        noise[2] /= self.model.vehicle.body_radius
        speed, sideways, turn_rate = (self._drives.wheels[vehicle] + noise).tolist()
        return VehicleState(
            self.time,
            Twist(speed, turn_rate, sideways),
            push=tuple(self._drives.pushes[vehicle].tolist()),
            fault=JAMMED_WHEELS_FAULT if self._jammed[vehicle] else "",
        )

    def is_at_rest(self, vehicle: int) -> bool:
        """Whether a vehicle's wheels are commanded to rest, and do."""
        return not self._drives.wanted[vehicle].any()

    @property
    def passers_by(self) -> Array:
        """x, y, radius, and the speed along x and y, of each passer-by now, shape (k, 5)."""
        discs = np.zeros((len(self.model.passers_by), 5))
        for which, passer_by in enumerate(self.model.passers_by):
            at, speed = passer_by.motion_at(self._walked[which])
            if self._held_passers[which] or self._met_passers[which]:
                speed = np.zeros(2)
            discs[which] = (*at, passer_by.radius, *speed)
        return discs

    def truth(self) -> TowingTruth:
        """What is true now, and what happened since this was last asked for."""
        plant = self.plant
        headings = plant.headings
        root = self.model.cable.root
        first = headings[0] if root is None else root[2]
        if self._summed:
            duration = self._summed * plant.step
            gained = self._inertia * (plant.speeds - self._speeds_then) / duration
            self._forces = gained - self._pushes / self._summed
        truth = TowingTruth(
            self.time,
            plant.points[:, :2],
            (np.diff(headings, prepend=first) + np.pi) % (2 * np.pi) - np.pi,
            plant.poses,
            self._forces,
            self._most_push,
            self.passers_by,
            tuple(sorted(f"{a} and {b}" for a, b in self._touched | plant.touching_pairs)),
        )
        self._reset_sums()
        return truth

    # What can go wrong

    def set_jammed(self, vehicle: int, jammed: bool) -> None:
        """Let a vehicle's wheels lock, or run again."""
        self._jammed[vehicle] = jammed

    def push(self, vehicle: int, x: float, y: float) -> None:
        """Let the floor carry a vehicle away, metres along x and y of w, unseen by its wheels."""
        self._pushed[vehicle] = (x / PUSH_DURATION, y / PUSH_DURATION, 0.0)
        self._push_ends[vehicle] = self.time + PUSH_DURATION

    def hold_passer_by(self, which: int, stops: bool) -> None:
        """Hold a passer-by at its place, or let it walk on."""
        self._held_passers[which] = stops

    # How it goes on

    def _advance_by_step(self) -> None:
        plant, step = self.plant, self.plant.step
        drift = np.where((self.time < self._push_ends)[:, None], self._pushed, 0.0)
        forces = self._drives.forces(
            self._commanded,
            self._braked | self._jammed,
            plant.poses[:, 2],
            plant.speeds,
            drift,
            step,
        )
        plant.advance(forces)
        self._gone += 1
        touches = plant.touching_pairs
        for which, stopped in enumerate(self._held_passers):
            # One that walks into something stops there: no floor could hold what it would push.
            met = any(f"passer-by {which + 1}" in pair for pair in touches)
            self._met_passers[which] = met and self._walks_into_something(which)
            self._walked[which] += 0.0 if stopped or self._met_passers[which] else step
        self._place_passers_by()
        self._pushes += forces
        self._most_push = np.maximum(self._most_push, np.hypot(forces[:, 0], forces[:, 1]))
        self._summed += 1
        self._touched |= touches

    def _walks_into_something(self, which: int) -> bool:
        """Whether what a passer-by touches, cable or vehicle, is ahead of it."""
        at, speed = self.model.passers_by[which].motion_at(self._walked[which])
        places = np.vstack((self.plant.points[:, :2], self.plant.poses[:, :2])) - at
        apart = np.hypot(*places.T)
        apart[-self.vehicles :] -= self.model.vehicle.body_radius
        return bool(places[apart.argmin()] @ speed > 0.0)

    def _place_passers_by(self) -> None:
        for which, passer_by in enumerate(self.model.passers_by):
            self.plant.place_passer_by(which, passer_by.motion_at(self._walked[which])[0])

    def _reset_sums(self) -> None:
        self._speeds_then = self.plant.speeds
        self._pushes = np.zeros((self.vehicles, 3))
        self._most_push = np.zeros(self.vehicles)
        self._summed = 0
        self._touched: set[tuple[str, str]] = set()

    def _remember_poses(self) -> None:
        self.poses_before.append((self.time, readonly_copy(self.plant.poses)))
        while self.poses_before[0][0] < self.time - POSE_HISTORY_DURATION:
            self.poses_before.popleft()
