"""The job table [arm.ur]."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from tjscan.core.frames import Array, rotation_angle_between
from tjscan.core.units import DEG, KG, MM, SECONDS, Position, SettingsTable


@dataclass(frozen=True, slots=True)
class UrSettings(SettingsTable):
    """The table [arm.ur]: the controller's address, the payload, and tolerances.

    Parameters
    ----------
    host : str
        The controller's address.
    payload : float, optional
        What the arm carries, in kilograms; what its pendant has set if left out.
    payload_centre : tuple of float, optional
        Centre of gravity of the payload, in frame f, metres.
    position_tolerance, rotation_tolerance : float, optional
        Between the pose asked for and the one reached, metres and radians.
    connect_limit : float, optional
        Seconds a connection may take.
    silence_limit : float, optional
        Seconds for which the controller's clock may not advance.
    """

    host: Annotated[str, MinLen(1)]
    payload: Annotated[float | None, Ge(0), Le(50), KG] = None
    payload_centre: Position = (0.0, 0.0, 0.0)
    position_tolerance: Annotated[float, Gt(0), Le(10), MM] = 5e-4
    rotation_tolerance: Annotated[float, Gt(0), Le(5), DEG] = radians(0.1)
    connect_limit: Annotated[float, Ge(1), Le(120), SECONDS.with_key("connect_s")] = 15.0
    silence_limit: Annotated[float, Ge(0.1), Le(60), SECONDS.with_key("silence_s")] = 1.0

    def __post_init__(self) -> None:
        if self.payload is None and any(self.payload_centre):
            raise ValueError("payload_centre_mm needs payload_kg beside it")

    def compare_with_wanted_pose(self, T: Array, T_wanted: Array) -> tuple[float, float, bool]:
        """Distance, metres, and angle, radians, between two poses; whether both are tolerated."""
        distance = float(np.linalg.norm(T[:3, 3] - T_wanted[:3, 3]))
        angle = rotation_angle_between(T, T_wanted)
        near = distance <= self.position_tolerance and angle <= self.rotation_tolerance
        return distance, angle, near
