"""A station's way as a program in URScript: the tip's path, its speeds, and the output of the arc.

The words are those that `docs/ur.md` lists. No arm has run such a file. A real controller lets no
two blends overlap (its manual), keeps to the speed through a blend with ``movep`` alone, and stops
with an error where the tool turns back in one: blends here are a fifth of the shorter step beside
them, and chords meet at 2 degrees at most.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.core.pose_vector import pose_to_vector
from tjscan.planning.bead import PlannedBead
from tjscan.planning.wps import TorchSettings

BLEND: Final = 0.2
"""Radius of a blend as a share of the shorter step beside it: blends never touch."""

ACCELERATION: Final = 0.5
"""m/s²."""

WAY_SPEED: Final = 0.05
"""m/s, between beads."""

JOINT_SPEED: Final = 0.2
"""rad/s of the leading joint, to where the first bead begins."""


@dataclass(frozen=True, slots=True, eq=False)
class BeadWay:
    """How an arm leads the torch to a bead, along it, and away.

    Parameters
    ----------
    bead : PlannedBead
        The bead, or a station's part of it.
    way : ndarray, shape (k, 4, 4)
        Poses of the wire's tip on the way to where it starts, the last one there; in frame b.
    path : ndarray, shape (q, 4, 4)
        At each of its points.
    leave : ndarray, shape (l, 4, 4)
        On the way off its end.
    """

    bead: PlannedBead
    way: Array
    path: Array
    leave: Array


@dataclass(frozen=True, slots=True, eq=False)
class StationWay:
    """How the arm of a station leads the torch along all of its beads.

    Parameters
    ----------
    station : str
        Its name.
    q : ndarray, shape (6,)
        Joint angles at the first pose, radians.
    beads : tuple of BeadWay
        In the order of welding.
    """

    station: str
    q: Array
    beads: tuple[BeadWay, ...]


def way_to_urscript(way: StationWay, torch: TorchSettings, output: int, *, arc: bool) -> str:
    """Write a station's way as a URScript program.

    Parameters
    ----------
    way : StationWay
        The way.
    torch : TorchSettings
        The torch.
    output : int
        Number of the standard digital output that switches the arc.
    arc : bool
        Whether it is switched on on the beads; else it stays off throughout.
    """
    joints = ", ".join(f"{x:.7f}" for x in way.q)
    lines = [
        "def tjscan_plan():",
        "  # in the arm's base frame: metres, rotation vectors in radians",
        f"  # wire feed is not set here; the arc is {'switched' if arc else 'never switched on'}",
        f"  set_standard_digital_out({output}, False)",
        f"  set_tcp({_pose(torch.tcp.T)})",
        "  # nobody has checked the way from where the arm stands to here",
        f"  movej([{joints}], a={ACCELERATION}, v={JOINT_SPEED})",
    ]
    for one in way.beads:
        lines.append(f"  # bead {one.bead.number}: {one.bead.kind}, layer {one.bead.layer}")
        lines += _way(one.way)
        lines += _bead(one, output, arc=arc)
        lines += _way(one.leave)
    return "\n".join((*lines, "end", ""))


def _bead(one: BeadWay, output: int, *, arc: bool) -> Iterator[str]:
    if arc:
        yield f"  set_standard_digital_out({output}, True)"
    bead, steps = one.bead, one.bead.path_steps
    for i, T in enumerate(one.path[1:], start=1):
        # A step has one speed: that between its ends.
        speed = 2 / (1 / bead.speed[i - 1] + 1 / bead.speed[i])
        blend = BLEND * min(steps[i - 1], steps[i]) if i < len(steps) else 0.0
        yield f"  movep({_pose(T)}, a={ACCELERATION}, v={speed:.6f}, r={blend:.6f})"
    yield f"  set_standard_digital_out({output}, False)"


def _way(poses: Array | Sequence[Array]) -> Iterator[str]:
    for T in poses:
        yield f"  movel({_pose(T)}, a={ACCELERATION}, v={WAY_SPEED})"


def _pose(T: Array) -> str:
    return f"p[{', '.join(f'{x:.7f}' for x in np.asarray(pose_to_vector(T)))}]"
