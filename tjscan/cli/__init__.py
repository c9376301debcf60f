"""The command line: one file per command, nothing heavy before a command needs it."""

from __future__ import annotations

import errno
import logging
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError

from tjscan.core.errors import (
    ArmFault,
    ConfigurationError,
    LaserFault,
    ScanInterrupted,
    TjscanError,
    VehicleFault,
    message_with_notes,
)
from tjscan.core.version import VERSION

app = App(
    name="tjscan",
    help="Scan the weld groove of large tubular T-joints with a robot arm and a line laser.",
    version=VERSION,
    suppress_keyboard_interrupt=False,
)
app.command("tjscan.cli.scan:scan", name="scan", help="Scan a groove as a job file says.")
app.command(
    "tjscan.cli.calibrate:calibrate",
    name="calibrate",
    help="Find the pose of the sensor on the flange.",
)
app.command(
    "tjscan.cli.teach:teach", name="teach", help="Write where the arm stands as a start pose."
)
app.command(
    "tjscan.cli.doctor:doctor", name="doctor", help="Check a job's cell and report what is wrong."
)
app.command(
    "tjscan.cli.laser:laser", name="laser", help="Show what a line laser sees, live, and write it."
)
app.command(
    "tjscan.cli.reprocess:reprocess",
    name="reprocess",
    help="Read a run's recorded profiles again, with other settings.",
)
app.command("tjscan.cli.groove:groove", name="groove", help="Read the groove in recorded profiles.")
app.command(
    "tjscan.cli.stitch:stitch",
    name="stitch",
    help="Stitch scans from several stations into one groove.",
)
app.command(
    "tjscan.cli.chain:chain",
    name="chain",
    help="Calibrate, scan, stitch and compare in simulation; where the error comes from.",
)
app.command(
    "tjscan.cli.compare:compare",
    name="compare",
    help="Compare a run or a cloud with a mesh, a cloud or a joint.",
)
app.command(
    "tjscan.cli.export:export", name="export", help="Write a run's sections for another tool."
)
app.command(
    "tjscan.cli.plan:plan", name="plan", help="Plan the beads of a measured groove after a WPS."
)
app.command("tjscan.cli.report:report", name="report", help="Write a run's report again.")
app.command("tjscan.cli.joint:joint", name="joint", help="Build a joint's mesh and feature edges.")
app.command(
    "tjscan.cli.ur_loopback:ur_loopback",
    name="ur-loopback",
    help="Simulate a Universal Robots controller on this machine.",
)
app.command(
    "tjscan.cli.laser_loopback:laser_loopback",
    name="laser-loopback",
    help="Simulate a GigE Vision line laser on this machine.",
)
app.command(
    "tjscan.cli.vehicle_loopback:vehicle_loopback",
    name="vehicle-loopback",
    help="Simulate vehicles behind an MQTT broker on this machine.",
)
app.command(
    "tjscan.cli.study:study",
    name="study",
    help="Run many simulated scans or crawls and write their results into one table.",
)
crawl = App(name="crawl", help="Follow a hull's joint with a magnetic crawler, and weld it.")
crawl.command("tjscan.cli.crawl_run:crawl_run", name="run", help="Crawl and weld as a job says.")
crawl.command(
    "tjscan.cli.crawl_size:crawl_size",
    name="size",
    help="Check whether magnets, motors and tracks carry the crawler.",
)
crawl.command(
    "tjscan.cli.crawl_calibrate:crawl_calibrate",
    name="calibrate",
    help="Learn how the crawler slips on this hull.",
)
crawl.command(
    "tjscan.cli.crawl_compare:crawl_compare",
    name="compare",
    help="Compare two crawls, pass by pass.",
)
crawl.command(
    "tjscan.cli.crawl_replay:crawl_replay",
    name="replay",
    help="Feed a recorded crawl through another estimator.",
)
app.command(crawl)
tow = App(name="tow", help="Tow a welding cable with several vehicles, in an optimised shape.")
tow.command("tjscan.cli.tow_run:tow_run", name="run", help="Tow along a seam as a job says.")
tow.command("tjscan.cli.tow_replay:tow_replay", name="replay", help="Plan a recorded tow anew.")
app.command(tow)
app.register_install_completion_command()

EXIT_CODES: dict[type[TjscanError], int] = {
    ConfigurationError: 2,
    ArmFault: 4,
    LaserFault: 4,
    VehicleFault: 4,
    ScanInterrupted: 130,
}
"""What each branch of the error tree ends with; 1 for the rest."""


def exit_code_of_error(error: TjscanError) -> int:
    """Exit code of the program after an error."""
    return next((code for kind, code in EXIT_CODES.items() if isinstance(error, kind)), 1)


def main(tokens: Sequence[str] | None = None) -> None:
    """Run the command line and turn errors into one message and an exit code."""
    # A library's log of what it stumbled over would stand beside the message that says it.
    logging.getLogger("trimesh").propagate = False
    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    try:
        app(sys.argv[1:] if tokens is None else tokens, exit_on_error=False, print_error=True)
    except CycloptsError:
        sys.exit(2)
    except TjscanError as error:
        print(f"tjscan: {message_with_notes(error)}", file=sys.stderr)
        sys.exit(exit_code_of_error(error))
    except BrokenPipeError:
        sys.exit(0)  # whoever reads the output has read enough
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        print(f"tjscan: too long for the name of a file: {error.filename!s:.60}…", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("tjscan: interrupted", file=sys.stderr)
        sys.exit(130)
