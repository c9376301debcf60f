"""A simulated vehicle: it slips unseen by its encoders, and its clock runs with its states."""

from __future__ import annotations

from tjscan.core.errors import VehicleFault
from tjscan.core.frames import Array
from tjscan.vehicle.simulated_body import SimulatedBody
from tjscan.vehicle.vehicle import LocalVehicle, Twist, VehicleState


class SimulatedVehicle(LocalVehicle):
    """A vehicle on tracks that is simulated, behind the `Vehicle` protocol.

    Parameters
    ----------
    body : SimulatedBody
        What moves, and where it truly is.
    """

    def __init__(self, body: SimulatedBody) -> None:
        self.body = body

    @property
    def time(self) -> float:
        """What the vehicle's clock shows, seconds."""
        return self.body.time

    def check_twist_is_drivable(self, twist: Twist) -> None:
        """Refuse to drive sideways."""
        if twist.sideways:
            raise VehicleFault("a vehicle on tracks can't drive sideways")

    def next_state(self) -> VehicleState:
        """Go on by one period and report the state. See `Vehicle.next_state`."""
        self.check_connected()
        return self.body.advance(self.twist_to_drive())

    def true_pose(self) -> Array:
        """True pose T_w_v on the unrolled surface, shape (4, 4), which no real vehicle knows."""
        return self.body.T_w_v
