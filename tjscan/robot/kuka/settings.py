"""The job table [arm.kuka]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from annotated_types import Ge, Le, MinLen

from tjscan.core.devices import is_loopback_host
from tjscan.core.units import MILLISECONDS, SECONDS
from tjscan.robot.settings import ControllerSettings

RSI_CYCLES: Final = (4e-3, 12e-3)
"""Seconds between two packets of a controller, IPO_FAST and IPO."""


@dataclass(frozen=True, slots=True)
class KukaSettings(ControllerSettings):
    """The table [arm.kuka]: where the controller is and where it sends its packets, and tolerances.

    Parameters
    ----------
    bind : str, optional
        This computer's address in the controller's RSI network, to which it sends; 127.0.0.1
        hears programs on this machine alone.
    port : int, optional
        The UDP port to which it sends.
    sen_type : str, optional
        What its RSI configuration calls this program (SENTYPE).
    cycle : float, optional
        Seconds between two packets, 4 or 12 ms.
    connect_limit : float, optional
        Seconds to wait for the first packet: a person starts the program on the pendant.
    """

    bind: Annotated[str, MinLen(1)] = "127.0.0.1"
    port: Annotated[int, Ge(1), Le(65535)] = 59152
    sen_type: Annotated[str, MinLen(1)] = "tjscan"
    cycle: Annotated[float, Ge(4), Le(12), MILLISECONDS] = RSI_CYCLES[0]
    connect_limit: Annotated[float, Ge(1), Le(600), SECONDS.with_key("connect_s")] = 60.0

    def __post_init__(self) -> None:
        if min(abs(self.cycle - cycle) for cycle in RSI_CYCLES) > 1e-9:
            raise ValueError("cycle_ms is 4 (IPO_FAST) or 12 (IPO)")
        if not self.sen_type.isalnum() or not self.sen_type.isascii():
            raise ValueError("sen_type has letters and digits alone")
        if is_loopback_host(self.bind) and not is_loopback_host(self.host):
            raise ValueError(
                f"bind is {self.bind}, where the controller at {self.host} can't send: write this "
                "computer's address in its RSI network"
            )
