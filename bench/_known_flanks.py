"""What is known of a groove from before weld was laid in it: not quite where it is now."""

from __future__ import annotations

import math

import numpy as np
from _second_caster import SecondFault, draw_wedge
from _sections import Array
from _steel import MM, Fault, draw

from tjscan.groove.filled import KnownFlanks
from tjscan.groove.section import GrooveSection


def known_flanks(fault: Fault | SecondFault, k: int) -> KnownFlanks:
    """The bare groove of a row's k-th profile, as it was scanned.

    It has closed by 0.7 mm and 0.3 degrees since, and is placed to 0.1 mm and 0.1 degrees; one
    standard deviation each.
    """
    name = fault.name.encode()
    if isinstance(fault, SecondFault):
        wedge = draw_wedge(np.random.default_rng((k, 2, *name)))
        corners, down, out = wedge.corners, -wedge.wall, wedge.leg
        ends = wedge.place("wall", -30 * MM), wedge.place("leg", 40 * MM)
    else:
        g = draw(np.random.default_rng((k, *name)), k, gap=fault.gap, rise=fault.rise)
        corners, down, out = g.corners, -g.wall_cut.forward, g.leg_cut.forward
        ends = g.wall_cut.at(np.array([30 * MM]))[0], g.leg_cut.at(np.array([40 * MM]))[0]
    points = np.vstack((ends[0], corners, ends[1]))
    return moved_flanks(points, down, out, np.random.default_rng((k, 5, *name)))


def flanks_of_section(section: GrooveSection, rng: np.random.Generator) -> KnownFlanks:
    """The same of a bare groove as it was read."""
    points, down, out = (v[..., [0, 2]] for v in (section.points_s, section.wall_s, section.leg_s))
    return moved_flanks(points.copy(), down, out, rng)


def moved_flanks(points: Array, down: Array, out: Array, rng: np.random.Generator) -> KnownFlanks:
    """A bare groove's p1 to p5, shape (5, 2), and tangents where they are when weld is laid in it.

    The wall goes down and the leg out.
    """
    closed, turned = _turn(rng.normal(0, 0.3)), _turn(rng.normal(0, 0.1))
    opened = 0.7 * MM * rng.normal() * np.array((down[1], -down[0]))
    points[:3] = points[1] + (points[:3] - points[1]) @ closed.T + opened
    points = points[3] + (points - points[3]) @ turned.T + 0.1 * MM * rng.normal(size=2)
    return KnownFlanks.of_points(points, turned @ closed @ down, turned @ out)


def _turn(degrees: float) -> Array:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array(((c, -s), (s, c)))
