"""Whether a controller is alive: stale readings still return, but its clock stands then."""

from __future__ import annotations

import time

from tjscan.core.errors import ArmNotResponding
from tjscan.robot.ur.messages import ControllerState


class ControllerClockWatch:
    """Watches the controller's clock, and raises when it stands still.

    Parameters
    ----------
    limit : float
        Seconds.
    """

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._time: float | None = None
        self._since = 0.0
        self._seen = 0.0

    def check_clock_advances(self, now: ControllerState) -> None:
        """Check that the controller's clock has advanced since it was last seen."""
        moment = time.monotonic()
        # While nobody looked, nothing is known: a pause between two looks counts for nothing.
        if now.time != self._time or moment - self._seen > self._limit / 4:
            self._time, self._since = now.time, moment
        self._seen = moment
        if moment - self._since > self._limit:
            raise ArmNotResponding(
                f"the controller's clock stands at {now.time:.3f} s for {self._limit:g} s: it is "
                "silent. Look at its pendant and cable, then start again."
            )
