"""Where beads are aimed at: a pool that the arc's wander moves stays in the groove."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.welding.aims import ARC_WANDER, AimSearch
from tjscan.welding.bead import BeadModel, lay_beads
from tjscan.welding.state import WeldState
from tjscan.welding.target import WeldTarget, remaining_area


def groove_open_at_the_brace() -> WeldState:
    """A steep groove across gravity, filled to its top but for the last bead beside the brace."""
    p3, p4, g, p2 = 1e-3 * np.array(((-1, 0), (2.5, 0), (14, 17), (-11.7, 31)))
    u = np.arange(-25e-3, 25e-3, 0.4e-3)
    wall, leg = p2 + np.array((-20e-3, 10e-3)), g + 2 * (g - p4)
    w = np.tile(np.interp(u, *np.array((wall, p2, p3, p4, leg)).T), (5, 1))
    toes = np.tile((p2[0], g[0]), (5, 1))
    groove = WeldState.of_groove(np.linspace(0.0, 8e-3, 5), u, w, toes, np.full(5, -1.1))
    target = WeldTarget.over(groove, 2e-3)
    laid = target.top - 1.6 * np.maximum(-3.5e-3 - groove.u, 0.0)
    return replace(groove, w=np.where(target.between, np.maximum(w, laid), w))


def test_a_wandering_arc_does_not_lay_the_last_bead_beside_the_groove() -> None:
    state = groove_open_at_the_brace()
    target, width = WeldTarget.over(state, 2e-3), np.full((1, 5), 8.2e-3)
    area = remaining_area(state, target)
    search = AimSearch(BeadModel(), state, target.top, target.chord, area, width)

    def share_in_groove(aim: Array) -> float:
        """The least of what the groove gets of the bead while the arc wanders."""
        shares = []
        for by in (-ARC_WANDER, 0.0, ARC_WANDER):
            laid = lay_beads(
                search.model, state.u, state.w, centre=aim + by, width=width[0], area=area,
                tilt=state.tilt,
            )  # fmt: skip
            left = remaining_area(replace(state, w=laid.w), target)
            shares.append(float(np.min((area - left) / area)))
        return min(shares)

    aims = state.toe_points[:, 0, 0][None] + 2e-3  # the bead itself lies in the groove whole
    kept = search.keep_from_edges(aims, aims, np.ones((1, 5)))
    assert share_in_groove(aims[0]) < 0.2
    assert share_in_groove(kept[0]) == pytest.approx(1.0, abs=0.01)
