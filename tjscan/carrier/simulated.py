"""A simulated carrier: it takes its time, and stops a little beside where its encoders say."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from threading import Event
from time import monotonic
from typing import Annotated, Final, Self

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.carrier.kinematics import CarrierKinematics
from tjscan.core import units
from tjscan.core.devices import LocalDevice
from tjscan.core.errors import CarrierFault
from tjscan.core.frames import Array
from tjscan.core.pose_vector import boxplus

CARRIER_RANDOM_STREAM: Final = 11
"""Keeps the random numbers of a carrier's stops apart from others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CarrierSimulationSettings(units.SettingsTable):
    """The table [carrier.simulated]: how the simulated carrier moves, and where it truly stops.

    Parameters
    ----------
    speed, turn_rate : float
        Of linear axes, m/s, and of rotary ones, rad/s.
    realtime : bool
        Whether moves take their time.
    error, angular_error : float
        Root mean square by which the base truly is elsewhere at each stop than the encoders say,
        metres and radians, all directions together.
    reversed : tuple of str
        Axes that truly move the other way, about 0.
    """

    speed: Annotated[float, Gt(0), Le(10_000), units.MM_S] = 0.2
    turn_rate: Annotated[float, Gt(0), Le(360), units.DEG_S.with_key("speed_deg_s")] = radians(20)
    realtime: bool = False
    error: Annotated[float, Ge(0), Le(50), units.MM] = 0.0
    angular_error: Annotated[float, Ge(0), Le(5), units.DEG.with_key("error_deg")] = 0.0
    reversed: Annotated[tuple[str, ...], units.LIST_OR_WORD_IN_FILE] = ()

    def true_T_w_b(self, kinematics: CarrierKinematics, values: Array, seed: int) -> Array:
        """Where the base truly is, shape (4, 4), metres; the same each time at the same stop.

        Parameters
        ----------
        kinematics : CarrierKinematics
            As described.
        values : ndarray, shape (n,)
            What the encoders say.
        seed : int
            Of the simulated world.
        """
        signs = [-1.0 if axis.name in self.reversed else 1.0 for axis in kinematics.axes]
        T_w_b = kinematics.T_w_b(np.array(signs) * values)
        stop = np.abs(np.rint(1e6 * np.asarray(values))).astype(np.int64).tolist()
        spread = np.repeat((self.error, self.angular_error), 3) / np.sqrt(3)
        drawn = np.random.default_rng([seed, CARRIER_RANDOM_STREAM, *stop]).standard_normal(6)
        return boxplus(T_w_b, spread * drawn)


class SimulatedCarrier(LocalDevice):
    """A carrier that is simulated; see `Carrier`.

    Parameters
    ----------
    kinematics : CarrierKinematics
    values : ndarray, shape (n,)
        Where it is.
    settings : CarrierSimulationSettings
    """

    not_connected = (CarrierFault, "the carrier is not connected: use it in a 'with' block")

    def __init__(
        self, kinematics: CarrierKinematics, values: Array, settings: CarrierSimulationSettings
    ) -> None:
        self._values, self._settings, self._stopped = np.array(values), settings, Event()
        rates = {"linear": settings.speed, "rotary": settings.turn_rate}
        self._rates = np.array([rates[axis.kind] for axis in kinematics.axes])

    def __enter__(self) -> Self:
        self._stopped.clear()
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        self.stop()
        super().__exit__(*error)

    def state(self) -> Array:
        """See `Carrier.state`."""
        self.check_connected()
        return self._values.copy()

    def move_to(self, values: Array) -> Array:
        """See `Carrier.move_to`."""
        start, way = self.state(), np.asarray(values) - self._values
        takes = self._settings.realtime * float((np.abs(way) / self._rates).max())
        began, share = monotonic(), 1.0
        if self._stopped.wait(takes):
            share = min(monotonic() - began, takes) / max(takes, 1e-9)
        self._values = start + share * way
        if share < 1.0:
            raise CarrierFault(
                f"the carrier was stopped after {share:.0%} of its move. See that the way is clear"
            )
        return self.state()

    def stop(self) -> None:
        """See `Carrier.stop`."""
        self._stopped.set()
