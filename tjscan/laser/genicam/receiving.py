"""Blocks of a stream as they come, in a thread of their own, until they are taken."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Final

from tjscan.core.errors import LaserFault
from tjscan.laser.genicam.messages import StampedBlock

MOST_WAITING: Final = 15_000
"""Blocks that may wait to be taken: more than a minute of 200 a second."""

MOST_AT_ONCE: Final = 200
"""Blocks that are taken at once at most."""

NUMBERS_OF_BLOCKS: Final = 65_535
"""GigE Vision's numbers of blocks: 1 follows the last. Longer numbers rise by as much."""

WAIT_FOR_BLOCK: Final = 0.05
"""Seconds that a block is waited for until it is seen whether more are wanted."""


class BlockReceiver:
    """Takes a stream's blocks as they come, and keeps them in order.

    Parameters
    ----------
    next_block : callable
        Waits for the next block, for some seconds at most; none if none came.
    """

    def __init__(self, next_block: Callable[[float], StampedBlock | None]) -> None:
        self._next_block = next_block
        self._waiting: deque[StampedBlock | None] = deque()
        self._came = threading.Condition()
        self._failure: Exception | None = None
        self._open = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def take(self, wait: float) -> list[StampedBlock | None]:
        """Blocks that came, in order, None for each that was lost; none after some seconds.

        Raises
        ------
        Exception
            What ended the stream, after the blocks before that.
        """
        with self._came:
            self._came.wait_for(lambda: self._waiting or self._failure, wait)
            if self._failure is not None and not self._waiting:
                raise self._failure
            count = min(len(self._waiting), MOST_AT_ONCE)
            return [self._waiting.popleft() for _ in range(count)]

    def close(self) -> None:
        """Take no more."""
        self._open = False
        self._thread.join()

    def _run(self) -> None:
        last: int | None = None
        try:
            while self._open:
                block = self._next_block(WAIT_FOR_BLOCK)
                if block is None:
                    continue
                ahead = 1 if last is None else (block.number - last) % NUMBERS_OF_BLOCKS
                if not 0 < ahead <= NUMBERS_OF_BLOCKS // 2:
                    continue  # it was given up, or came before
                last = block.number
                self._keep(block, ahead - 1)
        except Exception as error:  # a library raises what it likes
            with self._came:
                self._failure = error
                self._came.notify()

    def _keep(self, block: StampedBlock, lost: int) -> None:
        with self._came:
            self._waiting.extend([None] * min(lost, MOST_WAITING))
            self._waiting.append(block)
            self._came.notify()
            if len(self._waiting) > MOST_WAITING:
                raise LaserFault(
                    f"{MOST_WAITING} profiles wait to be read. See that nothing else keeps this "
                    "computer busy, then go on with --resume"
                )
