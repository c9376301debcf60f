"""Loopback vehicles as a process of its own, for whoever wants some under control."""

from __future__ import annotations

import json
from typing import Any, Final

from tjscan.core.errors import VehicleFault, VehicleLinkLost
from tjscan.core.loopback import LoopbackProgram

TRUTH: Final = "truth"
"""What asks for the truth of a towing world, and begins the line with it."""


class VehicleLoopbackProcess(LoopbackProgram):
    """Process with loopback vehicles; a context manager that starts and ends it.

    Parameters
    ----------
    broker : str
        ``HOST:PORT`` of a broker on this machine.
    *options : str
        Further options of ``tjscan vehicle-loopback``.
    """

    ended, silent = VehicleLinkLost, VehicleFault
    start_limit = 600.0
    """Seconds: at its very first start, what finds a tow's first shape is compiled for a minute."""

    def __init__(self, broker: str, *options: str) -> None:
        super().__init__("vehicle-loopback", "--broker", broker, *options)

    def wait_until_at_rest(self, vehicle: int = 1, *, timeout: float = 10.0) -> float:
        """When a vehicle came to rest, in seconds of `time.monotonic`.

        Raises
        ------
        VehicleFault
            If it goes on moving.
        """
        return float(self.wait_for_line(f"at rest {vehicle} ", timeout=timeout).split()[-1])

    def ask_for_truth(self) -> dict[str, Any]:
        """What is true of a tow, and was since it began; see `TowingBodies.tell_truth`."""
        self.write_line(TRUTH)
        told: dict[str, Any] = json.loads(self.wait_for_line(f"{TRUTH} ").removeprefix(f"{TRUTH} "))
        return told
