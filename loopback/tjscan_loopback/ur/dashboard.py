"""The dashboard server: a line asked, a line answered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tjscan_loopback.ur.controller import LoopbackController
from tjscan_loopback.ur.states import ProgramState, RobotPower

DASHBOARD_GREETING: Final = "Connected: Universal Robots Dashboard Server"
SERIAL_NUMBER: Final = "00000000000"
"""No real arm has this serial number."""


class DashboardServer:
    """Answers the lines of a client as the controller's dashboard server does.

    Parameters
    ----------
    controller : LoopbackController
        Of whom it speaks.
    model : str
        Name of the arm, for instance ``ur10e``.
    version : tuple of int
        Of the controller.
    """

    def __init__(
        self, controller: LoopbackController, model: str, version: tuple[int, int, int, int]
    ) -> None:
        self._controller = controller
        major, minor, bugfix, build = version
        software = f"URSoftware {major}.{minor}.{bugfix}.{build} (Jan 01 2024)"
        self._answers: dict[str, Callable[[], str]] = {
            "robotmode": lambda: f"Robotmode: {controller.mode.name}",
            "safetymode": lambda: f"Safetymode: {controller.safety.name}",
            "safetystatus": lambda: f"Safetystatus: {controller.safety.name}",
            "polyscopeversion": lambda: software,
            "get serial number": lambda: SERIAL_NUMBER,
            "get robot model": lambda: model.upper().removesuffix("E"),
            "is in remote control": lambda: str(controller.remote).lower(),
            "running": lambda: (
                f"Program running: {str(controller.runtime is ProgramState.PLAYING).lower()}"
            ),
            "programstate": lambda: f"{controller.runtime.name} loopback",
            "stop": self._stop,
            "pause": self._pause,
            "play": self._play,
            "power on": lambda: self._power(RobotPower.IDLE, "Powering on"),
            "brake release": lambda: self._power(RobotPower.RUNNING, "Brake releasing"),
            "power off": lambda: self._power(RobotPower.POWER_OFF, "Powering off"),
            "unlock protective stop": self._unlock,
            "close popup": lambda: "closing popup",
            "close safety popup": lambda: "closing safety popup",
            "quit": lambda: "Disconnected",
        }

    def answer_line(self, line: str) -> str:
        """Answer one line of the dashboard protocol."""
        words = line.strip()
        if words.lower().startswith(("popup", "addtolog")):
            return "showing popup" if words.lower().startswith("popup") else "Added log message"
        known = self._answers.get(words.lower())
        return f"could not understand: '{words}'" if known is None else known()

    def _stop(self) -> str:
        if self._controller.deaf:
            return "Failed to execute: stop"
        self._controller.stop_program()
        return "Stopped"

    def _pause(self) -> str:
        self._controller.pause_program()
        return "Pausing program"

    def _play(self) -> str:
        resumed = self._controller.resume_program()
        return "Starting program" if resumed else "Failed to execute: play"

    def _power(self, mode: RobotPower, answer: str) -> str:
        self._controller.set_power(mode)
        return answer

    def _unlock(self) -> str:
        if self._controller.unlock_protective_stop():
            return "Protective stop releasing"
        return "Cannot unlock protective stop until 5s after occurrence"
