"""A program of our own on a controller: sent, watched to its end, and stopped if need be.

It runs in place of the client library's control script. The client goes on watching the controller
and feeding its watchdog, so that a controller which no longer hears this computer ends the program.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import NoneType
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.errors import ArmFault, ArmNotConnected, PoseNotReached, ProgramStopped
from tjscan.core.frames import Array
from tjscan.robot.ur.messages import PROGRAM_PLAYING, WATCHDOG_PERIOD
from tjscan.robot.ur.moving import START_LIMIT
from tjscan.robot.ur.session import ControllerSession

PROGRAM_PORT: Final = 30002
"""Of the secondary interface, which takes programs."""

LOOK_PERIOD: Final = 0.05
"""Seconds between two looks at a program."""

WATCHDOG_STATEMENT: Final = (
    f'  rtde_set_watchdog("input_int_register_0", {1 / WATCHDOG_PERIOD:g}, "stop")'
)
"""First statement of a program: to end when nothing is heard of this computer any more."""


@dataclass(frozen=True, slots=True, eq=False)
class UrProgram:
    """A program in URScript, and the pose that it leads to.

    Parameters
    ----------
    script : str
        ``def NAME(): ... end``.
    T_b_tcp : ndarray, shape (4, 4)
        Where it leaves the TCP that it sets, in frame b.
    leave : str
        Another program, that is run if this one does not come to its end: to switch off what it
        has switched on.
    """

    script: str
    T_b_tcp: Array
    leave: str


def run_program(
    session: ControllerSession, program: UrProgram, started: Callable[[], object]
) -> None:
    """Run a program and watch it to its end.

    Parameters
    ----------
    session : ControllerSession
        The session; its control script ends.
    program : UrProgram
        The program.
    started : callable
        Is called once it runs.

    Raises
    ------
    ArmFault
        If the arm was stopped, or something is wrong with it.
    ProgramStopped
        If the controller does not begin it.
    PoseNotReached
        If it did not lead where it should: it was stopped on its way.
    """
    session.keep_dashboard()
    session.read_state()
    try:
        with session.latch.begin_move():
            session.call_client_method(NoneType, "stop_control_script")
            _await_program(session, runs=False)
            head, _, rest = program.script.partition("\n")
            _send_script(session, "\n".join((head, WATCHDOG_STATEMENT, rest)))
        _await_program(session, runs=True)
        session.call_client_method(NoneType, "feed_foreign_watchdog")
        started()
        while session.read_state(beside_program=True).runtime_state == PROGRAM_PLAYING:
            if session.latch.wait_for_stop(LOOK_PERIOD):
                raise ArmFault("the program was stopped on its way. See that the way is clear.")
            session.keep_dashboard_connected()
        _check_end(session, program.T_b_tcp)
    except BaseException as error:
        session.stop_program(error)
        try:
            _send_script(session, program.leave)
        except ArmFault as unsent:
            error.add_note(f"What is more, its outputs could not be reset: {unsent}")
        raise


def _send_script(session: ControllerSession, script: str) -> None:
    host = session.settings.host
    try:
        with socket.create_connection((host, PROGRAM_PORT), START_LIMIT) as link:
            link.sendall(f"{script.rstrip()}\n".encode())
            # Some controllers drop what they have not read when the link closes.
            time.sleep(4 * LOOK_PERIOD)
    except OSError as error:
        raise ArmNotConnected(
            f"the controller at {host} takes no programs (port {PROGRAM_PORT}: "
            f"{error.strerror or error}). See that the interface is enabled in its security "
            "settings."
        ) from None


def _await_program(session: ControllerSession, *, runs: bool) -> None:
    """Wait until a program runs, or none does."""
    limit = time.monotonic() + START_LIMIT
    while (session.read_state(beside_program=True).runtime_state == PROGRAM_PLAYING) != runs:
        if time.monotonic() > limit:
            verb = "begin the program" if runs else "end the program before"
            raise ProgramStopped(f"the controller does not {verb}. Read its log.")
        session.latch.wait_for_stop(LOOK_PERIOD)


def _check_end(session: ControllerSession, T_b_tcp: Array) -> None:
    there = pose_vector.pose_from_vector(np.array(session.read_state(beside_program=True).tcp))
    distance, angle, near = session.settings.miss(there, T_b_tcp)
    if not near:
        raise PoseNotReached(
            f"the program ended {1e3 * distance:.1f} mm and {np.degrees(angle):.1f} deg from where "
            "it leads: it was stopped on its way, by a person or by the controller, whose log then "
            "states why.",
            T_b_tcp,
            there,
        )
