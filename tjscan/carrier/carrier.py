"""The protocol that every carrier of an arm or a joint fulfils."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, Self

import numpy as np

from tjscan.carrier.kinematics import CarrierKinematics
from tjscan.core.devices import Device, LocalDevice
from tjscan.core.errors import CarrierFault
from tjscan.core.frames import Array


class Carrier(Device, Protocol):
    """A track, gantry or turn-table; it rests when it connects, and when it disconnects."""

    def state(self) -> Array:
        """Values of the axes as they now are, shape (n,), metres and radians."""

    def move_to(self, values: Array) -> Array:
        """Move all axes together to values, wait until they rest, and return what they reached.

        Raises
        ------
        CarrierFault
            If they do not get there, or were stopped.
        """

    def stop(self) -> None:
        """Bring it to rest, from any thread; it takes no further move. May be repeated."""


class ManualCarrier(LocalDevice):
    """No carrier that the program reaches: a person moves it, and what they confirm is believed.

    Parameters
    ----------
    kinematics : CarrierKinematics
        Of the carrier.
    values : ndarray, shape (n,)
        Where it is.
    ask : callable
        Asks a person to do something, and returns whether it is done.
    """

    not_connected = (CarrierFault, "the carrier is not connected: use it in a 'with' block")

    def __init__(
        self, kinematics: CarrierKinematics, values: Array, ask: Callable[[str], bool]
    ) -> None:
        self._kinematics, self._values, self._ask = kinematics, np.array(values), ask

    def __enter__(self) -> Self:
        """Ask whether it is where it was left.

        Raises
        ------
        CarrierFault
            If it is not.
        """
        where = self._kinematics.describe(self._values)
        if not self._ask(f"Is the carrier at {where}, and at rest?"):
            raise CarrierFault(f"the carrier is not at {where}: bring it there, then start again")
        return super().__enter__()

    def state(self) -> Array:
        """See `Carrier.state`."""
        return self._values.copy()

    def move_to(self, values: Array) -> Array:
        """See `Carrier.move_to`."""
        self.check_connected()
        where = self._kinematics.describe(values)
        if not self._ask(f"Move the carrier to {where}. Is it there, and at rest?"):
            raise CarrierFault(f"the carrier was not moved to {where} by hand")
        self._values = np.array(values)
        return self.state()

    def stop(self) -> None:
        """See `Carrier.stop`."""
