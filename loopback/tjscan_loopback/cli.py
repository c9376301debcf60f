"""The commands of ``tjscan`` that this package adds, see ``[project.entry-points]``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tjscan_loopback.cyclic.options import AbbOptions, FanucOptions, KukaOptions

if TYPE_CHECKING:
    from tjscan_loopback.vehicle.towing import TowingBodies


def ur_loopback(
    *,
    model: str = "ur10e",
    host: str = "127.0.0.2",
    hz: float = 125.0,
    realtime: Annotated[bool, Parameter(negative="--fast")] = True,
    home_deg: tuple[float, float, float, float, float, float] = (-110, -95, 160, 105, -110, 0),
    calibration_seed: int | None = None,
    clock: tuple[float, float] = (0.0, 0.0),
    attached: bool = False,
) -> None:
    """Simulate a Universal Robots controller on this machine, until interrupted.

    A line on stdin commands a fault: protective-stop, emergency-stop, power-off, local-mode,
    drop-link, freeze, refuse-targets, stop-program, miss-target or refuse-stop; clear sets all
    right again, home puts the arm where it started. Of the packets of a path that is followed:
    lose-packets, late-packets, double-packets, reorder-packets, freeze-registers; of the speed
    slider: slider-zero, slider-half, slider-full.
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
        Where the arm starts, six joint angles in degrees.
    calibration_seed
        Draws a calibration of the arm's own, some tenths of a millimetre, which the controller
        states and follows; without it the arm is as its model has it.
    clock
        What its clock shows at first, in seconds, and by how many millionths it runs fast.
    attached
        End when stdin ends.
    """
    from tjscan_loopback.ur.serve import run_loopback_server

    run_loopback_server(
        model,
        host,
        hz,
        home_deg=home_deg,
        fast=not realtime,
        attached=attached,
        calibration_seed=calibration_seed,
        clock=clock,
    )


def kuka_loopback(options: KukaOptions | None = None) -> None:
    """Simulate a KUKA controller with RSI on this machine, until interrupted.

    Its program starts once the computer listens. A line on stdin commands a fault: of answers
    lose-answer, lose-answers, late-answer or unanswered; of packets lose-packet, lose-packets,
    double-packet, old-packet, foreign-packet, wrong-type, malformed, wrong-ipoc or frozen-ipoc;
    stand, stop-program or stop. clear sets all right again and starts the program, home puts the
    arm where it started, too. With a number behind it, it comes after so many cycles of motion.
    """
    from tjscan_loopback.kuka.serve import run_loopback_controller

    run_loopback_controller(options or KukaOptions())


def abb_loopback(options: AbbOptions | None = None) -> None:
    """Simulate an ABB controller with EGM on this machine, until interrupted.

    Its program starts once the computer listens. A line on stdin commands a fault: of answers
    lose-answer, lose-answers, late-answer or unanswered; of messages lose-packet, lose-packets,
    double-packet, old-packet, foreign-packet, wrong-type, malformed, wrong-seqno or frozen-seqno;
    stand (its motors go off), stop-program or stop. clear sets all right again and starts the
    program, home puts the arm where it started, too. With a number behind it, it comes after so
    many cycles of motion.
    """
    from tjscan_loopback.abb.serve import run_loopback_controller

    run_loopback_controller(options or AbbOptions())


def fanuc_loopback(options: FanucOptions | None = None) -> None:
    """Simulate a FANUC controller with Stream Motion on this machine, until interrupted.

    It listens on UDP port 60015. A line on stdin commands a fault: of commands lose-answer,
    lose-answers, late-answer or unanswered; of status packets lose-packet, lose-packets,
    double-packet, old-packet, foreign-packet, wrong-type, malformed, wrong-number or
    frozen-number; stand (an emergency stop), stop-program or stop. clear sets all right again and
    starts the program, home puts the arm where it started, too. With a number behind it, it comes
    after so many cycles of motion.
    """
    from tjscan_loopback.fanuc.serve import run_loopback_controller

    run_loopback_controller(options or FanucOptions())


def laser_loopback(
    job: Path | None = None,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    recording: Path | None = None,
    host: str = "127.0.0.4",
    arm: str | None = None,
    serial: str = "1",
    clock: tuple[float, float] = (0.0, 0.0),
    attached: bool = False,
) -> None:
    """Simulate a GigE Vision line laser on this machine, until interrupted.

    It sends the profiles of a job's simulated laser, or of a recording, one after another.
    Every key of the job file is an option too. A line on stdin commands a fault: loss PER_CENT,
    duplicate, reorder, lose-leader, lose-trailer, late, stale, buffered, silent, taken, reboot,
    wrong-format, unit-pixel, missing-features, all-invalid, no-clock, coarse-clock, wrong-clock,
    no-stamp, narrow, new-offset, new-exposure or no-trigger; clear sets all right again.

    Parameters
    ----------
    job
        The job file (TOML) whose simulated laser it is.
    recording
        Profiles instead of a job: a run directory, a file of one, or text with columns x_mm
        and z_mm.
    host
        Its address, 127.0.0.1 to 127.255.255.254; each laser has one of its own.
    arm
        Address of the arm's controller that carries it, such as ur-loopback. Left out, it
        stays at the job's first start pose.
    serial
        Its serial number.
    clock
        By how many seconds its clock is ahead of this machine's, and by how many millionths it
        runs fast.
    attached
        End when stdin ends.
    """
    from tjscan.cli.options.shared import parse_overrides
    from tjscan_loopback.profiles import run_loopback_laser

    run_loopback_laser(
        job,
        parse_overrides(overrides),
        recording=recording,
        host=host,
        arm=arm,
        serial=serial,
        clock=clock,
        attached=attached,
    )


def vehicle_loopback(
    *,
    vehicles: int | None = None,
    broker: str = "127.0.0.1:1883",
    prefix: str = "tjscan/vehicle",
    settings: Path | None = None,
    seed: int = 0,
    attached: bool = False,
) -> None:
    """Simulate vehicles on this machine, behind an MQTT broker on it, until interrupted.

    With the job of a tow they hold its cable and are seen by a tracker; else they are crawlers. A
    line on stdin commands a fault: drive-fault, drop-link, freeze, stale or nan; of crawlers slip,
    edge or arc; at a cable stop, push, passer-stands, or what goes wrong with poses, such as
    pose-lost. clear sets all right again. With a number behind it, it is for that vehicle alone.

    Parameters
    ----------
    vehicles
        How many; their topics begin with the prefix and their number, 1, 2, ... One crawler, or as
        many as the tow has, if left out.
    broker
        HOST:PORT of a broker on this machine, such as mosquitto.
    prefix
        Of all topics.
    settings
        A job file whose [simulation.vehicle] and [vehicle.tracks] the crawlers have, or that of a
        tow.
    seed
        Of their random numbers.
    attached
        End when stdin ends.
    """
    from tjscan_loopback.vehicle.serve import run_loopback_vehicles

    towing = None if settings is None else _read_tow(settings, seed)
    if vehicles is None:
        vehicles = 1 if towing is None else len(towing.bodies)
    run_loopback_vehicles(
        vehicles, broker, prefix, settings=settings, seed=seed, attached=attached, towing=towing
    )


def power_loopback(
    job: Path,
    *,
    host: str | None = None,
    port: int | None = None,
    watchdog_ms: float = 100.0,
    attached: bool = False,
) -> None:
    """Simulate a power source behind Modbus TCP on this machine, until interrupted.

    Its registers are those of the job's [power.modbus], its arc that of [power.simulated]. A line
    on stdin commands a fault: no-ignition, arc-lost, wire-stuck, no-gas, error, link-dead or
    register-frozen; clear sets all right again.

    Parameters
    ----------
    job
        The job file (TOML).
    host
        The address to listen on, 127.0.0.1 to 127.255.255.254; the job's if left out.
    port
        The job's if left out.
    watchdog_ms
        Milliseconds without a program after which it puts the arc out.
    attached
        End when stdin ends.
    """
    from tjscan_loopback.power.serve import run_loopback_power_source

    run_loopback_power_source(job, host, port, watchdog=1e-3 * watchdog_ms, attached=attached)


def _read_tow(file: Path, seed: int) -> TowingBodies | None:
    """The vehicles of a tow; None if the file is another job."""
    from tjscan.core.config import read_toml

    if "seam" not in read_toml(file):
        return None
    from tjscan.core.config import add_file_to_errors
    from tjscan.job.tow.cell import check_seam, make_shape_planner
    from tjscan.job.tow.job import read_tow_job
    from tjscan.job.tow.simulation import towing_world_of_job
    from tjscan.vehicle.cable.world import TowingWorld
    from tjscan_loopback.vehicle.towing import TowingBodies

    job = read_tow_job(file)
    with add_file_to_errors(file):
        sweep = check_seam(job, make_shape_planner(job))
        sweep.refuse_if_blocked()
    world = TowingWorld(towing_world_of_job(job), sweep.start.angles, seed=seed)
    return TowingBodies(world, job.simulation.localisation, seed)
