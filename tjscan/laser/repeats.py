"""Whether a profile came before: a sensor that froze, or gives out what it has in its buffers."""

from __future__ import annotations

from collections import deque
from typing import Final

from tjscan.laser.profile import Profile

REMEMBERED: Final = 100_000
"""Profiles: a quarter of an hour at 100 a second, and more than any sensor's buffers hold."""


class ProfileRepeats:
    """Recognises profiles that came before, to the last bit.

    No sensor measures the same noise twice. Profiles without a point are all alike; none of them
    is a repeat.
    """

    def __init__(self) -> None:
        self._order: deque[bytes] = deque()
        self._known: set[bytes] = set()

    def is_repeat(self, profile: Profile) -> bool:
        """Whether a profile is one of those before; it is one of them from now on."""
        if not profile.valid.any():
            return False
        digest = profile.digest
        if digest in self._known:
            return True
        self._order.append(digest)
        self._known.add(digest)
        if len(self._order) > REMEMBERED:
            self._known.remove(self._order.popleft())
        return False
