"""``tjscan ur-loopback``."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter


def ur_loopback(
    *,
    model: str = "ur10e",
    host: str = "127.0.0.2",
    hz: float = 125.0,
    realtime: Annotated[bool, Parameter(negative="--fast")] = True,
    home_deg: tuple[float, float, float, float, float, float] = (-110, -95, 160, 105, -110, 0),
    calibration_seed: int | None = None,
    attached: bool = False,
) -> None:
    """Stand in for a Universal Robots controller on this machine, until interrupted.

    A line on stdin commands a fault: protective-stop, emergency-stop, power-off, local-mode,
    drop-link, freeze, refuse-targets, stop-program, miss-target or refuse-stop; clear sets all
    right again, home puts the arm where it started.
    With a number behind it, it comes half way through that move, counted from now.

    Parameters
    ----------
    model
        The arm, or the path of its URDF.
    host
        The address to listen on, 127.0.0.1 to 127.255.255.254.
    hz
        Ticks of the controller per second.
    realtime
        Whether moves take their time; with --fast they run 25 times as fast.
    home_deg
        Where the arm stands, six joint angles in degrees.
    calibration_seed
        Draws a calibration of the arm's own, some tenths of a millimetre, which the controller
        states and follows; without it the arm is as its model has it.
    attached
        End when stdin ends.
    """
    from tjscan.robot.loopback.serve import run_loopback_server

    run_loopback_server(
        model,
        host,
        hz,
        home_deg=home_deg,
        fast=not realtime,
        attached=attached,
        calibration_seed=calibration_seed,
    )
