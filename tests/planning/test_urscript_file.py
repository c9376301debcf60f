"""The program for the arm, run on the loopback controller: path, speed, and the arc's output."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plates import half_v
from ringed_grooves import edges_of
from ur_cell import HOME, KINEMATICS

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse_pose, pose
from tjscan.planning.lay import PlannedBead
from tjscan.planning.plan import WeldPlan, plan_weld
from tjscan.planning.urscript import BeadPath, StationPath, path_to_urscript
from tjscan.planning.wps import read_wps
from tjscan_loopback.ur.controller import LoopbackController

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "wps.toml"
OUTPUT = 3
HZ = 125.0
OFF_PATH = 0.2e-3
OFF_SPEED = 0.02
ENDS = 10e-3
"""Metres at either end of a bead where the arm gains speed and loses it."""


def small_plan() -> WeldPlan:
    """The first bead of a straight groove of 60 mm."""
    flat = half_v()
    corners = np.stack(
        np.broadcast_arrays(np.linspace(0, 0.06, 8)[:, None], flat[:, 0], flat[:, 1]), axis=2
    )
    wps = read_wps(EXAMPLE).model_copy(update={"start_stop": None})
    plan = plan_weld(edges_of(corners), wps, np.array((0.0, -1.0, 0.0)))
    return replace(plan, beads=plan.beads[:1])


def run(plan: WeldPlan, *, arc: bool) -> tuple[Array, Array, Array]:
    """Tip of the wire, shape (n, 3), and the output at every tick; and the bead's points."""
    tcp = plan.wps.torch.tcp.T
    bead: PlannedBead = plan.beads[0]
    over = bead.T_r_torch[0] @ pose(p=(0.0, 0.0, -plan.wps.torch.retract))
    T_b_r = KINEMATICS.forward(HOME) @ tcp @ inverse_pose(over)
    back = pose(p=(0.0, 0.0, -plan.wps.torch.retract))
    path = T_b_r @ bead.T_r_torch
    one = BeadPath(
        bead,
        np.array([path[0] @ back, path[0]]),
        path,
        (path[-1] @ back)[None],
    )
    script = path_to_urscript(StationPath("a", HOME, (one,)), plan.wps, OUTPUT, arc=arc)
    told: list[str] = []
    controller = LoopbackController(KINEMATICS, HOME, hz=HZ, fast=False, report_line=told.append)
    controller.start_script(script)
    tips, outputs = [], []
    for _ in range(int(60 * HZ)):
        controller.advance_one_tick()
        controller.resume_program()  # an operator who lets each hold go at once
        tips.append((KINEMATICS.forward(controller.q) @ tcp)[:3, 3])
        outputs.append(bool(controller.digital_outputs >> OUTPUT & 1))
        if told[-1] == "program stopped":
            break
    assert not [line for line in told if "failed" in line]
    return np.array(tips), np.array(outputs), path[:, :3, 3]


def test_the_written_program_follows_the_bead_with_the_arc_on_on_it_alone() -> None:
    plan = small_plan()
    tips, on, points = run(plan, arc=True)
    way = points[-1] - points[0]
    length = float(np.linalg.norm(way))
    along = (tips - points[0]) @ way / length
    off = np.linalg.norm(tips - points[0] - along[:, None] * way / length, axis=1)
    assert on.any()
    assert off[on].max() <= OFF_PATH
    assert along[on].min() == pytest.approx(0, abs=OFF_PATH)
    assert along[on].max() == pytest.approx(length, abs=OFF_PATH)
    speed = HZ * np.diff(along)
    even = on[1:] & (along[1:] > ENDS) & (along[1:] < length - ENDS)
    np.testing.assert_allclose(speed[even], plan.beads[0].speed.mean(), rtol=OFF_SPEED)
    assert off[np.logical_not(on)].max() >= 0.5 * plan.wps.torch.retract


def test_without_being_told_the_program_never_switches_the_arc_on() -> None:
    plan = small_plan()
    tips, on, points = run(plan, arc=False)
    assert not on.any()
    assert np.linalg.norm(tips - points[-1], axis=1).min() <= OFF_PATH


def test_a_woven_bead_swings_as_far_and_as_often_as_its_segments_say() -> None:
    """Read from the written program: its points beside the bead's line, and when it is there."""
    plan, swing = small_plan(), 1.5e-3
    bead = plan.beads[0]
    now = bead.at_points
    weave = np.linspace(swing, 0.5 * swing, len(now.s))
    bead = bead.with_segments(replace(now, weave=weave), plan.wps)
    path = bead.T_r_torch
    one = BeadPath(bead, path[:1], path, path[-1:])
    script = path_to_urscript(StationPath("a", HOME, (one,)), plan.wps, OUTPUT, arc=False)
    lines = [line for line in script.splitlines() if "movep" in line]
    numbers = np.array([[float(x) for x in re.findall(r"-?\d+\.\d+", line)] for line in lines])
    tips = np.concatenate((bead.points[:1], numbers[:, :3]))
    steps = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    times = np.append(0.0, np.cumsum(steps / numbers[:, 7]))
    assert times[-1] == pytest.approx(bead.arc_time, rel=1e-3)
    aside = (tips - bead.points[0]) @ path[0, :3, 1]
    along = np.interp(times, bead.times, bead.s)
    right = aside > 1e-4
    np.testing.assert_allclose(aside[right], np.interp(along, bead.s, weave)[right], rtol=1e-3)
    blends = np.append(0.0, numbers[:-1, 8])
    before, after = np.diff(tips, axis=0)[:-1], np.diff(tips, axis=0)[1:]
    turned = np.sum(before * after, axis=1) < np.cos(np.radians(12)) * steps[:-1] * steps[1:]
    assert turned.sum() > 4
    assert (blends[1:][turned] == 0).all()
    settings = plan.wps.weave
    assert settings is not None
    starts = times[1:][right[1:] & ~right[:-1]]
    np.testing.assert_allclose(np.diff(starts), settings.period, atol=1e-3)


def test_a_bead_moved_by_a_table_lays_what_its_feed_and_speed_bring() -> None:
    plan = small_plan()
    bead = plan.beads[0]
    now = bead.at_points
    moved = bead.with_segments(
        replace(now, offset=now.offset + 1e-3, height=now.height + 2e-3, speed=2 * now.speed),
        plan.wps,
    )
    away = moved.points - bead.points
    np.testing.assert_allclose(np.sum(away * bead.T_r_torch[:, :3, 1], axis=1), 1e-3)
    np.testing.assert_allclose(np.sum(away * bead.T_r_torch[:, :3, 2], axis=1), -2e-3)
    np.testing.assert_allclose(moved.area, 0.5 * bead.area)
    np.testing.assert_allclose(moved.heat, 0.5 * bead.heat)
    back = moved.with_segments(bead.segments, plan.wps)
    np.testing.assert_allclose(back.points, bead.points, atol=1e-15)


def test_speed_follows_no_feed_that_is_not_set() -> None:
    plan = small_plan()
    bead = plan.beads[0]
    path, now = bead.T_r_torch, bead.at_points
    slower = bead.with_segments(replace(now, feed=0.8 * now.feed), plan.wps)
    two = [BeadPath(one, path[:1], path, path[-1:]) for one in (bead, replace(slower, number=2))]
    script = path_to_urscript(StationPath("a", HOME, tuple(two)), plan.wps, OUTPUT, arc=True)
    feeds = [f"{one.bead.feed[0] * 60:.2f} m/min" for one in two]
    assert f"begins with {feeds[0]}" in script
    beads = script.split("# bead ")[1:]
    for feed, lines in zip(feeds, beads, strict=True):
        hold, strike = lines.index("popup"), lines.index(f"out({OUTPUT}, True)")
        assert lines[hold:].startswith(f'popup("go on when the wire feed is set to {feed}"')
        assert hold < strike
    varies = replace(now, feed=now.feed * np.linspace(1.0, 0.8, len(now.s)))
    one = BeadPath(bead.with_segments(varies, plan.wps), path[:1], path, path[-1:])
    with pytest.raises(ConfigurationError, match=r"along bead 1.*crater_feed") as refused:
        path_to_urscript(StationPath("a", HOME, (one,)), plan.wps, OUTPUT, arc=True)
    assert refused.value.key == "start_stop.crater_feed"
    dry = path_to_urscript(StationPath("a", HOME, (one,)), plan.wps, OUTPUT, arc=False)
    assert "popup" not in dry


def test_an_operator_lets_each_layer_go_on_when_the_other_station_has_welded_it() -> None:
    plan = small_plan()
    bead = plan.beads[0]
    path = bead.T_r_torch
    beads = [
        BeadPath(replace(bead, number=k, layer=layer), path[:1], path, path[-1:])
        for k, layer in ((1, 1), (2, 2), (3, 2), (4, 3))
    ]
    for before, after, says in (
        ((), ("b",), ("b has welded layer 1 and layer 1 is released", "b has welded layer 2")),
        (
            ("b",),
            (),
            (
                "layer 1 and the wire feed",
                "layer 2 and layer 1 is released",
                "b has welded layer 3",
            ),
        ),
        ((), (), ("layer 1 is released",)),
    ):
        whole = StationPath("a", HOME, tuple(beads), before, after)
        lines = path_to_urscript(whole, plan.wps, OUTPUT, arc=True).splitlines()
        holds = [line for line in lines if "popup" in line]
        says = says if before else ("the wire feed is set", *says)
        assert len(holds) == len(says)
        assert all(one in line for one, line in zip(says, holds, strict=True))
        assert sum("sleep(60)" in line for line in lines) == 3
