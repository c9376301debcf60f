"""The controller's dashboard: a line asked, a line answered, within a time limit.

Spoken directly, for it has to work when the client library hangs.
"""

from __future__ import annotations

import select
import socket
from dataclasses import dataclass
from typing import Final

from tjscan.core.devices import DeviceIdentity
from tjscan.core.errors import ArmFault, ArmNotConnected, ArmNotResponding

DASHBOARD_PORT: Final = 29999

DASHBOARD_ANSWER_LIMIT: Final = 2.0
"""Seconds to wait for an answer."""

LONGEST_DASHBOARD_ANSWER: Final = 4096
"""Bytes of a line."""


class DashboardClient:
    """Client of the controller's dashboard server; a context manager.

    Parameters
    ----------
    host : str
        The controller's address.

    Raises
    ------
    ArmNotConnected
        If there is no controller at that address.
    ArmNotResponding
        If it does not answer.
    """

    def __init__(self, host: str) -> None:
        self._host = host
        self._connect(DASHBOARD_ANSWER_LIMIT)

    def _connect(self, limit: float) -> None:
        self._silence: ArmNotResponding | None = None
        try:
            self._socket = socket.create_connection((self._host, DASHBOARD_PORT), limit)
        except OSError as error:
            raise ArmNotConnected(
                f"no controller answers at {self._host} (port {DASHBOARD_PORT}: "
                f"{error.strerror or error}). See that the arm is on, that [arm.ur] host is the "
                "address its pendant shows, and that this machine is in the same network."
            ) from None
        self._lines = self._socket.makefile("rb")
        try:
            self._read_line()
        except ArmNotResponding:
            self.close()
            raise
        self._socket.settimeout(DASHBOARD_ANSWER_LIMIT)

    @property
    def has_hung_up(self) -> bool:
        """Whether the controller has closed the connection; asks it nothing, and does not wait."""
        try:
            readable, _, _ = select.select([self._socket], [], [], 0)
            return bool(readable) and self._socket.recv(1, socket.MSG_PEEK) == b""
        except OSError:
            return True

    def connect_again(self, limit: float) -> None:
        """Connect again; raises as the constructor does.

        Parameters
        ----------
        limit : float
            Seconds to wait for it, and as long for its greeting.
        """
        self.close()
        self._connect(limit)

    def ask_dashboard(self, line: str) -> str:
        """Send a line to the dashboard and return its answer.

        Raises
        ------
        ArmNotResponding
            If there is none, or there was none before: no call waits twice.
        """
        if self._silence is not None:
            raise self._silence
        try:
            self._socket.sendall(f"{line}\n".encode())
        except OSError as error:
            raise self._no_answer_error(str(error)) from None
        return self._read_line()

    def ask_dashboard_value(self, line: str) -> str:
        """Send a line to the dashboard and return the value behind the colon of its answer."""
        return self.ask_dashboard(line).rpartition(": ")[2].strip()

    def stop_program(self) -> None:
        """Stop the program that runs on the controller, and all motion with it.

        Raises
        ------
        ArmFault
            If the controller does not confirm that, and a program runs on.
        ArmNotResponding
            As `ask_dashboard` does.
        """
        answer = self.ask_dashboard("stop")
        # Whether a controller on which nothing runs confirms is not known: that it runs counts.
        confirmed = answer.lower().startswith("stopped")
        if not confirmed and self.ask_dashboard_value("running").lower() != "false":
            message = f"the controller did not end the program when it was asked to ({answer!r})."
            raise ArmFault(message)

    def close(self) -> None:
        """Close the connection."""
        self._lines.close()
        self._socket.close()

    def _read_line(self) -> str:
        try:
            line = self._lines.readline(LONGEST_DASHBOARD_ANSWER)
        except OSError as error:
            raise self._no_answer_error(str(error)) from None
        if not line:
            raise self._no_answer_error("it hung up")
        return line.decode(errors="replace").strip()

    def _no_answer_error(self, why: str) -> ArmNotResponding:
        self._silence = ArmNotResponding(
            f"the dashboard of the controller at {self._host} does not answer ({why}). Look at "
            "its pendant, restart the controller if it hangs, then start again."
        )
        return self._silence


@dataclass(frozen=True, slots=True)
class UrIdentity(DeviceIdentity):
    """Identity of a Universal Robots arm: model, serial number, software and payload.

    Parameters
    ----------
    model, serial, software : str
        Model, serial number and version of the controller's software; empty if not reported.
    payload : float or None
        The active payload in kilograms.
    kinematics : str
        Where the controller's own calibration and the model of the arm disagree; empty if the
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
    """Read the arm's identity from the dashboard; raises as its `ask_dashboard` does."""
    questions = ("get robot model", "get serial number", "PolyscopeVersion")
    model, serial, software = (_answer_if_understood(dashboard.ask_dashboard(q)) for q in questions)
    return UrIdentity(model, serial, software, payload, kinematics)


def _answer_if_understood(answer: str) -> str:
    """An answer, or nothing if the dashboard does not know the question."""
    return "" if "understand" in answer.lower() or "not supported" in answer.lower() else answer
