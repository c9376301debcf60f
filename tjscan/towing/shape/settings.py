"""What the planner weighs, keeps and trusts. Suzuki et al. (2022), V."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians

from tjscan.towing.tables import TargetSettings, WeightSettings


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
        Between middle lines of parts of the cable.
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


@dataclass(frozen=True, slots=True)
class PoseTrust:
    """How well the vehicles' poses are known.

    Parameters
    ----------
    position_sd : float
        Of x and of y, metres.
    heading_sd : float
        Radians.
    """

    position_sd: float = 3e-3
    heading_sd: float = radians(1.0)


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """What the planner weighs and keeps.

    Parameters
    ----------
    weights : WeightSettings
    targets : TargetSettings
    limits : TowingLimits
    trust : PoseTrust
        In the vehicles' poses.
    look_ahead : float
        Seconds of an obstacle's way that are kept free: delay and stopping time.
    """

    weights: WeightSettings = field(default_factory=WeightSettings)
    targets: TargetSettings = field(default_factory=TargetSettings)
    limits: TowingLimits = field(default_factory=TowingLimits)
    trust: PoseTrust = field(default_factory=PoseTrust)
    look_ahead: float = 1.0
