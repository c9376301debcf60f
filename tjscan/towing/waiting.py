"""Why the welder waits, and for how long it may."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from tjscan.core.errors import TowHalted, VehicleFault

FIGURE: Final = re.compile(r"\d+(\.\d+)?(?= (mm|s|m/min)\b|°)")
"""A figure with its unit: where only such differ, nothing new is to be said."""


@dataclass(frozen=True, slots=True)
class Waiting:
    """Why the welder waits.

    Parameters
    ----------
    why : str
        In a sentence without its full stop.
    device : bool
        Whether a vehicle or the link to it is to blame.
    """

    why: str
    device: bool = False


class Patience:
    """Reports that the welder waits, and that it goes on; gives up when it has waited for too long.

    Parameters
    ----------
    seconds : float
        For which it may wait.
    report : callable
        Receives events: a name and a sentence.
    """

    def __init__(self, seconds: float, report: Callable[[str, str], None]) -> None:
        self._seconds, self._report = seconds, report
        self._said: set[str] = set()
        self._since = 0.0

    def update(self, now: float, waiting: Waiting | None, along: float) -> None:
        """Take in whether the welder waits.

        Parameters
        ----------
        now : float
            Seconds.
        waiting : Waiting or None
            Why it waits, if it does.
        along : float
            Where along its seam, metres.

        Raises
        ------
        TowHalted
            If it waited for too long.
        VehicleFault
            The same, where a vehicle or the link to it is to blame.
        """
        if waiting is None:
            if self._said:
                self._report("goes on", f"after {now - self._since:.1f} s")
            self._said.clear()
            return
        if not self._said:
            self._since = now
        if (words := FIGURE.sub("", waiting.why)) not in self._said:
            self._report("waits", waiting.why)
            self._said.add(words)
        if now - self._since > self._seconds:
            sentence = (
                f"{waiting.why}. The weld is halted {1e3 * along:.0f} mm along the seam; "
                "when the way is clear, go on with tjscan tow run --resume DIR"
            )
            raise VehicleFault(sentence) if waiting.device else TowHalted(sentence)
