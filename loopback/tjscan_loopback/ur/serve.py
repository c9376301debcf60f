"""Run a loopback controller as this process."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.core.signals import survive_background_terminal_read
from tjscan.robot.kinematics import Kinematics
from tjscan_loopback.process import check_is_loopback_address, print_line, start_posture
from tjscan_loopback.ur.controller import LoopbackController
from tjscan_loopback.ur.primary import draw_calibration, nominal_dh_parameters, with_dh_parameters
from tjscan_loopback.ur.server import LoopbackServer


def run_loopback_server(
    model: str,
    host: str,
    hz: float,
    *,
    home_deg: Sequence[float],
    fast: bool,
    attached: bool,
    calibration_seed: int | None = None,
    clock: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Run the loopback controller's server until interrupted, or until an attached stdin ends.

    It prints its events to stdout, a line each.

    Raises
    ------
    ConfigurationError
        If the arm, the address, the frequency or the joint angles can't be.
    """
    check_is_loopback_address(host)
    if not 1 <= hz <= 1000:
        raise ConfigurationError(f"it ticks 1 to 1000 times a second (found {hz:g})", key="hz")
    with add_file_to_errors(key="model"):
        kinematics = Kinematics.load(model)
    dh = nominal = nominal_dh_parameters(model)
    if nominal is not None and calibration_seed is not None:
        dh = draw_calibration(nominal, calibration_seed)
        kinematics = with_dh_parameters(kinematics, nominal, dh)
    q = start_posture(kinematics, home_deg)
    survive_background_terminal_read()
    controller = LoopbackController(
        kinematics,
        q,
        hz=hz,
        fast=fast,
        report_line=print_line,
        clock=clock[0],
    )
    server = LoopbackServer(controller, model, host, hz, print_line, dh, 1 + 1e-6 * clock[1])
    asyncio.run(server.run(attached=attached))
