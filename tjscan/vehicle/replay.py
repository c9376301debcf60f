"""A vehicle that reports what a recording holds, whatever it is commanded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from tjscan.core.errors import VehicleFault, VehicleLinkLost, VehicleStopped
from tjscan.vehicle.vehicle import LocalVehicle, Twist, VehicleState


class ReplayedVehicle(LocalVehicle):
    """A vehicle that replays recorded states in their order, behind the `Vehicle` protocol.

    Parameters
    ----------
    states : sequence of VehicleState
        What it reports, one after the other.
    """

    not_connected = (VehicleLinkLost, "the recording is not open: use it inside a 'with' block")

    def __init__(self, states: Sequence[VehicleState]) -> None:
        self._states = tuple(states)
        self._next = 0

    def __enter__(self) -> Self:
        """Begin with the first state.

        Raises
        ------
        VehicleFault
            If the recording holds none.
        """
        if not self._states:
            raise VehicleFault("the recording holds no vehicle state: there is nothing to replay")
        self._next = 0
        return super().__enter__()

    def command(self, twist: Twist) -> None:
        """Do nothing: a replayed vehicle goes where it went. See `Vehicle.command`."""
        self.check_connected()
        if self._stopped:
            raise VehicleStopped

    def next_state(self) -> VehicleState:
        """Return the next recorded state.

        Raises
        ------
        VehicleLinkLost
            If the recording has ended.
        """
        self.check_connected()
        if self._next == len(self._states):
            raise VehicleLinkLost("the recording has ended")
        self._next += 1
        return self._states[self._next - 1]
