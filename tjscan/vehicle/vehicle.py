"""The protocol that every vehicle, real or simulated, fulfils."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Final, Protocol, Self

import numpy as np

from tjscan.core.devices import Device, LocalDevice
from tjscan.core.errors import VehicleFault, VehicleLinkLost, VehicleStopped
from tjscan.core.frames import FloatOrNan

DEAD_MAN_TIME: Final = 0.5
"""Seconds after its last command at which a vehicle stops by itself."""

PERIOD_SUM_TOLERANCE: Final = 1e-6
"""Seconds: sums of periods are no nearer to what they should be."""

PROXIMITY_CORNERS: Final = ("front left", "front right", "rear left", "rear right")
"""Where the proximity sensors are, in the order of `VehicleState.proximity`."""


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of a vehicle along its surface, in frame v: x forward, y right, z into the surface.

    Parameters
    ----------
    speed : float
        Along x, m/s.
    turn_rate : float
        About z, rad/s: clockwise as seen by one who looks at the surface from outside.
    sideways : float, optional
        Along y, m/s; nothing for a vehicle on tracks.
    """

    speed: float
    turn_rate: float
    sideways: float = 0.0


AT_REST: Final = Twist(0.0, 0.0)
"""The twist of a vehicle that does not move."""


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What a vehicle reports of itself.

    Parameters
    ----------
    time : float
        Seconds on the vehicle's own clock. A simulated vehicle's clock runs with its states, not
        with the wall.
    odometry : Twist
        The twist that the motors' encoders show. If the tracks slip, the vehicle moves
        otherwise.
    torques : tuple of float, optional
        Of the motors, at the sprocket, N m; empty if they are not known.
    proximity : tuple of float, optional
        Distance to the surface in metres at each of `PROXIMITY_CORNERS`; inf or NaN if nothing is
        in reach, empty if this state brings no new sample.
    fault : str, optional
        Of the drives, in a sentence; empty if they are well.
    gyro : tuple of float, optional
        Turn rate about z that a gyro shows, rad/s, as `Twist.turn_rate`; empty without a sample.
    down : tuple of float, optional
        Direction that an inclinometer shows to be down along the surface, from x towards y,
        radians; empty without a sample.
    push : tuple of float, optional
        Forces with which the wheels push the vehicle forward and sideways, newton, and turn it,
        N m, as its twist counts them; empty if they are not known.
    """

    time: float
    odometry: Twist
    torques: tuple[float, ...] = ()
    proximity: tuple[FloatOrNan, ...] = ()
    fault: str = ""
    gyro: tuple[float, ...] = ()
    down: tuple[float, ...] = ()
    push: tuple[float, ...] = ()


def merge_unread_states(states: Sequence[VehicleState], since: float | None = None) -> VehicleState:
    """The last of some states that came since one was read.

    Odometry, the gyro's turn rate and the wheels' push are means over time, so that way and turn
    since then come out right. It has the last other sample that any of them brought.

    Parameters
    ----------
    states : sequence of VehicleState
        Each with what it did since the one before.
    since : float, optional
        Time of the state that was read before; without, the first lasts as long as the others.
    """
    if len(states) == 1:
        return states[0]
    times, twists = [state.time for state in states], [state.odometry for state in states]
    before = 2 * times[0] - times[1] if since is None else since
    periods = np.maximum(np.diff(times, prepend=before), PERIOD_SUM_TOLERANCE)

    def mean(values: list[tuple[float, ...]]) -> tuple[float, ...]:
        weights = periods[[bool(value) for value in values]]
        known = [value for value in values if value]
        return tuple(np.average(known, axis=0, weights=weights).tolist()) if known else ()

    return replace(
        states[-1],
        odometry=Twist(*mean([(t.speed, t.turn_rate, t.sideways) for t in twists])),
        proximity=next((s.proximity for s in reversed(states) if s.proximity), ()),
        gyro=mean([state.gyro for state in states]),
        down=next((s.down for s in reversed(states) if s.down), ()),
        push=mean([state.push for state in states]),
    )


def check_twist(twist: Twist) -> None:
    """Refuse a twist that is not made of numbers.

    Raises
    ------
    VehicleFault
        If one is NaN or endless.
    """
    if not all(map(isfinite, (twist.speed, twist.turn_rate, twist.sideways))):
        raise VehicleFault(f"a vehicle can't drive {twist}")


class Vehicle(Device, Protocol):
    """A vehicle that drives as commanded; connecting and disconnecting leave it at rest."""

    @property
    def dead_man(self) -> float:
        """Seconds after the last command at which the vehicle stops by itself."""

    def command(self, twist: Twist) -> None:
        """Hold a twist until the next command, at most for the dead-man time.

        Raises
        ------
        VehicleStopped
            If it was stopped and that holds.
        DriveFault
            If its drives report a fault.
        VehicleLinkLost
            If it is not connected, or not any more.
        """

    def next_state(self) -> VehicleState:
        """Wait for the next state, and return it; some 100 come each second.

        Of several that came since the last call it is the newest; see `merge_unread_states`.

        A simulated vehicle goes on by one period instead of waiting, so simulated time runs as
        fast as the computer does. The state holds a fault of the drives.

        Raises
        ------
        VehicleLinkLost
            If none comes within a time limit, or the vehicle is not connected.
        """

    def stop(self) -> None:
        """Bring the vehicle to rest now, from any thread, and let it take no command any more.

        Every later command raises VehicleStopped, until the stop is taken back by
        `accept_commands_again`, or by connecting again. States go on coming.
        """

    def accept_commands_again(self) -> None:
        """Take commands again after a stop; the vehicle is at rest until the next one."""


class LocalVehicle(LocalDevice):
    """Base of simulated and replayed vehicles: holds an order for the dead-man time, or a stop.

    A signal's handler may stop a vehicle whatever it interrupts: no locks, but one order that is
    replaced as a whole, and a stop that outranks it.
    """

    not_connected = (VehicleLinkLost, "the vehicle is not connected: use it inside a 'with' block")
    dead_man: float = DEAD_MAN_TIME
    _order: tuple[Twist, float] | None = None
    _stopped = False

    def __enter__(self) -> Self:
        """Take commands."""
        self.accept_commands_again()
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        """Stop, and take no more commands."""
        self.stop()
        super().__exit__(*error)

    @property
    def time(self) -> float:
        """What the vehicle's clock shows, seconds."""
        raise NotImplementedError

    def command(self, twist: Twist) -> None:
        """Hold a twist until the next command. See `Vehicle.command`."""
        self.check_connected()
        check_twist(twist)
        self.check_twist_is_drivable(twist)
        if self._stopped:
            raise VehicleStopped
        self._order = twist, self.time

    def check_twist_is_drivable(self, twist: Twist) -> None:
        """Refuse a twist that the vehicle's drives can't follow."""

    def twist_to_drive(self) -> Twist | None:
        """What it is to drive now; None brakes."""
        order = self._order
        if self._stopped or order is None:
            return None
        return order[0] if self.time - order[1] < self.dead_man - PERIOD_SUM_TOLERANCE else None

    def stop(self) -> None:
        """Brake to rest, and take no command any more. See `Vehicle.stop`."""
        self._stopped = True

    def accept_commands_again(self) -> None:
        """Take commands again after a stop. See `Vehicle.accept_commands_again`."""
        self._order, self._stopped = None, False
