"""The job table [arm.abb]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le

from tjscan.core.units import MILLISECONDS
from tjscan.robot.cyclic.settings import CyclicSettings

if TYPE_CHECKING:
    from tjscan.robot.abb.stream import GuidanceStream


@dataclass(frozen=True, slots=True)
class AbbSettings(CyclicSettings):
    """The table [arm.abb]: where the controller is and where it sends its messages, and tolerances.

    Parameters
    ----------
    port : int, optional
        The UDP port to which it sends.
    cycle : float, optional
        Seconds between two messages, 4 ms or a multiple (SampleRate).
    """

    session = "EGM"
    frames_advice = "let its program guide tool0 in wobj0, with the arm's base as its world frame"

    port: Annotated[int, Ge(1), Le(65535)] = 6510
    cycle: Annotated[float, Ge(4), Le(96), MILLISECONDS] = 4e-3

    def __post_init__(self) -> None:
        CyclicSettings.__post_init__(self)
        if abs(self.cycle / 4e-3 - round(self.cycle / 4e-3)) > 1e-6:
            raise ValueError("cycle_ms is 4 or a multiple of it")

    def make_stream(self, address: str) -> GuidanceStream:
        """Stream to the controller at an IP address."""
        from tjscan.robot.abb.stream import GuidanceStream

        return GuidanceStream(address, self.cycle)
