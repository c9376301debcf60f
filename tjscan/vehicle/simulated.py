"""A simulated vehicle: it slips unseen by its encoders, and its clock runs with its states."""

from __future__ import annotations

import threading
from typing import Final, Self

from tjscan.core.devices import DeviceBase
from tjscan.core.errors import VehicleFault, VehicleLinkLost, VehicleStopped
from tjscan.core.frames import Array
from tjscan.vehicle.simulated_body import SimulatedBody
from tjscan.vehicle.vehicle import DEAD_MAN, Twist, VehicleState, check_twist

ON_TIME: Final = 1e-6
"""Seconds: sums of periods are no nearer to what they should be."""


class SimulatedVehicle(DeviceBase):
    """A vehicle on tracks that is simulated, behind the `Vehicle` protocol.

    Parameters
    ----------
    body : SimulatedBody
        What moves, and where it truly stands.
    """

    dead_man: float = DEAD_MAN

    def __init__(self, body: SimulatedBody) -> None:
        self.body = body
        self._twist: Twist | None = None
        self._commanded = body.time
        self._connected = self._stopped = False
        self._lock = threading.RLock()  # a signal's handler may stop what it interrupted

    def __enter__(self) -> Self:
        """Take commands."""
        self.accept_commands_again()
        self._connected = True
        return self

    def __exit__(self, *error: object) -> None:
        """Stop, and take no more commands."""
        self.stop()
        self._connected = False

    def command(self, twist: Twist) -> None:
        """Hold a twist until the next command. See `Vehicle.command`."""
        self._need_connection()
        check_twist(twist)
        if twist.sideways:
            raise VehicleFault("a vehicle on tracks can't drive sideways")
        with self._lock:
            if self._stopped:
                raise VehicleStopped
            self._twist, self._commanded = twist, self.body.time

    def next_state(self) -> VehicleState:
        """Go on by one period and report the state. See `Vehicle.next_state`."""
        self._need_connection()
        with self._lock:
            if self.body.time - self._commanded > self.dead_man - ON_TIME:
                self._twist = None
            return self.body.advance(self._twist)

    def true_pose(self) -> Array:
        """True pose T_w_v on the unrolled surface, shape (4, 4), which no real vehicle knows."""
        return self.body.T_w_v

    def stop(self) -> None:
        """Brake to rest, and take no command any more. See `Vehicle.stop`."""
        self._stopped = True
        with self._lock:
            self._twist = None

    def accept_commands_again(self) -> None:
        """Take commands again after a stop. See `Vehicle.accept_commands_again`."""
        with self._lock:
            self._twist, self._stopped = None, False

    def _need_connection(self) -> None:
        if not self._connected:
            raise VehicleLinkLost("the vehicle is not connected: use it inside a 'with' block")
