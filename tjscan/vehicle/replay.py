"""A vehicle that reports what a recording holds, whatever it is told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from tjscan.core.devices import DeviceBase
from tjscan.core.errors import VehicleFault, VehicleLinkLost, VehicleStopped
from tjscan.vehicle.vehicle import DEAD_MAN, Twist, VehicleState


class ReplayedVehicle(DeviceBase):
    """A vehicle that replays recorded states in their order, behind the `Vehicle` protocol.

    Parameters
    ----------
    states : sequence of VehicleState
        What it reports, one after the other.
    """

    dead_man: float = DEAD_MAN

    def __init__(self, states: Sequence[VehicleState]) -> None:
        self._states = tuple(states)
        self._next = 0
        self._connected = self._stopped = False

    def __enter__(self) -> Self:
        """Begin with the first state.

        Raises
        ------
        VehicleFault
            If the recording holds none.
        """
        if not self._states:
            raise VehicleFault("the recording holds no vehicle state: there is nothing to replay")
        self._next, self._connected, self._stopped = 0, True, False
        return self

    def __exit__(self, *error: object) -> None:
        self._connected = False

    def command(self, twist: Twist) -> None:
        """Do nothing: a replayed vehicle goes where it went. See `Vehicle.command`."""
        self._need_connection()
        if self._stopped:
            raise VehicleStopped

    def next_state(self) -> VehicleState:
        """Return the next recorded state.

        Raises
        ------
        VehicleLinkLost
            If the recording has ended.
        """
        self._need_connection()
        if self._next == len(self._states):
            raise VehicleLinkLost("the recording has ended")
        self._next += 1
        return self._states[self._next - 1]

    def stop(self) -> None:
        """Take no command any more; the recorded states go on."""
        self._stopped = True

    def accept_commands_again(self) -> None:
        """Take commands again after a stop."""
        self._stopped = False

    def _need_connection(self) -> None:
        if not self._connected:
            raise VehicleLinkLost("the recording is not open: use it inside a 'with' block")
