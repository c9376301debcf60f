"""Several real vehicles, each read by a thread of its own: a silent one holds up no other."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from queue import SimpleQueue
from typing import Final, Self

from tjscan.core.devices import DeviceBase, EventListener
from tjscan.core.errors import VehicleFault, VehicleLinkLost
from tjscan.vehicle.vehicle import Vehicle, VehicleState, merge_unread_states

LOST_LINK_RETRY_PERIOD: Final = 0.05
"""Seconds after which a vehicle whose link is lost is polled again."""


class PacedTeam(DeviceBase):
    """Vehicles on this computer's clock; a context manager that connects them all.

    Parameters
    ----------
    vehicles : sequence of Vehicle
    """

    def __init__(self, vehicles: Sequence[Vehicle]) -> None:
        self.vehicles = tuple(vehicles)
        self._newest: list[VehicleState | VehicleFault] = []
        self._unread: list[SimpleQueue[VehicleState]] = []
        self._events: SimpleQueue[tuple[str, str]] = SimpleQueue()
        self._closed = threading.Event()
        self._connections = ExitStack()

    @property
    def time(self) -> float:
        """`time.monotonic`."""
        return time.monotonic()

    def __enter__(self) -> Self:
        self._closed.clear()
        self._newest = [VehicleLinkLost("no state of it came yet")] * len(self.vehicles)
        self._unread = [SimpleQueue() for _ in self.vehicles]
        with ExitStack() as stack:
            for number, vehicle in enumerate(self.vehicles, 1):
                vehicle.report_events_to(self._listener_of_vehicle(number))
                stack.enter_context(vehicle)
            stack.callback(self._closed.set)
            self._connections = stack.pop_all()
        for k in range(len(self.vehicles)):
            threading.Thread(target=self._read_states, args=(k,), daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        for vehicle in self.vehicles:
            vehicle.stop()
        self._connections.close()

    def advance_to(self, moment: float) -> tuple[VehicleState | VehicleFault, ...]:
        """Wait until a time of this clock; return each vehicle's newest state, or its fault.

        Odometry is the mean since the last call.
        """
        time.sleep(max(0.0, moment - time.monotonic()))
        while not self._events.empty():
            self._listener(*self._events.get())
        return tuple(self._read_newest(k) for k in range(len(self.vehicles)))

    def _read_newest(self, k: int) -> VehicleState | VehicleFault:
        newest, unread = self._newest[k], self._unread[k]
        states = [unread.get() for _ in range(unread.qsize())]
        if states and isinstance(newest, VehicleState):
            return merge_unread_states(states)
        return newest

    def _listener_of_vehicle(self, number: int) -> EventListener:
        return lambda name, sentence: self._events.put((name, f"vehicle {number}: {sentence}"))

    def _read_states(self, k: int) -> None:
        while not self._closed.is_set():
            try:
                state = self._newest[k] = self.vehicles[k].next_state()
                self._unread[k].put(state)
            except VehicleFault as error:
                self._newest[k] = error
                self._closed.wait(LOST_LINK_RETRY_PERIOD)
