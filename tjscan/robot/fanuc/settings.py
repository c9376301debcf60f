"""The job table [arm.fanuc]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le

from tjscan.core.units import MILLISECONDS
from tjscan.robot.cyclic.settings import CyclicSettings

if TYPE_CHECKING:
    from tjscan.robot.fanuc.stream import MotionStream


@dataclass(frozen=True, slots=True)
class FanucSettings(CyclicSettings):
    """The table [arm.fanuc]: where the controller is, how it is sent to, and tolerances.

    Parameters
    ----------
    port : int, optional
        The controller's UDP port, and this computer's: so no second program sends to it.
    cycle : float, optional
        Seconds between two packets, as the controller has it.
    smoothing : float, optional
        Seconds within which an acceleration builds up: the controller limits the jerk.
    """

    session = "stream motion"
    frames_advice = "set its user frame and its tool frame to zero"
    j3_count_varies = True

    port: Annotated[int, Ge(1), Le(65535)] = 60015
    cycle: Annotated[float, Ge(2), Le(32), MILLISECONDS] = 8e-3
    smoothing: Annotated[float, Ge(0), Le(1000), MILLISECONDS] = 0.16

    def make_stream(self, address: str) -> MotionStream:
        """Stream to the controller at an IP address."""
        from tjscan.robot.fanuc.stream import MotionStream

        return MotionStream(address, self.cycle, self.smoothing)
