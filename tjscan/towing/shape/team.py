"""The vehicles along the cable, and the limits that no plan may break."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise


def equal_links(links: int, vehicles: int, last: int | None = None) -> tuple[int, ...]:
    """Links that vehicles hold at equal spacing; the last is the welder's, at the tip.

    Parameters
    ----------
    links : int
        Of the cable.
    vehicles : int
        The welder among them.
    last : int, optional
        Links between the last towing vehicle and the welder; as many as others where left out.
    """
    if last is not None:
        return (*equal_links(links - last, vehicles - 1), links - 1)
    return tuple(round((m + 1) * links / vehicles) - 1 for m in range(vehicles))


@dataclass(frozen=True, slots=True)
class TowingTeam:
    """Vehicles along the cable. The last is the welder: it holds the last link.

    Parameters
    ----------
    held_links : tuple of int
        Link that each vehicle holds, counted from 0 at the root, rising.
    body_radius : float
        Of a vehicle seen from above, metres.
    top_speed : float
        Of a towing vehicle, m/s.

    Raises
    ------
    ValueError
        Links that do not rise.
    """

    held_links: tuple[int, ...] = equal_links(60, 6)
    body_radius: float = 0.15
    top_speed: float = 0.1

    def __post_init__(self) -> None:
        held = self.held_links
        if not held or held[0] < 0 or any(b <= a for a, b in pairwise(held)):
            raise ValueError(f"held links must rise from 0 or more: {held}")

    @property
    def welder(self) -> int:
        """Number of the welder in the team."""
        return len(self.held_links) - 1


@dataclass(frozen=True, slots=True)
class TowingLimits:
    """Distances that no plan undercuts, metres. The joints' limit is the cable's own.

    Parameters
    ----------
    link_clearance : float
        Of the cable's middle line to walls, pillars and obstacles.
    body_clearance : float
        Of a vehicle's body to the same, and to links that it does not hold.
    vehicle_gap : float
        Between the bodies of two vehicles.
    cable_gap : float
        Between middle lines where the cable comes near itself.
    free_at_root, free_at_welder : float
        Length of cable at either end to which `link_clearance` does not apply: work starts and
        ends at walls. The welder's body is not looked at either.
    """

    link_clearance: float = 0.02
    body_clearance: float = 0.02
    vehicle_gap: float = 0.05
    cable_gap: float = 0.04
    free_at_root: float = 0.3
    free_at_welder: float = 0.3
