"""Messages between a program and the torch on a vehicle, beside the vehicle's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from annotated_types import Ge, Le, Len

from tjscan.vehicle.mqtt.wire import WireMessage

TORCH_TOPIC: Final = "torch"
TORCH_COMMANDER_TOPIC: Final = "torch-commander"
TORCH_STATE_TOPIC: Final = "torch-state"

Place = Annotated[float, Ge(-10), Le(10)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TorchMessage(WireMessage):
    """On ``torch``: where the torch has to be, and whether its arc burns.

    Parameters
    ----------
    y, z : float
        To the right of the vehicle's middle, and out of the hull, metres.
    arc : bool
        Whether the arc burns.
    hold : float
        Seconds from its sending after which the arc has to go out without a further message.
    """

    y: Place
    z: Place
    arc: bool
    hold: Annotated[float, Ge(0), Le(10)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TorchStateMessage(WireMessage):
    """On ``torch-state``: where the torch is, some 100 times a second.

    Parameters
    ----------
    y, z : float
        To the right of the vehicle's middle, and out of the hull, metres.
    arc : bool
        Whether the arc burns.
    fault : str
        Of its axes or its power source; empty where they are well.
    """

    y: Place
    z: Place
    arc: bool
    fault: Annotated[str, Len(0, 500)] = ""
