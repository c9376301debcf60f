"""Faults of the way from a client to the controller: packets late, lost, doubled, out of order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from random import Random
from typing import Final

from tjscan_loopback.ur.faults import InjectedFault
from tjscan_loopback.ur.wire import Value

Inputs = Sequence[tuple[str, Value]]
"""What a packet writes: names and values."""

PACKET_FAULTS: Final = frozenset(
    {
        *(InjectedFault.LOSE_PACKETS, InjectedFault.LATE_PACKETS, InjectedFault.DOUBLE_PACKETS),
        *(InjectedFault.REORDER_PACKETS, InjectedFault.FREEZE_REGISTERS),
    }
)

AFFECTED_SHARE: Final = 0.3
"""Share of the packets that are lost, doubled or overtaken."""

LATE_BY: Final = (0.02, 0.15)
"""Seconds by which each packet is late."""

OVERTAKEN_BY: Final = (0.002, 0.02)
"""Seconds by which others overtake one, or its double comes later."""

FAULTY_INPUT: Final = "input_double_register_24"
"""Packets that write this are affected: those of a path, not the client library's."""


class PacketWay:
    """Way of the packets to the controller.

    Parameters
    ----------
    seed : int
        Decides which are affected.
    """

    def __init__(self, seed: int) -> None:
        self.faults: set[InjectedFault] = set()
        self._random = Random(seed)
        self._on_way: list[tuple[float, int, Inputs]] = []
        self._count, self._last = 0, 0.0

    def send(self, inputs: Inputs, now: float) -> None:
        """Send a packet on its way, at a time in seconds."""
        random, faults, due = self._random, self.faults, now
        if faults and any(name == FAULTY_INPUT for name, _ in inputs):
            affected = random.random() < AFFECTED_SHARE
            lost = affected and InjectedFault.LOSE_PACKETS in faults
            if lost or InjectedFault.FREEZE_REGISTERS in faults:
                return
            if InjectedFault.LATE_PACKETS in faults:  # but in order
                due = self._last = max(now + random.uniform(*LATE_BY), self._last)
            if affected and InjectedFault.DOUBLE_PACKETS in faults:
                self._put(inputs, due + random.uniform(*OVERTAKEN_BY))
            if affected and InjectedFault.REORDER_PACKETS in faults:
                due += random.uniform(*OVERTAKEN_BY)
        self._put(inputs, due)

    def arrived(self, now: float) -> Iterator[tuple[str, Value]]:
        """What has arrived by a time, in order."""
        while self._on_way and self._on_way[0][0] <= now:
            yield from self._on_way.pop(0)[2]

    def _put(self, inputs: Inputs, due: float) -> None:
        self._count += 1
        self._on_way.append((due, self._count, inputs))
        self._on_way.sort(key=lambda one: one[:2])
