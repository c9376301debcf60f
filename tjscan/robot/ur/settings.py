"""How to reach and to judge a Universal Robots arm."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class UrSettings:
    """How to reach and to judge an arm.

    Parameters
    ----------
    host : str
        The controller's address.
    payload : float, optional
        What the arm carries, in kilograms; what its pendant says where left out.
    centre_of_gravity : tuple of float, optional
        Of the payload, in frame f, metres.
    position_tolerance, rotation_tolerance : float, optional
        Metres and radians between the pose asked for and the one reached.
    connect_limit : float, optional
        Seconds a connection may take.
    silence_limit : float, optional
        Seconds for which the controller's clock may stand.
    """

    host: str
    payload: float | None = None
    centre_of_gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    position_tolerance: float = 5e-4
    rotation_tolerance: float = 2e-3
    connect_limit: float = 15.0
    silence_limit: float = 1.0
