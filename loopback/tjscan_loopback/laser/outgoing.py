"""Packets on their way to the client, and what a bad network does to them."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from random import Random
from typing import Final

from tjscan_loopback.laser.faults import LaserFaultOrder, OrderedLaserFault
from tjscan_loopback.laser.gvsp import (
    LEADER_PACKET,
    TRAILER_PACKET,
    kind_of_packet,
    unavailable_packet,
)

KEPT_BLOCKS: Final = 8
"""Blocks whose packets can be asked for again."""

MOST_AGAIN: Final = 1024
"""Packets that one request brings again at most."""

LATE_DELAY: Final = 0.5
"""Seconds by which a late block comes late."""

_LOST_BY: Final = {
    LEADER_PACKET: LaserFaultOrder.LOSE_LEADER,
    TRAILER_PACKET: LaserFaultOrder.LOSE_TRAILER,
}


class OutgoingPackets:
    """Queue of packets, by the time when they are due.

    Parameters
    ----------
    faults : mapping
        What is wrong with the network, looked up for each packet.
    seed : int
        Of the packets that get lost, and of their order.
    """

    def __init__(self, faults: Mapping[LaserFaultOrder, OrderedLaserFault], seed: int = 0) -> None:
        self._faults, self._dice = faults, Random(seed)
        self._queue: deque[tuple[float, bytes]] = deque()
        self._kept: dict[int, list[bytes]] = {}

    @property
    def next_due(self) -> float | None:
        """When the next packet is due; None if there is none."""
        return self._queue[0][0] if self._queue else None

    def clear(self) -> None:
        """Send nothing more of what was queued."""
        self._queue.clear()
        self._kept.clear()

    def queue_block(self, number: int, packets: list[bytes], now: float) -> None:
        """Queue the packets of a block, and keep them for a while."""
        self._kept[number] = packets
        while len(self._kept) > KEPT_BLOCKS:
            del self._kept[next(iter(self._kept))]
        if LaserFaultOrder.REORDER in self._faults:
            packets = [packets[0], *self._dice.sample(packets[1:], len(packets) - 1)]
        if LaserFaultOrder.DUPLICATE in self._faults:
            packets = [packet for packet in packets for _ in range(2)]
        due = now + (LATE_DELAY if LaserFaultOrder.LATE in self._faults else 0.0)
        for packet in packets:
            self.queue_packet(packet, due)

    def queue_packet(self, packet: bytes, due: float) -> None:
        """Queue one packet, unless it is to be lost."""
        loss = self._faults.get(LaserFaultOrder.LOSS)
        lost = loss is not None and self._dice.random() < loss.per_cent / 100
        if not lost and _LOST_BY.get(kind_of_packet(packet)) not in self._faults:
            self._queue.append((due, packet))

    def queue_again(self, block: int, first: int, last: int, now: float) -> None:
        """Queue packets that the client asks for again."""
        kept = self._kept.get(block, [])
        for number in range(first, min(last, first + MOST_AGAIN) + 1):
            known = number < len(kept)
            packet = kept[number] if known else unavailable_packet(block, number)
            self.queue_packet(packet, now)

    def take_due(self, now: float) -> list[bytes]:
        """Take the packets that are due from the queue."""
        due = []
        while self._queue and self._queue[0][0] <= now:
            due.append(self._queue.popleft()[1])
        return due
