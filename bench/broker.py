"""Whether a vehicle behind a broker stops, and its program notices, beside clients that intrude.

Foreign, replayed, future-numbered and flooding clients (`_intruders`), 100 times each; ``--quick``
takes ten of each.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from math import inf

from _intruders import Intruder, Intrusion, seconds_until_alarm, seconds_until_stopped
from _table import Row, main

from tjscan_loopback.broker import MosquittoProcess
from tjscan_loopback.process import VehicleLoopbackProcess


def measure(times: int) -> Iterator[Row]:
    """Rows of the bench."""
    with MosquittoProcess() as broker, VehicleLoopbackProcess(broker.address) as vehicles:
        for kind in Intrusion:
            with Intruder(broker.port, kind) as intruder:
                stops = [seconds_until_stopped(intruder, broker, vehicles) for _ in range(times)]
            yield Row(f"{kind}: not stopped within 0.3 s, of {times}", beyond(0.3, stops), 0)
            yield Row(f"{kind}: longest way to rest", 1e3 * max(stops), inf, "ms")
        for kind in Intrusion:
            with Intruder(broker.port, kind, in_turn=True) as intruder:
                seen = [seconds_until_alarm(intruder, broker, vehicles) for _ in range(times)]
            name = f"{kind}, and obeyed: motion not noticed within 0.5 s, of {times}"
            yield Row(name, beyond(0.5, seen), 0)
            yield Row(f"{kind}: longest until the alarm", 1e3 * max(seen), inf, "ms")


def beyond(limit: float, times: list[float]) -> int:
    """How many of these seconds are beyond a limit."""
    return sum(not time <= limit for time in times)


if __name__ == "__main__":
    QUICK = "--quick" in sys.argv
    ARGUMENTS = [word for word in sys.argv[1:] if word != "--quick"]
    sys.exit(main("vehicles beside intruders", lambda: measure(10 if QUICK else 100), ARGUMENTS))
