"""What a simulated cable, the vehicles that hold it and the things around them are made of."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from math import isfinite
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core.frames import Array
from tjscan.core.units import DEG_S, KG, MM, MM_S, MM_S2, NEWTON, SECONDS, SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class CableModel:
    """A cable as a chain of rigid links with ball joints; Suzuki et al. (2022), III-A, table I.

    Joint i is at the near end of link i, seen from the root; a straight cable is free of stress.

    Parameters
    ----------
    links : int
        How many: N.
    link_length, radius : float
        Metres: l, r.
    link_mass : float
        Of one link, kg: m.
    stiffness, damping : float
        Of each joint, about each of its axes, N m/rad and N m s/rad: k, d.
    friction : float
        Between the cable and the floor: μ.
    root : tuple of float, or None
        Where the cable is clamped: x and y, metres, and the direction of the first link at a
        first joint of no angle, radians. None leaves that end free.
    held : tuple of int
        Links that the vehicles hold, from the root to the tip. A vehicle's origin is at the far
        end of its link, and it heads as the link does. The last one is the welder.

    Raises
    ------
    ValueError
        A size that no cable has, or links held that are none.
    """

    links: int = 60
    link_length: float = 0.10
    radius: float = 8.5e-3
    link_mass: float = 0.10
    stiffness: float = 1.7
    damping: float = 0.15
    friction: float = 0.87
    root: tuple[float, float, float] | None = (0.0, 0.0, 0.0)
    held: tuple[int, ...] = (9, 19, 29, 39, 49, 59)

    def __post_init__(self) -> None:
        sizes = (self.link_length, self.radius, self.link_mass, self.stiffness, self.damping)
        if not all(isfinite(size) and size > 0 for size in sizes) or not 0 <= self.friction < 10:
            raise ValueError("sizes, masses, stiffness and damping of a cable must be above 0")
        held = self.held
        if not held or held[0] < 1 or any(b - a < 2 for a, b in pairwise(held)):
            raise ValueError("vehicles hold links in their order, two or more apart")
        if held[-1] != self.links - 1:
            raise ValueError("the welder, the last vehicle, holds the last link")

    def headings(self, angles: Array) -> Array:
        """Directions of the links in the plane, φ, shape (N,), from the joints' angles, (N,)."""
        first = 0.0 if self.root is None else self.root[2]
        return np.asarray(first + np.cumsum(angles))

    def points(self, angles: Array) -> Array:
        """The root and the far end of each link in the plane, metres, shape (N + 1, 2)."""
        headings = self.headings(angles)
        steps = self.link_length * np.column_stack((np.cos(headings), np.sin(headings)))
        start = (0.0, 0.0) if self.root is None else self.root[:2]
        return np.vstack((np.zeros(2), np.cumsum(steps, axis=0))) + start


@dataclass(frozen=True, slots=True, kw_only=True)
class TowingDriveModel(SettingsTable):
    """Bodies and drives of simulated towing vehicles, but for their radius and force.

    Mass, height and grip are from Suzuki et al. (2022), table II.

    Parameters
    ----------
    mass : float
        kg.
    body_height : float
        Of its body over the floor, metres.
    grip : float
        Friction of its wheels: the floor gives them no more than this share of its weight.
    top_speed, top_turn_rate : float
        m/s and rad/s. Assumption.
    lag : float
        Time constant with which the wanted speed follows a command, seconds. Assumption.
    acceleration, braking : float
        Most that the wanted speed changes on a command, and on a stop, m/s². Assumption; on a
        stop at most half of what the grip could do.
    encoder_noise : float
        Standard deviation of each speed that the encoders show, m/s. Assumption.
    """

    mass: Annotated[float, Gt(0), Le(1e4), KG] = 10.0
    body_height: Annotated[float, Gt(0), Le(1e4), MM] = 0.10
    grip: Annotated[float, Gt(0), Le(10)] = 0.50
    top_speed: Annotated[float, Gt(0), Le(5000), MM_S] = 0.3
    top_turn_rate: Annotated[float, Gt(0), Le(720), DEG_S] = 1.0
    lag: Annotated[float, Ge(0), Le(10), SECONDS] = 0.05
    acceleration: Annotated[float, Gt(0), Le(1e5), MM_S2] = 0.5
    braking: Annotated[float, Gt(0), Le(1e5), MM_S2] = 2.0
    encoder_noise: Annotated[float, Ge(0), Le(100), MM_S] = 2e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class TowingVehicleSettings(TowingDriveModel):
    """The table [simulation.towing_vehicle]: what every vehicle of a simulated tow truly is.

    Parameters
    ----------
    body_radius, force : float or None
        See `TowingVehicleModel`; None if they are as the table [vehicles] states.
    """

    body_radius: Annotated[float | None, Gt(0), Le(1e4), MM] = None
    force: Annotated[float | None, Gt(0), Le(1e5), NEWTON] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TowingVehicleModel(TowingDriveModel):
    """A simulated towing vehicle; its radius is from Suzuki et al. (2022), table II.

    Parameters
    ----------
    body_radius : float
        Of the cylinder that it is, metres.
    force : float
        Most that its motors give along the floor, newton. Assumption: more than the grip, so that
        its wheels spin before the motors stall.
    """

    body_radius: float = 0.15
    force: float = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class PasserBy:
    """A round thing that walks along a line through the area, and rests at both its ends.

    Parameters
    ----------
    radius : float
        Metres.
    waypoints : Array
        Of its middle, metres, shape (k, 2).
    speed : float, optional
        m/s.
    start_time : float, optional
        When it sets off, seconds.
    """

    radius: float
    waypoints: Array
    speed: float = 0.0
    start_time: float = 0.0

    def motion_at(self, time: float) -> tuple[Array, Array]:
        """Where it is and how fast, metres and m/s, shape (2,) each."""
        points = np.atleast_2d(np.asarray(self.waypoints, float))
        steps = np.diff(points, axis=0)
        along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(steps, axis=1))))
        walked = self.speed * (time - self.start_time)
        at = np.array([np.interp(walked, along, points[:, axis]) for axis in (0, 1)])
        if not 0 <= walked < along[-1]:
            return at, np.zeros(2)
        leg = int(np.searchsorted(along, walked, side="right")) - 1
        return at, self.speed * steps[leg] / (along[leg + 1] - along[leg])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TowingWorldModel:
    """All there is in a simulated work area.

    Parameters
    ----------
    cable : CableModel
        The cable, and which of its links vehicles hold.
    vehicle : TowingVehicleModel, optional
        What every vehicle is.
    walls : tuple of Array, optional
        Closed polygons, metres, shape (k, 2): the outline of the area first, then its pillars.
    passers_by : tuple of PasserBy, optional
        Who walks through it.
    exempt_links : int, optional
        How many links at the root and at the welder meet no wall, and so does the welder itself:
        work starts and ends at walls.
    """

    cable: CableModel
    vehicle: TowingVehicleModel = field(default_factory=TowingVehicleModel)
    walls: tuple[Array, ...] = ()
    passers_by: tuple[PasserBy, ...] = ()
    exempt_links: int = 3
