"""The plan as a program in URScript: the tip's path with its speeds, and the output of the arc.

The words are those that `docs/ur.md` lists. No arm has run such a file.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from tjscan.core.frames import Array, pose
from tjscan.core.pose_vector import pose_to_vector
from tjscan.planning.bead import PlannedBead
from tjscan.planning.plan import WeldPlan

BLEND: Final = 0.2
"""Radius of a blend as a share of the shorter step beside it: blends never touch."""

ACCELERATION: Final = 0.5
"""m/s²."""

WAY_SPEED: Final = 0.05
"""m/s, between beads."""


def plan_to_urscript(plan: WeldPlan, T_b_r: Array, output: int, *, arc: bool) -> str:
    """Write the plan as a URScript program.

    Between beads the torch is drawn back along the wire, and goes back over the bead it has laid,
    never straight across: the brace may stand there.

    Parameters
    ----------
    plan : WeldPlan
        The plan.
    T_b_r : ndarray, shape (4, 4)
        Pose of the sections' frame in the arm's base frame.
    output : int
        Number of the standard digital output that switches the arc.
    arc : bool
        Whether it is switched on on the beads; else it stays off throughout.
    """
    lines = [
        "def tjscan_plan():",
        f"  # wire feed is not set here; the arc is {'switched' if arc else 'never switched on'}",
        f"  set_standard_digital_out({output}, False)",
        f"  set_tcp({_pose(plan.wps.torch.tcp.T)})",
    ]
    back = pose(p=(0.0, 0.0, -plan.wps.torch.retract))
    before: PlannedBead | None = None
    for bead in plan.beads:
        T = T_b_r @ bead.T_r_torch
        if before is not None:
            way = (T_b_r @ before.T_r_torch @ back)[::-1]
            lines += _way(way[_every(before, plan.wps.torch.retract)])
        lines.append(f"  # bead {bead.number}: {bead.kind}, layer {bead.layer}")
        lines += _way([T[0] @ back, T[0]])
        lines += _bead(bead, T, output, arc=arc)
        lines += _way([T[-1] @ back])
        before = bead
    return "\n".join((*lines, "end", ""))


def _bead(bead: PlannedBead, T: Array, output: int, *, arc: bool) -> Iterator[str]:
    if arc:
        yield f"  set_standard_digital_out({output}, True)"
    steps = bead.path_steps
    for i in range(1, len(T)):
        # A step has one speed: that between its ends.
        speed = 2 / (1 / bead.speed[i - 1] + 1 / bead.speed[i])
        blend = BLEND * min(steps[i - 1], steps[i]) if i < len(T) - 1 else 0.0
        yield f"  movep({_pose(T[i])}, a={ACCELERATION}, v={speed:.6f}, r={blend:.6f})"
    yield f"  set_standard_digital_out({output}, False)"


def _way(poses: Array | Sequence[Array]) -> Iterator[str]:
    for T in poses:
        yield f"  movel({_pose(T)}, a={ACCELERATION}, v={WAY_SPEED})"


def _every(bead: PlannedBead, distance: float) -> slice:
    """Points of a bead about half a distance apart: the way back needs no more."""
    mean = bead.length / (len(bead.s) - 1)
    return slice(None, None, max(1, int(0.5 * distance / mean)))


def _pose(T: Array) -> str:
    return f"p[{', '.join(f'{x:.7f}' for x in np.asarray(pose_to_vector(T)))}]"
