"""A power source over its registers: how soon the arc is out, and the torch at rest, after a fault.

The loopback source runs in a process of its own; both processes read the same clock. Then faults of
all kinds at every state of an arc: 300, with ``--quick`` 24.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import _table
from _arc import RealTimeArc, loopback_power_source
from _arc_faults import draw_faults
from _table import Row

from tjscan.core.config import read_toml, validate_table
from tjscan.core.errors import WeldStopped
from tjscan.power.modbus.registers import ModbusPowerSettings
from tjscan.power.modbus.source import ModbusPowerSource
from tjscan.power.sequence import ArcPhase
from tjscan_loopback.process import PowerLoopbackProcess

JOB = Path(__file__).parent.parent / "examples" / "weld.toml"

FAULTS = 24 if "--quick" in sys.argv else 300
FAULT_SEED = 33
REPEATS = 10
"""Times that each row is measured; the worst counts."""

Measure = Callable[[PowerLoopbackProcess, RealTimeArc], float]


def stop(process: PowerLoopbackProcess, arc: RealTimeArc) -> float:
    """Seconds from a stop to no current."""
    asked = time.monotonic()
    try:
        arc.arc.stop("by the bench")
    except WeldStopped:
        return process.wait_for_current(on=False) - asked
    raise RuntimeError("it was not stopped")


def killed(process: PowerLoopbackProcess, arc: RealTimeArc) -> float:
    """Seconds from the last exchange of a program that is gone to no current."""
    last = time.monotonic()
    return process.wait_for_current(on=False) - last


def link_dead(process: PowerLoopbackProcess, arc: RealTimeArc) -> float:
    """Seconds from a dead link to no current, with the torch at rest by then."""
    process.write_line("link-dead")
    began = time.monotonic()
    arc.until_stopped()
    return max(process.wait_for_current(on=False), arc.stopped) - began


def stall(process: PowerLoopbackProcess, arc: RealTimeArc) -> float:
    """Seconds from a torch that stands to no current."""
    began, arc.stands, arc.speed = time.monotonic(), True, 0.0
    arc.until_stopped()
    return process.wait_for_current(on=False) - began


def arc_lost(process: PowerLoopbackProcess, arc: RealTimeArc) -> float:
    """Seconds from an arc that goes out by itself to the torch at rest."""
    process.write_line("arc-lost")
    arc.until_stopped()
    return arc.stopped - process.wait_for_current(on=False)


def worst(
    process: PowerLoopbackProcess, settings: ModbusPowerSettings, measure: Measure
) -> tuple[float, float]:
    """The worst time of some arcs, and their share in which the source's flow had ended."""
    times, ended = [], 0
    for _ in range(REPEATS):
        process.schedule_fault("clear")
        process.unread_output()
        with ModbusPowerSource(settings) as source:
            arc = RealTimeArc(source)
            arc.run_to(ArcPhase.WELDING)
            for _ in range(10):
                arc.cycle()
            process.wait_for_current(on=True)
            times.append(measure(process, arc))
            process.schedule_fault("clear")
            ended += not source.state().flow
    return max(times), ended / REPEATS


def measure() -> Iterator[Row]:
    """The rows."""
    settings = validate_table(ModbusPowerSettings, read_toml(JOB)["power"]["modbus"], JOB)
    with loopback_power_source(settings) as (process, reached):
        find = partial(worst, process, reached)
        for name, function, limit in (
            ("stop: until no current flows", stop, 20),
            ("program gone: until no current flows", killed, 120),
            ("link dead: until no current flows and the torch is at rest", link_dead, 120),
            ("torch stalls: until no current flows", stall, 120),
            ("arc lost: until the torch is at rest", arc_lost, 20),
        ):
            longest, off = find(function)
            yield Row(f"{name}, worst of {REPEATS}", 1e3 * longest, limit, "ms")
            yield Row(f"{name.partition(':')[0]}: arc off afterwards", 100 * off, 100, "%", 100)
    yield from fault_rows(settings)


def fault_rows(settings: ModbusPowerSettings) -> Iterator[Row]:
    """Faults at every state: named, arc off, gone on with over an overlap, nothing twice."""
    found = draw_faults(settings, FAULTS, FAULT_SEED)
    for one in found:
        if not (one.named and one.off and one.whole) or one.twice > 1e-6:
            print(one, file=sys.stderr)
    ended = sum(one.ended for one in found)
    head = f"{len(found)} faults at every state, {ended} of them ended an arc"
    for name, holds in (
        ("named", [one.named for one in found]),
        ("arc off", [one.off for one in found]),
        ("welded whole after a resume", [one.whole for one in found]),
        ("nothing welded twice but the overlap", [one.twice <= 1e-6 for one in found]),
    ):
        yield Row(f"{head}: {name}", 100 * sum(holds) / len(found), 100, "%", 100)


if __name__ == "__main__":
    sys.exit(
        _table.main(
            "A power source behind Modbus TCP",
            measure,
            [word for word in sys.argv[1:] if word != "--quick"],
        )
    )
