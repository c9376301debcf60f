"""A V butt joint between two plates of a ship's hull, as its file and a job describe it.

Its course in the hull's surface is a straight line or an arc. Frame h is in that surface: x along
the joint at its start, y to the right, z into the hull. Headings count from x towards y: clockwise
as seen from outside.

A cross-section's coordinates: to the right of a traveller along the joint, from the middle between
the top edges, and height over the middle of both plates' outsides, out of the hull. Metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import atan2, cos, hypot, pi, sin, sqrt, tan
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le, Len

from tjscan.core.frames import Array, readonly_copy
from tjscan.core.units import DEG, LIST_OR_WORD_IN_FILE, METRE_UNIT, MM, SettingsTable

LEAST_ROOT_OPENING: Final = -1e-6
"""Least root opening, in metres: below zero by no more than what rounding of the file leaves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HullTack(SettingsTable):
    """A tack weld in the root.

    Parameters
    ----------
    at : float
        Of its middle along the joint, in metres.
    length : float
        Along the joint, in metres; its ends slope down over as much as it is high.
    height : float
        Over the groove's bottom, in metres.
    """

    at: Annotated[float, Ge(0.0), Le(1000.0), METRE_UNIT]
    length: Annotated[float, Ge(2.0), Le(500.0), MM] = 0.03
    height: Annotated[float, Gt(0.0), Le(40.0), MM] = 0.005


@dataclass(frozen=True, slots=True, kw_only=True)
class WeldBead(SettingsTable):
    """What a pass adds to the cross-section: a face that is a parabola from toe to toe.

    Parameters
    ----------
    level : float
        Height of its toes over the groove's bottom, in metres: the depth of the groove puts
        them on the hull.
    crown : float
        How far its middle rises over (or sags below) its toes, in metres.
    left, right : float
        Where its toes are, as shares of half the groove's width at its level; -1 to 1 reaches
        from bevel to bevel, more laps over the hull.
    """

    level: Annotated[float, Ge(0.0), Le(60.0), MM]
    crown: Annotated[float, Ge(-5.0), Le(10.0), MM] = 0.0
    left: Annotated[float, Ge(-2.0), Le(2.0)] = -1.0
    right: Annotated[float, Ge(-2.0), Le(2.0)] = 1.0

    def __post_init__(self) -> None:
        if not self.left < self.right:
            raise ValueError("left must be smaller than right")


@dataclass(frozen=True, slots=True, kw_only=True)
class HullJoint(SettingsTable):
    """A V butt joint in a hull: groove, misfit, tacks, course, and what each pass leaves in it.

    Parameters
    ----------
    width : float
        Between the two top edges, in metres.
    depth : float
        Of the groove from the hull's outside, in metres: the plates' thickness.
    opening_angle : float
        Between the bevels, in radians.
    root_face : float
        Height of the square edge below each bevel, in metres.
    backing : bool
        Whether a strip closes the root opening; without, nothing is seen through it.
    high_low : float
        Height of the right plate over the left one, out of the hull, in metres.
    length : float
        Along the joint, in metres.
    radius : float or None
        Of the joint's line in the hull's surface, in metres, positive if it bends to the
        right of who goes along it; None if it is straight.
    tacks : tuple of HullTack
    beads : tuple of WeldBead
        What pass 1, 2 … lays down.
    ripple : float
        Standard deviation of the beads' height along the joint, in metres.
    """

    width: Annotated[float, Ge(4.0), Le(120.0), MM] = 0.030
    depth: Annotated[float, Ge(3.0), Le(60.0), MM] = 0.020
    opening_angle: Annotated[float, Ge(30.0), Le(100.0), DEG] = 1.0471975511965976
    root_face: Annotated[float, Ge(0.0), Le(20.0), MM] = 0.0
    backing: bool = True
    high_low: Annotated[float, Ge(-10.0), Le(10.0), MM] = 0.0
    length: Annotated[float, Gt(0.0), Le(1000.0), METRE_UNIT] = 2.0
    radius: Annotated[float | None, METRE_UNIT] = None
    tacks: Annotated[tuple[HullTack, ...], Len(0, 1000), LIST_OR_WORD_IN_FILE] = ()
    beads: Annotated[tuple[WeldBead, ...], Len(0, 50), LIST_OR_WORD_IN_FILE] = ()
    ripple: Annotated[float, Ge(0.0), Le(2.0), MM] = 0.0

    def __post_init__(self) -> None:
        if not self.root_face < self.depth:
            raise ValueError("root_face_mm leaves no bevel: it must be smaller than depth_mm")
        if self.root_opening < LEAST_ROOT_OPENING:
            raise ValueError(
                f"bevels of {1e3 * (self.depth - self.root_face):.4g} mm depth at this opening "
                f"angle are {1e3 * (self.width - self.root_opening):.4g} mm wide: make width_mm at "
                "least that, or the angle smaller"
            )
        if self.radius is not None and not abs(self.radius) >= 1.0:
            raise ValueError("radius_m is 1 or more, below zero if the joint bends to the left")

    @property
    def root_opening(self) -> float:
        """Between the plates at the root, in metres."""
        return self.width - 2 * (self.depth - self.root_face) * tan(self.opening_angle / 2)

    @property
    def groove_area(self) -> float:
        """Of the empty groove below the line between its top edges, in m²."""
        bevelled = self.depth - self.root_face
        return (
            0.5 * (self.width + self.root_opening) * bevelled + self.root_opening * self.root_face
        )

    @property
    def curvature(self) -> float:
        """Of the joint's line in the hull's surface, in 1/m, positive to the right."""
        return 0.0 if self.radius is None else 1.0 / self.radius


def joint_line_pose(joint: HullJoint, along: float) -> tuple[float, float, float]:
    """Place and direction of a joint's line.

    Parameters
    ----------
    joint : HullJoint
    along : float
        Distance along the joint, in metres; beyond its ends it goes on as it is.

    Returns
    -------
    tuple of float
        x, y in frame h, in metres, and heading, in radians.
    """
    kappa = joint.curvature
    if kappa == 0:
        return along, 0.0, 0.0
    turned = kappa * along
    return sin(turned) / kappa, 2 * sin(turned / 2) ** 2 / kappa, turned


def place_beside_joint(joint: HullJoint, x: float, y: float) -> tuple[float, float]:
    """Distance along a joint of its nearest point, and distance to the right of it, in metres.

    Parameters
    ----------
    joint : HullJoint
    x, y : float
        In frame h, in metres.
    """
    kappa = joint.curvature
    if kappa == 0:
        return x, y
    # Seen from the arc's centre, (0, 1 / kappa).
    sign = 1.0 if kappa > 0 else -1.0
    along = atan2(sign * x, sign * (1 / kappa - y)) / kappa
    return along, sign * (1 / abs(kappa) - hypot(x, 1 / kappa - y))


def laser_offset(joint: HullJoint, x: float, y: float, heading: float) -> tuple[float, float]:
    """Where a laser line crosses a joint.

    Parameters
    ----------
    joint : HullJoint
    x, y : float
        The laser's centre in frame h, in metres.
    heading : float
        Of the vehicle: the line runs square to it. Radians.

    Returns
    -------
    along, offset : float
        Place on the joint, and the laser's centre minus the joint along the line, positive where
        it is to the right. Metres.
    """
    along, right = place_beside_joint(joint, x, y)
    for _ in range(4):  # a line that runs at a small angle meets the joint a little farther on
        px, py, direction = joint_line_pose(joint, along)
        relative = heading - direction
        ahead = (x - px) * cos(direction) + (y - py) * sin(direction)
        right = (y - py) * cos(direction) - (x - px) * sin(direction)
        offset = right / cos(relative)
        along += ahead + offset * sin(relative)
    return along, offset


HALF_PLATE_WIDTH: Final = 0.25
"""How far each plate is drawn from the joint, in metres: no laser line is longer."""

DRAWN_GAP_DEPTH: Final = 0.5
"""How deep a root opening without backing is drawn, in metres: out of any laser's range."""

BEAD_NODES: Final = 25
"""Points on the face of a bead; the chords between them miss it by a micrometre or two."""

UPRIGHT_FACE_LEAN: Final = 1e-9
"""By how much upright faces lean, in metres, so that a section has one height everywhere."""

PLACE_DECIMALS: Final = 3
"""Decimals of a place along the joint: a section is taken at the nearest millimetre."""

RIPPLE_WAVELENGTHS: Final = (0.006, 0.017, 0.052)
"""Wavelengths of a bead's ripple along the joint, in metres (assumption)."""


def hull_section(joint: HullJoint, along: float, passes: int = 0) -> Array:
    """Outline of the steel across a hull joint at one place.

    Parameters
    ----------
    joint : HullJoint
    along : float
        Distance along the joint, in metres.
    passes : int
        How many passes are welded there.

    Returns
    -------
    ndarray, shape (n, 2)
        Across and height, in metres, from left to right; not to be written to.
    """
    along = round(along, PLACE_DECIMALS)
    rises = (min(t.height, t.length / 2 - abs(along - t.at)) for t in joint.tacks)
    ripples = tuple(joint.ripple * _bead_ripple(along, k) for k in range(len(joint.beads[:passes])))
    return _section_with_welds(joint, max((0.0, *rises)), ripples)


@lru_cache(maxsize=256)
def _section_with_welds(joint: HullJoint, tack: float, ripples: tuple[float, ...]) -> Array:
    """Section with a tack and with beads whose crowns rise higher by their ripples."""
    section = _section_as_prepared(joint)
    if tack > 0:
        section = _lay_bead(joint, section, WeldBead(level=tack), 0.0)
    for bead, ripple in zip(joint.beads, ripples, strict=False):
        section = _lay_bead(joint, section, bead, ripple)
    return readonly_copy(section)


def _section_as_prepared(joint: HullJoint) -> Array:
    """Section before any welding; each plate is moved by half the high-low."""
    flank = _flank_nodes(joint)
    step = np.array((0.0, joint.high_low / 2))
    left, right = flank[::-1] * (-1, 1) - step, flank + step
    if joint.backing or joint.root_opening < 4 * UPRIGHT_FACE_LEAN:
        return np.vstack((left, right))
    inward = np.array((UPRIGHT_FACE_LEAN, -DRAWN_GAP_DEPTH))
    return np.vstack((left, left[-1] + inward, right[0] + inward * (-1, 1), right))


def _flank_nodes(joint: HullJoint) -> Array:
    """The right plate from the bottom of its root face outward, without high-low, (n, 2)."""
    gap = max(joint.root_opening / 2, UPRIGHT_FACE_LEAN)
    nodes = [(gap, -joint.depth), (joint.width / 2, 0.0), (HALF_PLATE_WIDTH, 0.0)]
    if joint.root_face > 0:
        nodes.insert(1, (gap + UPRIGHT_FACE_LEAN, joint.root_face - joint.depth))
    return np.array(nodes)


def _lay_bead(joint: HullJoint, section: Array, bead: WeldBead, ripple: float) -> Array:
    """Lay a bead on a section: its toes lie on what is there, and it hides what it covers."""
    flank = _flank_nodes(joint)[:-1]
    half = np.interp(bead.level - joint.depth, flank[:, 1], flank[:, 0])
    share = np.linspace(-1.0, 1.0, BEAD_NODES)
    x = half * (bead.left + (bead.right - bead.left) * (share + 1) / 2)
    low, high = np.interp(x[[0, -1]], *section.T)
    face = low + (high - low) * (share + 1) / 2 + (bead.crown + ripple) * (1 - share**2)

    outside = (section[:, 0] < x[0]) | (section[:, 0] > x[-1])
    before = section[~outside]
    every = np.union1d(x, before[:, 0])
    above = np.interp(every, x, face) - np.interp(every, *section.T)
    cross = np.flatnonzero(above[:-1] * above[1:] < 0)
    share = above[cross] / (above[cross] - above[cross + 1])
    covers = face > np.interp(x, *section.T)
    covers[[0, -1]] = True
    seen = before[:, 1] > np.interp(before[:, 0], x, face)
    crossings = every[cross] + share * (every[cross + 1] - every[cross])
    nodes = np.unique(np.concatenate((x[covers], before[seen, 0], crossings)))
    height = np.maximum(np.interp(nodes, x, face), np.interp(nodes, *section.T))
    k = int(np.count_nonzero(section[:, 0] < x[0]))
    rest = section[outside]
    return np.vstack((rest[:k], np.column_stack((nodes, height)), rest[k:]))


def _bead_ripple(along: float, k: int) -> float:
    """Ripple along bead k at a place, of standard deviation one."""
    lengths = RIPPLE_WAVELENGTHS
    waves = (sin(2 * pi * along / length + 2.4 * k + i) for i, length in enumerate(lengths))
    return sum(waves) * sqrt(2 / len(lengths))
