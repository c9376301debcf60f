"""Replanning: volume is carried over, faults are filled and learnt, and odd looks are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from weld_grooves import example_wps, torch_trace, v_groove, v_groove_planner, weld_world

from tjscan.core.errors import LookRefused
from tjscan.core.frames import Array
from tjscan.welding.learning import ScalarFilter, WeldLearner
from tjscan.welding.replan import GroovePart, WeldPlanner
from tjscan.welding.target import WeldTarget, remaining_area
from tjscan.welding.world import WeldFaults, WeldWorld

FAULTS = WeldFaults(gain=-0.04, offset=0.5e-3, wander=0.3e-3, shrinkage=0.25)
SURE = np.full(41, 0.05e-3)
EVERYWHERE = np.ones(41, dtype=bool)


def weld_all(
    faults: WeldFaults, *, looks: bool, seed: int = 1, every: int = 1
) -> tuple[WeldWorld, WeldPlanner]:
    state = v_groove().part(slice(None, None, every))
    n = len(state.s)
    world, planner = weld_world(state, faults, seed), v_groove_planner(state)
    for _ in range(6):
        bead = planner.next_bead()
        world.weld(torch_trace(bead))
        planner.after_bead(bead)
        if looks:
            planner.take_look(world.state.u, world.state.w, SURE[:n], EVERYWHERE[:n])
    return world, planner


@pytest.mark.parametrize("every", [1, 2, 3])
def test_the_wire_offset_is_learnt_however_far_apart_the_stations_of_a_weld_are(every: int) -> None:
    _, planner = weld_all(replace(FAULTS, wander=0.0), looks=True, every=every)
    assert planner.deviation is not None
    assert planner.learner.offset.value == pytest.approx(FAULTS.offset, abs=0.2e-3)


def fill_error(world: WeldWorld) -> Array:
    """Mean height over the target, ends apart, metres."""
    target = WeldTarget.over(world.state, 1.5e-3)
    width = np.diff(world.state.toe_points[:, :, 0], axis=1)[:, 0]
    return np.asarray(-remaining_area(world.state, target) / width)[8:-8]


def test_without_faults_belief_and_world_agree() -> None:
    world, planner = weld_all(WeldFaults(), looks=False)
    np.testing.assert_allclose(planner.belief.w, world.state.w, atol=1e-9)
    assert np.abs(fill_error(world)).max() < 0.25e-3


def test_looks_fill_what_faults_left_and_teach_them() -> None:
    off = np.zeros((2, 4))
    for seed in range(4):
        blind, _ = weld_all(FAULTS, looks=False, seed=seed)
        seeing, planner = weld_all(FAULTS, looks=True, seed=seed)
        assert np.sqrt(np.mean(fill_error(seeing) ** 2)) < 0.1e-3
        off[:, seed] = [np.abs(fill_error(one)).mean() for one in (blind, seeing)]
        learnt = planner.learner
        assert learnt.gain.value == pytest.approx(0.96, abs=0.015)
        assert learnt.offset.value == pytest.approx(0.5e-3, abs=0.3e-3)
        assert learnt.shrinkage.value == pytest.approx(1.25, rel=0.1)
    assert off[0].mean() > 2.5 * off[1].mean()


def test_every_sample_is_inside_the_procedure_and_the_rest_is_carried_over() -> None:
    planner = v_groove_planner(v_groove())
    wps = example_wps()
    bead = planner.next_bead()
    assert bead.area + bead.carried == pytest.approx(bead.wanted)
    assert np.abs(bead.carried).max() < 1e-12
    # Far too little to lay: the fastest bead is laid, and too much is named.
    state = planner.belief
    low = v_groove_planner(replace(state, w=np.maximum(state.w, 11e-3)))
    bead = low.next_bead()
    for values, window in (
        (bead.speed, wps.arc.travel_speed),
        (bead.feed, wps.arc.wire_feed),
        (bead.heat_input, wps.arc.heat_input),
    ):
        assert (values >= window[0] * (1 - 1e-9)).all()
        assert (values <= window[1] * (1 + 1e-9)).all()
    assert bead.is_at_limit.all()
    assert (bead.carried < 0).all()


def test_a_stretch_that_is_not_read_stays_believed() -> None:
    state = v_groove()
    world, planner = weld_world(state, FAULTS), v_groove_planner(state)
    bead = planner.next_bead()
    world.weld(torch_trace(bead))
    planner.after_bead(bead)
    believed, read = planner.belief.w.copy(), EVERYWHERE.copy()
    read[10:20] = False
    planner.take_look(world.state.u, world.state.w, SURE, read)
    np.testing.assert_allclose(planner.belief.w[12:18], believed[12:18], atol=1e-6)


def test_looks_that_cannot_be_of_this_weld_are_refused() -> None:
    state = v_groove()
    world, planner = weld_world(state, WeldFaults()), v_groove_planner(state)
    for k in range(2):
        bead = planner.next_bead()
        world.weld(torch_trace(bead))
        planner.after_bead(bead)
        if k == 0:
            planner.take_look(world.state.u, world.state.w, SURE, EVERYWHERE)
            first = world.state
    now = world.state
    for u, w, read, reason in (
        (first.u, first.w, EVERYWHERE, "older than the last bead"),
        (now.u + 4e-3, now.w, EVERYWHERE, "another joint"),
        (now.u, now.base, EVERYWHERE, "lower than before|older"),
        (now.u, now.w, ~EVERYWHERE, "nothing read"),
    ):
        before = planner.belief
        with pytest.raises(LookRefused, match=reason):
            planner.take_look(u, w, SURE, read)
        assert planner.belief is before
    planner.take_look(now.u, now.w, SURE, EVERYWHERE)


def test_filter_is_the_weighted_mean() -> None:
    found = ScalarFilter(1.0, 0.3).update(2.0, 0.3)
    assert found.value == pytest.approx(1.5)
    assert found.sigma == pytest.approx(0.3 / np.sqrt(2))


def test_beads_have_the_heat_that_their_arcs_showed() -> None:
    planner = v_groove_planner(v_groove())
    bead = planner.next_bead()
    planner.after_bead(bead, heat_input=1.2 * bead.heat_input)
    assert planner.power_ratio == pytest.approx(1.2)
    following = planner.next_bead()
    usual = example_wps().heat_input(following.feed, following.speed)
    np.testing.assert_allclose(following.heat_input, 1.2 * usual)
    planner.after_bead(following, heat_input=following.heat_input)
    assert planner.power_ratio == pytest.approx(1.2)
    cold = v_groove_planner(v_groove())
    cold.after_bead(bead)
    wide, narrow = (
        np.ptp(np.flatnonzero((one.belief.w - one.belief.base)[20] > 1e-5))
        for one in (planner, cold)
    )
    assert wide > narrow


def test_offset_is_learnt_from_the_stations_that_show_it() -> None:
    rng = np.random.default_rng(5)
    sensitivity = rng.uniform(0.3, 1.0, 40)
    beside = 0.4e-3 * sensitivity + 0.05e-3 * rng.standard_normal(40)
    runs_aside = np.arange(40) % 8 == 0
    sensitivity[runs_aside], beside[runs_aside] = 6.0, -4e-3
    learner, none, level = WeldLearner(), np.zeros(40), np.zeros((2, 40))
    seen = learner.learn_offset(beside, none, sensitivity, level)
    assert seen is not None
    assert seen.value == pytest.approx(0.4e-3, abs=0.05e-3)
    assert seen.sigma > 0.1e-3
    assert 0.2e-3 < learner.offset.value < 0.4e-3
    hidden = WeldLearner()
    assert hidden.learn_offset(beside[:3], none[:3], sensitivity[:3], level[:, :3]) is None
    assert hidden.offset.value == 0.0


@pytest.mark.parametrize("wrong", [(0.0, 0.0), (0.6, -1.0), (-0.4, 0.5)])
def test_offset_is_told_from_pools_that_run_aside_otherwise_than_the_model_has_it(
    wrong: tuple[float, float],
) -> None:
    """Beads on the left slope run to the right, those on the right one to the left; the wire is
    led by what was learnt, and the last beads lie where they were to be."""
    errors, ends, misses = [], [], []
    for seed in range(20):
        rng, learner = np.random.default_rng(seed), WeldLearner()
        true = 0.5e-3 * rng.choice((-1, 1))
        for bead in range(15):
            sensitivity = rng.uniform(0.4, 0.8) + 0.05 * rng.standard_normal(30)
            run = 1e-3 * (1.0, -1.0, 0.0)[bead % 3] * rng.uniform(0.5, 1.5)
            runs = np.tile([[run], [-0.3e-3 * rng.uniform(0.3, 1.7)]], 30)
            led = learner.lead(sensitivity, runs)
            own = 0.05e-3 * rng.standard_normal() + 0.1e-3 * rng.standard_normal(30)
            beside = sensitivity * (true - led) + wrong @ runs + own
            known = learner.offset.value
            seen = learner.learn_offset(beside, led, sensitivity, runs)
            assert seen is not None
            misses.append((seen.value - (true - known)) / seen.sigma)
        errors.append((learner.offset.value - true) / learner.offset.sigma)
        ends.append(float(np.mean(beside)))
    assert np.mean(np.square(errors)) < 2
    assert np.mean(np.abs(misses) < 1.96) > 0.9
    assert np.sqrt(np.mean(np.square(ends))) < 0.15e-3


def test_bead_in_two_parts_is_believed_as_it_lies() -> None:
    """Two arcs lay a bead, one on each side of a border: speeds make up for starts and craters."""
    state = v_groove()
    planner, world = v_groove_planner(state), weld_world(state, WeldFaults())
    bead = planner.next_bead()
    bead = replace(bead, speed=0 * bead.s + 5.5e-3)
    area = planner.wps.deposition_rate(bead.feed) / bead.speed
    length = float(state.s[-1])
    border = 0.47 * length  # between two stations
    set_area = np.zeros_like(bead.s)
    for begin, end in ((0.0, border), (border, length)):
        arc = planner.for_arc(bead, begin, end)
        assert arc.speed[0] > np.interp(begin, bead.s, bead.speed)
        assert arc.speed[-1] < np.interp(end, bead.s, bead.speed)
        wps = planner.wps.arc
        assert (wps.travel_speed[0] <= arc.speed).all() & (arc.speed <= wps.travel_speed[1]).all()
        world.weld(torch_trace(arc))
        on = (bead.s >= begin) & (bead.s <= end)
        s = bead.s[on]
        feed, speed = (np.interp(s, arc.s, row) for row in (arc.feed, arc.speed))
        set_area[on] += planner.area_of_arc(s, (begin, end), feed, speed)
    planner.after_bead(bead, set_area)
    np.testing.assert_allclose(planner.belief.metal_area, world.state.metal_area, rtol=1e-9)
    near = np.abs(bead.s - border) < 8e-3
    off = np.abs(world.state.metal_area / area - 1)[near]
    assert off.max() < 0.05  # a crater alone lacks a third


def test_an_arc_that_goes_on_beyond_a_beads_stations_makes_up_for_its_ends() -> None:
    planner = v_groove_planner(v_groove())
    bead, s = planner.next_bead().part(slice(3, -3)), planner.belief.s
    arc, ends = planner.for_arc(bead, s[0], s[-1]), (s[0], s[-1])
    assert arc.s[[0, -1]] == pytest.approx(ends)
    led = arc.at(bead.s)
    area = planner.area_of_arc(bead.s, ends, led.feed, led.speed)
    np.testing.assert_allclose(area, bead.area, rtol=0.02)


def test_parts_of_a_groove_are_planned_and_welded_as_the_whole_of_it() -> None:
    state = v_groove()
    whole, parted = v_groove_planner(state), v_groove_planner(state)
    bead = whole.next_bead()
    whole.after_bead(bead)
    halves = [GroovePart(rows, state.s[rows]) for rows in (np.arange(25), np.arange(25, 41))]
    for part in halves:
        parted.done = 0
        planned = parted.next_bead(part)
        inner = slice(6, -6)
        np.testing.assert_allclose(planned.area[inner], bead.area[part.rows][inner], rtol=2e-2)
        ends = float(state.s[0]), float(state.s[-1])
        area = parted.area_of_arc(part.s, ends, bead.feed[part.rows], bead.speed[part.rows])
        parted.after_bead(bead.part(part.rows), area, part=part)
    # Toes of a pool move together over a few millimetres: the border alone differs.
    away = np.abs(np.arange(41) - 24.5) > 6
    np.testing.assert_allclose(parted.belief.w[away], whole.belief.w[away], atol=1e-5)
    np.testing.assert_allclose(parted.belief.metal_area, whole.belief.metal_area, rtol=1e-9)
    np.testing.assert_array_equal(parted.belief.s, state.s)
