"""Driving by hand, before a crawl begins."""

from __future__ import annotations

from typing import Protocol

from tjscan.vehicle.vehicle import Twist


class HandDrive(Protocol):
    """Who drives the crawler to its joint by hand, and says when the crawl begins."""

    def order(self) -> Twist | None:
        """Return the twist asked for at this moment; None once the crawl may begin.

        It is asked for anew in every cycle, and is `tjscan.vehicle.vehicle.REST` where nobody has
        asked for any lately: who drives by hand must go on saying so.
        """
        ...
