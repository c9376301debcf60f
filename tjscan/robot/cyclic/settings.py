"""What the tables of arms have in common whose controllers ask for joint angles in every cycle."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from annotated_types import Ge, Le, MinLen

from tjscan.core.devices import is_loopback_host
from tjscan.core.units import MILLISECONDS, SECONDS
from tjscan.robot.settings import ControllerSettings

if TYPE_CHECKING:
    from tjscan.robot.cyclic.stream import CyclicStream


@dataclass(frozen=True, slots=True)
class CyclicSettings(ControllerSettings):
    """Where a controller is, where it sends its packets, and how often.

    Parameters
    ----------
    bind : str, optional
        This computer's address in the controller's network, to which it sends; 127.0.0.1
        hears programs on this machine alone.
    port : int, optional
        The UDP port to which it sends.
    cycle : float, optional
        Seconds between two packets.
    connect_limit : float, optional
        Seconds to wait for the first packet: a person starts the program on the pendant.
    """

    session: ClassVar[str]
    """What its controller runs, as errors call it."""

    frames_advice: ClassVar[str]
    """How its program makes the controller report the flange in the arm's base."""

    j3_count_varies: ClassVar[bool] = False
    """Whether some of its controllers count J3 from the horizontal, not from the upper arm."""

    bind: Annotated[str, MinLen(1)] = "127.0.0.1"
    port: Annotated[int, Ge(1), Le(65535)] = 59152
    cycle: Annotated[float, Ge(1), Le(100), MILLISECONDS] = 4e-3
    connect_limit: Annotated[float, Ge(1), Le(600), SECONDS.with_key("connect_s")] = 60.0

    def __post_init__(self) -> None:
        if is_loopback_host(self.bind) and not is_loopback_host(self.host):
            raise ValueError(
                f"bind is {self.bind}, where the controller at {self.host} can't send: write this "
                "computer's address in its network"
            )

    @property
    def local_address(self) -> tuple[str, int]:
        """Address and port on which this computer listens."""
        return self.bind, self.port

    @property
    def listening(self) -> str:
        """Where this computer listens, as errors state it."""
        return f"on port {self.port} of {self.bind}"

    @abstractmethod
    def make_stream(self, address: str) -> CyclicStream[Any]:
        """Stream to the controller at an IP address."""
