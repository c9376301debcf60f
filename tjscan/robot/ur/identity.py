"""Which arm stands there, in the controller's words."""

from __future__ import annotations

from dataclasses import dataclass

from tjscan.core.devices import DeviceIdentity
from tjscan.robot.ur.dashboard import DashboardClient


@dataclass(frozen=True, slots=True)
class UrIdentity(DeviceIdentity):
    """Identity of a Universal Robots arm: model, serial number, software and payload.

    Parameters
    ----------
    model, serial, software : str
        Model, serial number and version of the controller's software; empty where not reported.
    payload : float or None
        The active payload in kilograms.
    kinematics : str
        Where the controller's own calibration and the model of the arm disagree; empty where the
        controller states none.
    """

    payload: float | None = None
    kinematics: str = ""

    def __str__(self) -> str:
        named = DeviceIdentity.__str__(self)
        return f"{named}; {self.kinematics}" if self.kinematics else named


def read_ur_identity(
    dashboard: DashboardClient, payload: float | None, kinematics: str = ""
) -> UrIdentity:
    """Read the arm's identity from the dashboard; raises as `DashboardClient.ask` does."""
    return UrIdentity(
        model=_told(dashboard.ask("get robot model")),
        serial=_told(dashboard.ask("get serial number")),
        software=_told(dashboard.ask("PolyscopeVersion")),
        payload=payload,
        kinematics=kinematics,
    )


def _told(answer: str) -> str:
    """An answer, or nothing where the dashboard does not know the question."""
    return "" if "understand" in answer.lower() or "not supported" in answer.lower() else answer
