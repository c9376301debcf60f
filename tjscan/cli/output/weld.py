"""Output of ``tjscan weld``: its events and a table on stderr, the log as JSON on stdout."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tjscan.cli.interrupt import INTERRUPT_EXIT_CODE
from tjscan.cli.output.console import ask_at_terminal, print_fields, print_message
from tjscan.core.devices import DriverKind
from tjscan.core.errors import WeldStopped
from tjscan.core.signals import handle_ctrl_c
from tjscan.job.weld import WeldJob
from tjscan.power.sequence import ArcFault
from tjscan.recording.journal import RunEvent
from tjscan.report.write import write_run_report
from tjscan.runs.run import nobody_objects
from tjscan.runs.weld.journal import (
    HEIGHT_EVENT,
    STATION_EVENT,
    SURFACE_EVENT,
    WIDE_POOLS_EVENT,
    ArcMessage,
    LookMessage,
    PlannedBeadMessage,
    name_of_bead,
)
from tjscan.runs.weld.results import SIMULATED_WELD_NOTE, WELD_LOG_FILE, read_recorded_weld
from tjscan.runs.weld.run import WeldContext


class WeldPrinter:
    """A weld's journal that prints beads, looks and events."""

    def record(self, message: object) -> None:
        """Print a message of a weld."""
        match message:
            case PlannedBeadMessage():
                speed = [60e3 * float(v) for v in (message.speed.min(), message.speed.max())]
                area = 1e6 * float(message.area.mean())
                print_message(
                    f"{message.name}, layer {message.layer + 1}: {area:.1f} mm² on average, "
                    f"{speed[0]:.0f} to {speed[1]:.0f} mm/min"
                )
            case ArcMessage() if not message.fault:
                length, time = 1e3 * (message.end - message.begin), message.seconds
                name = name_of_bead(message.number, message.station)
                print_message(f"{name}: {length:.0f} mm in {time:.0f} s")
            case LookMessage():
                print_message(
                    f"look {message.name}: {100 * message.read.mean():.0f} % read, "
                    f"torch {deviation_text(message)} mm off, deposition {message.gain:.3f}"
                )
            case RunEvent() if message.name in (
                "stop",
                "not read",
                "retract",
                "dry run",
                HEIGHT_EVENT,
                STATION_EVENT,
                SURFACE_EVENT,
                WIDE_POOLS_EVENT,
            ):
                print_message(f"{message.name}: {message.detail}")


def deviation_text(look: LookMessage) -> str:
    """Deviation of the torch as a look shows it, in mm."""
    if look.deviation is None or look.deviation_sigma is None:
        return "–"
    return f"{1e3 * look.deviation:.2f} ± {1e3 * look.deviation_sigma:.2f}"


@contextmanager
def watch_weld(job: WeldJob, file: Path) -> Iterator[WeldContext]:
    """Print a weld's events, and write its report, while the block runs; Ctrl-C stops it."""
    print_message(SIMULATED_WELD_NOTE)
    simulated = job.power.driver_kind is DriverKind.SIMULATED
    ask = nobody_objects if simulated and not job.weld.holds else ask_at_terminal
    context = WeldContext(job, file, WeldPrinter(), write_run_report, ask=ask)

    def stop() -> None:
        context.stop.ends_after_section = True

    try:
        with handle_ctrl_c(stop):
            yield context
    except WeldStopped as error:
        if error.fault != ArcFault.STOPPED:
            raise
        print_message(f"{error}. See that the way is clear; --resume goes on from there")
        raise SystemExit(INTERRUPT_EXIT_CODE) from error


def print_weld_log(directory: Path, *, json: bool) -> None:
    """Print what was welded."""
    file = directory / WELD_LOG_FILE
    if json:
        print(file.read_text(encoding="utf-8"), end="")
        return
    found = read_recorded_weld(directory)
    rows = []
    for passes, bead in enumerate(found.beads, start=1):
        arcs = found.arcs_of(bead)
        looks = [look for look in found.looks if look.beads == passes]
        off = deviation_text(looks[-1]) if looks else ""
        rows.append(
            (
                bead.name.removeprefix("bead "),
                str(bead.layer + 1),
                f"{1e3 * sum(arc.end - arc.begin for arc in arcs):.0f}",
                f"{sum(arc.seconds for arc in arcs):.0f}",
                off,
            )
        )
    print_fields(rows, ("bead", "layer", "welded / mm", "arc / s", "torch off / mm"))
    print_message(f"{SIMULATED_WELD_NOTE}: {file}")
