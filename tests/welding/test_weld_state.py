"""Metal stays while the groove closes, and lies where the torch truly was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from weld_grooves import torch_trace, v_groove, v_groove_planner, weld_world

from tjscan.core.errors import ConfigurationError
from tjscan.welding.bead import column_widths
from tjscan.welding.shrinkage import ShrinkageModel, close_groove
from tjscan.welding.world import WeldFaults, WeldWorld, correlated_noise


def one_bead(faults: WeldFaults, seed: int = 1) -> WeldWorld:
    state = v_groove()
    world = weld_world(state, faults, seed)
    world.weld(torch_trace(v_groove_planner(state).next_bead()))
    return world


def test_closing_keeps_the_metal_and_moves_the_left_side_alone() -> None:
    world = one_bead(WeldFaults())
    state = world.state
    by, turn = np.full(len(state.s), 0.4e-3), np.full(len(state.s), 2e-3)
    u, base, w = close_groove(state.u, state.base, state.w, by, turn)
    area = np.sum(column_widths(u) * (w - base), axis=1)
    np.testing.assert_allclose(area, state.metal_area, rtol=1e-12)
    np.testing.assert_array_equal(u[:, -30:], state.u[:, -30:])
    # A turn about the root: the way across grows with the height.
    moved = u[:, 0] - state.u[:, 0]
    pivot = state.base.min(axis=1)
    np.testing.assert_allclose(moved, 0.4e-3 + 2e-3 * (state.base[:, 0] - pivot), rtol=1e-9)
    assert (np.diff(u, axis=1) > 0).all()


def test_shrinkage_grows_with_the_logarithm_of_the_metal() -> None:
    model = ShrinkageModel()
    first = np.full(3, 30e-6)
    found = model.transverse(np.array((30e-6, 300e-6, 3000e-6)), first)
    np.testing.assert_allclose(found, (0.7e-3, 1.4e-3, 2.1e-3))
    assert model.transverse(np.zeros(1), np.zeros(1)) == 0


def test_areas_laid_are_those_of_wire_and_speed() -> None:
    state = v_groove()
    world = weld_world(state, WeldFaults())
    bead = v_groove_planner(state).next_bead()
    added = world.weld(torch_trace(bead))
    wire = 0.25 * np.pi * world.wire_diameter**2 * world.efficiency
    ends = world.model.area_along_bead(bead.s - bead.s[0], bead.s[-1] - bead.s)
    np.testing.assert_allclose(added, wire * bead.feed / bead.speed * ends, rtol=1e-9)
    np.testing.assert_allclose(added, world.state.metal_area, rtol=1e-12)


def test_metal_lies_where_the_torch_was_not_where_it_was_to_be() -> None:
    def centre(world: WeldWorld) -> float:
        state = world.state
        weights = column_widths(state.u) * (state.w - state.base)
        return float(np.sum(weights * state.u) / weights.sum())

    right, left = (one_bead(WeldFaults(offset=x)) for x in (0.5e-3, -0.5e-3))
    assert centre(right) - centre(left) > 0.15e-3  # the groove centres them
    assert one_bead(WeldFaults(gain=0.03)).state.metal_area == pytest.approx(
        1.03 * one_bead(WeldFaults()).state.metal_area
    )


def test_closed_groove_is_welded_across_its_end() -> None:
    state = v_groove()
    period = float(state.s[-1] + 2e-3)
    world = replace(weld_world(state, WeldFaults()), period=period)
    trace = torch_trace(v_groove_planner(state).next_bead())
    world.weld(replace(trace, s=trace.s + 0.5 * period))
    # From the last station to the first one there is a step on which no station lies.
    assert np.count_nonzero(world.state.metal_area == 0) <= 1
    np.testing.assert_array_equal(world.state.s, state.s)


def test_what_wanders_goes_on_over_the_end_of_a_closed_groove() -> None:
    state = v_groove()
    state = replace(state, s=state.s, w=np.tile(state.w[20], (41, 1)))
    period = float(state.s[-1] + 2e-3)
    world = replace(weld_world(state, WeldFaults(slip=0.1)), period=period)
    trace = torch_trace(v_groove_planner(v_groove()).next_bead())
    even = {"speed": 0 * trace.speed + 5e-3, "feed": 0 * trace.feed + 0.15}
    area = world.weld(replace(trace, s=trace.s + 0.5 * period, **even))
    inner = np.r_[area[-5:], area[:5]]  # ignition and crater lie in the middle
    assert abs(inner[5] - inner[4]) < 3 * np.abs(np.diff(area[:15])).mean()


def test_noise_has_its_spread_and_its_length() -> None:
    s = np.arange(0, 400, 2e-3)
    noise = correlated_noise(s, 0.03, 0.5, np.random.default_rng(2))
    assert noise.std() == pytest.approx(0.5, rel=0.02)
    assert np.corrcoef(noise[15:], noise[:-15])[0, 1] == pytest.approx(np.exp(-1), abs=0.03)


def test_torch_at_rest_is_refused() -> None:
    world = weld_world(v_groove(), WeldFaults())
    trace = torch_trace(v_groove_planner(v_groove()).next_bead())
    with pytest.raises(ConfigurationError, match="needs wire and has to move"):
        world.weld(replace(trace, speed=0 * trace.speed))
