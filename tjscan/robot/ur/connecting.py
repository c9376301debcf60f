"""Connect to a controller, and set it up for poses of the flange."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import NoneType
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.devices import EventListener
from tjscan.core.errors import (
    ArmBusy,
    ArmFault,
    ArmNotConnected,
    ConfigurationError,
    ProgramStopped,
    RegistersInUse,
)
from tjscan.core.frames import Array, inverse_pose
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.ur.dashboard import DashboardClient
from tjscan.robot.ur.faults import connection_start_fault, fault_from_state
from tjscan.robot.ur.messages import ControllerState
from tjscan.robot.ur.session import (
    ClientLibraryError,
    ControllerSession,
    UrClientProcess,
    not_ready_fault,
)
from tjscan.robot.ur.settings import UrSettings

Pause = Callable[[], object]
"""Waits a moment, or until the arm is stopped."""

SETTING_LIMIT: Final = 2.0
"""Seconds within which a program starts or ends, and a value that was set is shown."""

READ_BACK_TOLERANCE: Final = 1e-6
"""Metres, radians or kilograms between a value that was set and the same read back."""

OTHER_ARM: Final = 0.005
"""Metres between the flange as the controller and as the model has it, beyond calibration.

Less than the clearance's default margins: what is planned on the model holds for the arm.
"""


def connect_to_controller(
    settings: UrSettings, kinematics: Kinematics, pause: Pause, note: EventListener
) -> ControllerSession:
    """Connect to the controller, set TCP and payload, and read them back; nothing moves.

    Parameters
    ----------
    settings : UrSettings
        Where it is, and how long to wait for it.
    kinematics : Kinematics
        Which arm it should be.
    pause : callable
        Waits a moment, or until the arm is stopped.
    note : callable
        Receives the events of the session.

    Raises
    ------
    ArmFault
        If the arm can't be reached or is not ready, each cause by its own error.
    ConfigurationError
        If it is another model than it should be.
    """
    dashboard = DashboardClient(settings.host)
    try:
        if (fault := not_ready_fault(dashboard)) is not None:
            raise fault
        _await_nobody(dashboard, pause)
        session = ControllerSession(dashboard, UrClientProcess(), settings.silence_limit, note)
    except BaseException:
        dashboard.close()
        raise
    try:
        _begin(session, settings, kinematics, pause)
    except BaseException as error:
        if session.fault is None and not isinstance(error, (RegistersInUse, ArmNotConnected)):
            session.stop_program(error)  # ours runs, or may
        session.disconnect()
        raise
    return session


def _begin(
    session: ControllerSession, settings: UrSettings, kinematics: Kinematics, pause: Pause
) -> None:
    host = settings.host
    try:
        session.link.call_client_method(NoneType, "connect", host, limit=settings.connect_limit)
        _await_program(session.link, pause)
        session.call_client_method(bool, "start_watchdog")
        _set_tcp(session)
        _set_payload(session, settings, pause)
        _check_model(session, kinematics)
    except ClientLibraryError as failed:
        raise not_ready_fault(session.dashboard) or connection_start_fault(
            host, str(failed)
        ) from None


def _await_nobody(dashboard: DashboardClient, pause: Pause) -> None:
    """See that no program runs: the client library would end it without asking."""
    limit = time.monotonic() + SETTING_LIMIT  # the dashboard is slow to report a program's end
    while dashboard.ask_value("running").lower() == "true":
        if time.monotonic() > limit:
            raise ArmBusy(
                "another program runs on the arm's controller. End it on the pendant, or end "
                "the program that sent it, then start again."
            )
        pause()


def _await_program(link: UrClientProcess, pause: Pause) -> None:
    """Let both links show the program that was started."""
    limit = time.monotonic() + SETTING_LIMIT
    while (
        fault := fault_from_state(
            link.call_client_method(ControllerState, "read_state", limit=SETTING_LIMIT)
        )
    ) is not None:
        if time.monotonic() > limit or not isinstance(fault, ProgramStopped):
            raise fault
        pause()


def _set_tcp(session: ControllerSession) -> None:
    """Put the TCP on the flange itself: poses mean the flange, whatever the pendant had set."""
    session.call_client_method(bool, "set_tcp", (0.0,) * 6)
    offset = session.call_client_method(list, "active_tcp_offset")
    if len(offset) != 6 or np.abs(offset).max() > READ_BACK_TOLERANCE:
        session.read_state()  # the true reason, if the arm is not well
        raise _disobeyed("TCP", "zero", offset)
    session.T_tcp_f = inverse_pose(pose_vector.pose_from_vector(offset))


def _set_payload(session: ControllerSession, settings: UrSettings, pause: Pause) -> None:
    if settings.payload is None:
        return
    session.call_client_method(bool, "set_payload", settings.payload, settings.payload_centre)
    wanted = np.array([settings.payload, *settings.payload_centre])
    limit = time.monotonic() + SETTING_LIMIT
    while not _carries(now := session.read_state(), wanted):
        if time.monotonic() > limit:
            raise _disobeyed("payload", f"{settings.payload:g} kg", now.payload)
        pause()


def _carries(now: ControllerState, wanted: Array) -> bool:
    """Whether the payload is the one asked for, or is not reported at all."""
    if now.payload is None or now.centre_of_gravity is None:
        return True
    return bool(
        np.abs(np.array([now.payload, *now.centre_of_gravity]) - wanted).max() < READ_BACK_TOLERANCE
    )


def _check_model(session: ControllerSession, kinematics: Kinematics) -> None:
    state = session.arm_state()
    apart = np.linalg.norm(kinematics.forward(state.q)[:3, 3] - state.T_b_f[:3, 3])
    if apart > OTHER_ARM:
        raise ConfigurationError(
            f"the controller has its flange {1e3 * apart:.0f} mm from where a "
            f"{kinematics.name} with these joint angles has it: name the "
            "right arm, or check the mounting in its installation",
            key="arm.model",
        )


def _disobeyed(what: str, wanted: str, found: object) -> ArmFault:
    return ArmFault(
        f"the controller was asked to set its {what} to {wanted} and reports {found}. See "
        "that no other program works with it, then start again."
    )
