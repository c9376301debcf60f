"""Driving by hand, before a crawl begins."""

from __future__ import annotations

from typing import Protocol

from tjscan.crawler.control_cycle import ControlCycle
from tjscan.crawler.guards import Guards
from tjscan.vehicle.vehicle import REST, Twist, Vehicle


class HandDrive(Protocol):
    """Drives the crawler to its joint by hand, and decides when the crawl begins."""

    def order(self) -> Twist | None:
        """Return the twist asked for at this moment; None once the crawl may begin.

        It is asked for in every cycle, and is `tjscan.vehicle.vehicle.REST` where nobody has
        asked for any lately: who drives by hand must go on saying so.
        """
        ...


def drive_by_hand(hand: HandDrive, vehicle: Vehicle, cycle: ControlCycle, guards: Guards) -> None:
    """Drive as a person asks, until he lets the crawl begin.

    If nothing is asked for, or a way towards an edge, the vehicle is stopped, not only commanded
    to rest: it brakes as hard as it can.

    Parameters
    ----------
    hand : HandDrive
    vehicle : Vehicle
        That of the cycle.
    cycle : ControlCycle
    guards : Guards

    Raises
    ------
    CrawlStopped, VehicleFault, LaserFault
        As `ControlCycle.run` does.
    """
    vehicle.stop()
    stopped = True
    while (twist := hand.order()) is not None:
        stays = twist == REST or guards.leads_off_steel(twist)
        if stays and not stopped:
            vehicle.stop()
        elif stopped and not stays:
            vehicle.accept_commands_again()
        stopped = stays
        cycle.run(REST if stays else twist, stopped=stopped)
    vehicle.accept_commands_again()
