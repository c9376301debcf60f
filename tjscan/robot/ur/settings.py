"""The job table [arm.ur]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from tjscan.core.units import KG, Position
from tjscan.robot.settings import ControllerSettings


@dataclass(frozen=True, slots=True)
class UrSettings(ControllerSettings):
    """The table [arm.ur]: the controller's address, the payload, and tolerances.

    Parameters
    ----------
    payload : float, optional
        What the arm carries, in kilograms; what its pendant has set if left out.
    payload_centre : tuple of float, optional
        Centre of gravity of the payload, in frame f, metres.
    """

    payload: Annotated[float | None, Ge(0), Le(50), KG] = None
    payload_centre: Position = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.payload is None and any(self.payload_centre):
            raise ValueError("payload_centre_mm needs payload_kg beside it")
