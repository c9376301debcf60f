"""The job table [arm.kuka]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final

from annotated_types import Ge, Le, MinLen

from tjscan.core.units import MILLISECONDS
from tjscan.robot.cyclic.settings import CyclicSettings

if TYPE_CHECKING:
    from tjscan.robot.kuka.stream import CorrectionStream

RSI_CYCLES: Final = (4e-3, 12e-3)
"""Seconds between two packets of a controller, IPO_FAST and IPO."""


@dataclass(frozen=True, slots=True)
class KukaSettings(CyclicSettings):
    """The table [arm.kuka]: where the controller is and where it sends its packets, and tolerances.

    Parameters
    ----------
    sen_type : str, optional
        What its RSI configuration calls this program (SENTYPE).
    cycle : float, optional
        Seconds between two packets, 4 or 12 ms.
    """

    session = "RSI"
    frames_advice = "let its program set $TOOL to $NULLFRAME and $BASE to $ROBROOT"

    sen_type: Annotated[str, MinLen(1)] = "tjscan"
    cycle: Annotated[float, Ge(4), Le(12), MILLISECONDS] = RSI_CYCLES[0]

    def __post_init__(self) -> None:
        CyclicSettings.__post_init__(self)
        if min(abs(self.cycle - cycle) for cycle in RSI_CYCLES) > 1e-9:
            raise ValueError("cycle_ms is 4 (IPO_FAST) or 12 (IPO)")
        if not self.sen_type.isalnum() or not self.sen_type.isascii():
            raise ValueError("sen_type has letters and digits alone")

    def make_stream(self, address: str) -> CorrectionStream:
        """Stream to the controller at an IP address."""
        from tjscan.robot.kuka.stream import CorrectionStream

        return CorrectionStream(address, self.sen_type, self.cycle)
