"""The whole way is looked at before anything moves, and a refusal says what touches what."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Self

import numpy as np
import pytest
from cells import CLOCKWISE, EXAMPLES, PAPER, Notes
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.config import table_to_dict
from tjscan.core.devices import DeviceBase
from tjscan.core.errors import ArmFault, ConfigurationError, PathBlocked, PoseUnreachable
from tjscan.core.frames import Array, pose, rot_y, rot_z, transform_points
from tjscan.job.cell import clear_path_planner_of_job
from tjscan.job.files import read_scan_job
from tjscan.robot.arm import Arm, ArmState
from tjscan.robot.clearance import PATH_CHECK_RESOLUTION, ClearPathPlanner
from tjscan.robot.collision import (
    SCANNED_GROOVE_NAME,
    CollisionModel,
    PlacedBody,
    bodies_of_arm,
    check_ignored_links,
)
from tjscan.robot.collision_checked import LARGEST_TURN_FROM_NEAR_JOINTS, CollisionCheckedArm
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import interpolate_joints, linear_waypoints
from tjscan.robot.settings import Box, Capsule, ClearanceMargins, Cylinder, Solid
from tjscan.robot.simulated import SimulatedArm
from tjscan.robot.urdf import ARM_MODELS
from tjscan.runs.scan.rehearsal import check_scan_job
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.journal import ScannedSurfaceObstacle, StopReason, grid_triangles

HOME = np.radians([0, -80, 110, -120, -90, 0])
"""Before the arm, the flange looking down."""

WELL_DEG = {
    "kr5_arc": [10, -80, 80, 0, 60, 20],
    "irb1600_10_145": [10, 10, 10, 0, 60, 20],
    "m10ia": [10, 10, 0, 0, -60, 20],
}
"""Of arms with a spherical wrist, the elbow up and the flange looking ahead and down."""

EXACT = 1e-6
"""Metres: coal's own tolerance, and more."""


@cache
def kinematics() -> Kinematics:
    return Kinematics.load("ur10e")


def aside(y: float, z: float = 0.0) -> Array:
    """The flange moved from HOME, in metres along b."""
    T_b_f = kinematics().forward(HOME)
    return pose(T_b_f[:3, :3], T_b_f[:3, 3] + (0.0, y, z))


TIP = Solid("sensor", Box((0.08, 0.08, 0.1)), pose(p=(0.0, 0.0, 0.06)))


def post(height: float, *, y: float = 0.25) -> Solid:
    """A wall between HOME and what lies 0.5 m aside, its top `height` above the flange."""
    x, _, z = kinematics().forward(HOME)[:3, 3]
    return Solid(
        "post",
        Box((0.3, 0.04, 1.0)),
        pose(p=(x, kinematics().forward(HOME)[1, 3] + y, z + height - 0.5)),
    )


def clearance(
    *solids: Solid, tool: tuple[Solid, ...] = (TIP,), margin: float = 0.01
) -> ClearPathPlanner:
    return ClearPathPlanner(
        kinematics(), CollisionModel(kinematics(), solids, tool), ClearanceMargins(solids=margin)
    )


class Spy(DeviceBase):
    """Notes what an arm is told."""

    def __init__(self, arm: SimulatedArm) -> None:
        self.arm = arm
        self.told: list[tuple[str, Array]] = []

    def __enter__(self) -> Self:
        self.arm.__enter__()
        return self

    def __exit__(self, *reason: object) -> None:
        self.arm.stop()

    def state(self) -> ArmState:
        return self.arm.state()

    def check_moves(self, *T_b_f: Array) -> None:
        self.told += [("check", T) for T in T_b_f]
        self.arm.check_moves(*T_b_f)

    def move_linear(self, T_b_f: Array) -> ArmState:
        self.told.append(("linear", T_b_f))
        return self.arm.move_linear(T_b_f)

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        self.told.append(("joint", T_b_f))
        return self.arm.move_joint_to_pose(T_b_f, near, direct=direct)

    def stop(self) -> None:
        self.arm.stop()

    def accept_moves_again(self) -> None:
        self.arm.accept_moves_again()


def spied(
    keeps: ClearPathPlanner, *, lifts: tuple[float, ...] = (0.05, 0.1, 0.2)
) -> tuple[CollisionCheckedArm, Spy]:
    spy = Spy(SimulatedArm(kinematics(), HOME))
    arm: Arm = spy
    return CollisionCheckedArm(arm, keeps, np.eye(4), lifts=lifts), spy


def test_a_sphere_like_body_is_as_far_away_as_it_is() -> None:
    ball = Solid("ball", Capsule(0.05, 1e-6), pose(p=(2.0, 0.0, 0.3)))
    tip = Solid("tip", Capsule(0.02, 1e-6), pose(p=(0.0, 0.0, 0.1)))
    model = CollisionModel(kinematics(), [ball], [tip])
    T_b_f = kinematics().forward(HOME)
    tip_b = T_b_f[:3, 3] + 0.1 * T_b_f[:3, 2]
    away = float(np.linalg.norm(tip_b - (2.0, 0.0, 0.3))) - 0.07
    pairs = [(pair.moving, pair.other) for pair in model.pairs]
    assert model.distances(HOME)[pairs.index(("tip", "ball"))] == pytest.approx(away, abs=EXACT)


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_bodies_that_are_placed_once_are_as_far_apart_and_no_farther_out(seed: int) -> None:
    random, arm = np.random.default_rng(seed), kinematics()
    leg = Solid("leg", Cylinder(0.3, 1.4), pose(p=random.uniform(-2, 2, 3)))
    T, q = pose(rot_z(random.uniform(-3, 3)), random.uniform(-1, 1, 3)), random.uniform(-2, 2, 6)
    model = CollisionModel(arm, [replace(leg, T=T @ leg.T)], [TIP])
    expected = dict(zip(model.pairs, model.distances(q), strict=True))
    bodies = {body.name: body for body in bodies_of_arm(arm, q, [TIP])}
    for pair in (pair for pair in model.pairs if not pair.own):
        away = bodies[pair.moving].distance(PlacedBody.of_solid(leg), T)
        deep = max(away, expected[pair]) < 0  # how deep two bodies overlap is an estimate
        assert deep or away == pytest.approx(expected[pair], abs=EXACT)
    assert np.linalg.norm(arm.forward(q)[:3, 3]) <= max(one.farthest for one in bodies.values())


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_no_pair_comes_nearer_than_its_reach_allows(seed: int) -> None:
    random = np.random.default_rng(seed)
    model = CollisionModel(
        kinematics(), [post(0.1), Solid("leg", Cylinder(0.3, 1.4), pose(p=(1, 1, 0)))], [TIP]
    )
    q = random.uniform(-2, 2, 6)
    turn = 0.2 * random.standard_normal(6)
    nearer = model.distances(q) - model.distances(q + turn)
    deep = model.distances(q) < 0  # how deep two bodies overlap is an estimate
    assert (nearer <= model.reach @ np.abs(turn) + EXACT)[~deep].all()


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_what_passes_keeps_its_margin_everywhere_between_the_waypoints(seed: int) -> None:
    random = np.random.default_rng(seed)
    keeps = clearance(post(random.uniform(-0.3, 0.0)), margin=0.02)
    T_b_f = aside(random.uniform(0.1, 0.5), random.uniform(-0.1, 0.1))
    goal = kinematics().inverse(T_b_f, near=HOME)
    model = keeps._model
    margins = np.where([pair.own for pair in model.pairs], ClearanceMargins().own, 0.02)
    along = np.linspace(0, 1, 300)[:, None]
    closest = np.min([model.distances(q) - margins for q in HOME + along * (goal - HOME)])
    try:
        keeps.joint_angles_after_joint_move(HOME, T_b_f)
    except PathBlocked:
        assert closest < PATH_CHECK_RESOLUTION
    else:
        assert closest > -PATH_CHECK_RESOLUTION


def test_a_path_through_a_solid_is_refused_and_names_it_where_and_how_deep() -> None:
    with pytest.raises(PathBlocked) as refusal:
        clearance(post(0.0)).joint_angles_after_linear_move(HOME, aside(0.5))
    blocked = refusal.value
    assert (blocked.moving, blocked.other) == ("sensor", "post")
    # 40 mm of the sensor, 20 mm of the post, 10 mm of margin before its middle, 250 mm away.
    assert blocked.share == pytest.approx((250 - 40 - 20 - 10) / 500, abs=0.01)
    assert blocked.distance < -0.05
    assert "36% of the way there, sensor would run into post" in str(blocked)


def test_a_path_past_a_solid_says_how_near_it_comes() -> None:
    with pytest.raises(PathBlocked, match=r"within 6\.0 mm of post, where 10 mm") as refusal:
        clearance(post(-0.11 - 0.006)).joint_angles_after_linear_move(HOME, aside(0.5))
    assert refusal.value.distance == pytest.approx(0.006, abs=1e-4)


def test_a_wider_margin_refuses_all_that_a_narrower_one_does() -> None:
    def passes(margin: float) -> bool:
        try:
            clearance(post(-0.15), margin=margin).joint_angles_after_linear_move(HOME, aside(0.5))
        except PathBlocked:
            return False
        return True

    assert [passes(m) for m in (0.0, 0.01, 0.03, 0.039, 0.041, 0.06)] == [True] * 4 + [False] * 2


def test_a_thin_solid_between_two_waypoints_is_met() -> None:
    x, y, z = kinematics().forward(HOME)[:3, 3] + (0, 0, -0.06)
    pin = Solid("pin", Capsule(1e-3, 0.02), pose(p=(x, y + 0.2525, z)))
    with pytest.raises(PathBlocked, match="pin"):
        clearance(pin, margin=0.0).joint_angles_after_linear_move(HOME, aside(0.5))
    with pytest.raises(PathBlocked, match="pin"):
        clearance(pin, margin=0.0).joint_angles_after_joint_move(HOME, aside(0.5))


def test_a_path_that_begins_too_near_may_lead_away_but_not_nearer() -> None:
    wall = Solid("wall", Box((0.08, 0.02, 0.08)), pose(p=aside(0.055)[:3, 3] - (0, 0, 0.06)))
    keeps = clearance(wall)  # 5 mm from the sensor
    keeps.joint_angles_after_linear_move(HOME, aside(-0.1))
    with pytest.raises(PathBlocked, match="wall"):
        keeps.joint_angles_after_linear_move(HOME, aside(0.002))


def test_an_arm_that_stands_in_something_is_not_moved() -> None:
    with pytest.raises(PathBlocked, match="where the arm is now, sensor already overlaps post"):
        clearance(post(0.0, y=0.0)).joint_angles_after_linear_move(HOME, aside(-0.3))


def test_an_arm_does_not_run_into_itself() -> None:
    folded = HOME + np.radians([0, 0, 62, 0, 0, 0])
    with pytest.raises(PathBlocked) as refusal:
        clearance().joint_angles_after_joint_move(HOME, kinematics().forward(folded))
    assert refusal.value.other in kinematics().link_names
    free = CollisionModel(kinematics(), tool=[TIP], self_collision=False)
    assert free.pairs == ()
    ClearPathPlanner(kinematics(), free).joint_angles_after_joint_move(
        HOME, kinematics().forward(folded)
    )


def test_a_line_that_passes_near_a_singularity_is_refused() -> None:
    far = kinematics().forward(np.radians([0, -80, 20, -30, -90, 0]))
    T_b_f = pose(far[:3, :3], far[:3, 3])
    start = kinematics().inverse(T_b_f, near=np.radians([0, -80, 20, -30, -90, 0]))
    keeps = ClearPathPlanner(
        kinematics(), CollisionModel(kinematics()), ClearanceMargins(singular=0.2)
    )
    path, _ = linear_waypoints(kinematics(), start, pose(far[:3, :3], far[:3, 3] - (0.04, 0, 0)))
    sizes = [kinematics().smallest_singular_value(q) for q in path]
    assert sizes[-1] < sizes[0] < 0.2
    with pytest.raises(PoseUnreachable, match="too near to a singularity"):
        keeps.joint_angles_after_linear_move(start, pose(far[:3, :3], far[:3, 3] - (0.04, 0, 0)))
    keeps.joint_angles_after_linear_move(start, pose(far[:3, :3], far[:3, 3] + (0.04, 0, 0)))


@pytest.mark.parametrize("model", ARM_MODELS)
def test_no_arm_touches_itself_where_it_is_built(model: str) -> None:
    random = np.random.default_rng(0)
    kinematics = Kinematics.load(model)
    arm = CollisionModel(kinematics)
    well = np.radians(WELL_DEG.get(model, [10, -80, 100, -60, -80, 20]))
    postures = well + random.uniform(-0.6, 0.6, (100, 6))
    within = np.clip(postures, kinematics.lower, kinematics.upper)
    nearest = min(arm.distances(q).min() for q in within)
    assert nearest > ClearanceMargins().own


def test_an_unknown_link_to_ignore_is_refused_with_the_nearest_one() -> None:
    with pytest.raises(ConfigurationError, match="did you mean: forearm_link"):
        check_ignored_links(kinematics(), [("forarm_link", "tool")])


def test_a_clear_path_is_passed_on_unchanged() -> None:
    arm, spy = spied(clearance(post(-0.5)))
    with arm:
        arm.move_linear(aside(0.3))
        arm.move_joint_to_pose(aside(0.1))
    assert [name for name, _ in spy.told] == ["linear", "joint"]
    np.testing.assert_array_equal([T for _, T in spy.told], [aside(0.3), aside(0.1)])


@pytest.mark.parametrize("straight", [True, False])
def test_a_post_in_the_way_is_passed_round_at_the_least_lift_that_clears_it(straight: bool) -> None:
    arm, spy = spied(clearance(post(-0.06)))
    with arm:
        reached = (arm.move_linear if straight else arm.move_joint_to_pose)(aside(0.5))
    assert len(spy.told) == 3
    heights = [1e3 * (T[2, 3] - aside(0)[2, 3]) for _, T in spy.told]
    assert heights == pytest.approx([100, 100, 0], abs=1e-6)
    np.testing.assert_allclose(reached.T_b_f, aside(0.5), atol=1e-8)


def test_a_detour_is_told_of_before_it_begins() -> None:
    told: list[str] = []
    arm, spy = spied(clearance(post(-0.06)))
    arm.report_events_to(lambda name, words: told.append(f"{words} ({len(spy.told)} moves made)"))
    with arm:
        arm.move_linear(aside(0.1))
        arm.check_moves(aside(0.5))
        assert told == []
        arm.move_linear(aside(0.5))
    (words,) = told
    assert words.startswith("round post, 100 mm back, across on a line and forward: ")
    assert words.endswith("(1 moves made)")


def test_no_leg_of_a_detour_begins_after_a_stop() -> None:
    class StoppedOnTheWay(Spy):
        def move_linear(self, T_b_f: Array) -> ArmState:
            reached = super().move_linear(T_b_f)
            arm.stop()
            return reached

    spy = StoppedOnTheWay(SimulatedArm(kinematics(), HOME))
    arm = CollisionCheckedArm(spy, clearance(post(-0.06)), np.eye(4), lifts=(0.1,))
    with arm:
        with pytest.raises(ArmFault, match="taken back"):
            arm.move_linear(aside(0.5))
        assert len(spy.told) == 1
        with pytest.raises(ArmFault, match="taken back"):
            arm.move_joint_to_pose(aside(0.1))
        arm.accept_moves_again()
        arm.move_joint_to_pose(aside(0.1))


def test_where_nothing_goes_the_refusal_is_that_of_the_direct_path_and_nothing_moves() -> None:
    arm, spy = spied(clearance(post(0.6)))
    with arm:
        with pytest.raises(PathBlocked, match="No detour up to 200 mm back") as refusal:
            arm.move_linear(aside(0.5))
        np.testing.assert_array_equal(arm.state().q, HOME)
    assert refusal.value.other == "post"
    assert spy.told == []


def test_where_the_nearest_configuration_is_blocked_another_one_is_taken() -> None:
    goal = aside(0.5)
    nearest, *others = kinematics().all_inverse_solutions(goal, near=HOME)
    T_b_forearm = kinematics().link_poses(nearest)[kinematics().link_names.index("forearm_link")]
    middle_b = transform_points(T_b_forearm, (-0.28, 0.0, 0.04))
    ball = Solid("ball", Capsule(0.03, 1e-3), pose(p=middle_b))
    arm, spy = spied(clearance(ball))
    with arm:
        arm.check_moves(goal)
        assert spy.told == []
        with pytest.raises(PathBlocked, match="ball"):
            arm.move_linear(goal)
        with pytest.raises(PathBlocked, match="ball"):
            arm.move_joint_to_pose(goal, nearest)
        reached = arm.move_joint_to_pose(goal)
    np.testing.assert_allclose(reached.T_b_f, goal, atol=1e-8)
    assert np.abs(reached.q - nearest).max() > 0.5
    assert min(np.abs(reached.q - q).max() for q in others) < 1e-6


def test_no_joint_goes_the_long_way_round_where_its_limit_bars_the_short_one() -> None:
    q = np.array(HOME)
    q[5] = kinematics().upper[5] - 0.01
    goal = kinematics().forward(q) @ pose(rot_z(0.05))
    spy = Spy(SimulatedArm(kinematics(), q))
    with CollisionCheckedArm(spy, clearance(), np.eye(4)) as arm:
        assert (
            np.abs(arm.plan_clear_path(q, goal, straight=False).segments[-1].q - q).max()
            > LARGEST_TURN_FROM_NEAR_JOINTS
        )
        with pytest.raises(PoseUnreachable, match="would turn by"):
            arm.move_joint_to_pose(goal, near=q)
    assert spy.told == []


def test_without_lifts_there_is_no_detour() -> None:
    arm, spy = spied(clearance(post(-0.06)), lifts=())
    with arm, pytest.raises(PathBlocked):
        arm.move_linear(aside(0.5))
    assert spy.told == []


def test_checking_looks_at_every_path_and_moves_nothing() -> None:
    arm, spy = spied(clearance(post(-0.2, y=-0.25), post(0.6, y=0.45)))
    with arm:
        arm.check_moves(aside(0.1), aside(-0.1), aside(-0.5))
        with pytest.raises(PathBlocked, match="post"):
            arm.check_moves(aside(0.1), aside(0.5))
        np.testing.assert_array_equal(arm.state().q, HOME)
        assert arm.state().time == 0
    assert {name for name, _ in spy.told} == {"check"}


def test_an_arm_that_took_another_configuration_is_not_moved_on() -> None:
    class Elsewhere(Spy):
        def move_joint_to_pose(
            self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
        ) -> ArmState:
            reached = super().move_joint_to_pose(T_b_f, near, direct=direct)
            return ArmState(
                reached.q + np.array((0, 0, 0, 0, 0, 2 * np.pi)), reached.T_b_f, reached.time
            )

    arm = CollisionCheckedArm(Elsewhere(SimulatedArm(kinematics(), HOME)), clearance(), np.eye(4))
    with arm, pytest.raises(ArmFault, match="joint 6 is 360 deg off"):
        arm.move_joint_to_pose(aside(0.1))


def test_what_has_been_seen_is_in_the_way() -> None:
    keeps = clearance()
    keeps.joint_angles_after_linear_move(HOME, aside(0.5))
    x, y, z = aside(0.25)[:3, 3]
    grid = np.array(
        [[(x + u, y, z - 0.3 + v) for v in np.linspace(0, 0.3, 5)] for u in (-0.1, 0, 0.1)]
    )
    keeps.set_measured_surface(grid.reshape(-1, 3), grid_triangles(3, 5))
    with pytest.raises(PathBlocked) as refusal:
        keeps.joint_angles_after_linear_move(HOME, aside(0.5))
    assert refusal.value.other == SCANNED_GROOVE_NAME


def test_the_strip_covers_every_cell_of_its_grid_once() -> None:
    rows, columns = 4, 5
    points = np.array([(i, k, 0.0) for i in range(rows) for k in range(columns)])
    corners = points[grid_triangles(rows, columns)]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    np.testing.assert_allclose(areas, 0.5)
    assert areas.sum() == (rows - 1) * (columns - 1)


@pytest.mark.parametrize("file", [PAPER, CLOCKWISE, EXAMPLES / "ur10e.toml"])
def test_the_examples_ways_are_clear(file: object) -> None:
    assert isinstance(file, type(PAPER))
    job = read_scan_job(file)
    assert {one.name for one in job.clearance.solid} == {"leg", "brace", "floor", "pillar"}
    check_scan_job(ScanContext(job, file))


CLAMP = {
    "name": "clamp",
    "kind": "box",
    "size_mm": [60.0, 60.0, 60.0],
    "position_mm": [70.0, 640.0, 270.0],
}
"""Beside the groove, where the scan of the example comes near it."""


def test_a_scan_that_would_run_into_something_ends_and_what_was_found_stays() -> None:
    job = read_scan_job(PAPER)
    solids = [*table_to_dict(job)["clearance"]["solid"], CLAMP]
    job = read_scan_job(PAPER, {"clearance.solid": solids, "clearance.lifts_mm": []})
    notes = Notes()
    cell = ScanContext(job, PAPER).make_cell()
    result = scan_in_cell(cell, job, notes)
    assert result.stop is StopReason.UNREACHABLE
    assert "clamp" in result.detail
    assert 2 <= len(notes.sections) < 16


def test_a_detour_of_a_scan_is_an_event() -> None:
    job = read_scan_job(PAPER)
    assert job.simulation is not None
    assert job.simulation.arm is not None
    assert job.scan.first is not None
    start, first = np.array(job.simulation.arm.home), job.scan.first.T
    arm = Kinematics.load(job.arm.model)
    halfway = arm.forward((start + arm.inverse(first, near=start)) / 2)
    crate = {
        "name": "crate",
        "kind": "box",
        "size_mm": [30.0, 30.0, 30.0],
        "position_mm": (1e3 * (halfway[:3, 3] + 0.05 * halfway[:3, 2])).tolist(),
    }
    solids = [*table_to_dict(job)["clearance"]["solid"], crate]
    job = read_scan_job(PAPER, {"clearance.solid": solids, "scan.sections": 3})
    notes = Notes()
    scan_in_cell(ScanContext(job, PAPER).make_cell(), job, notes)
    (name, detail), *_ = notes.events
    assert name == "detour"
    assert detail.startswith("round crate, 50 mm back, across in joint space and forward: ")


def test_a_scan_keeps_clear_of_what_it_scanned() -> None:
    job = read_scan_job(PAPER, {"scan.sections": 3})
    cell = ScanContext(job, PAPER).make_cell()
    result = scan_in_cell(cell, job, Notes())
    fresh = clear_path_planner_of_job(job)
    q = result.views[-1].q
    before = {pair.other for pair in fresh._model.pairs}
    ScannedSurfaceObstacle(fresh, result.sections)
    assert {pair.other for pair in fresh._model.pairs} - before == {SCANNED_GROOVE_NAME}
    seen = [
        d
        for pair, d in zip(fresh._model.pairs, fresh._model.distances(q), strict=True)
        if pair.other == SCANNED_GROOVE_NAME
    ]
    # The sensor looks at the groove from its standoff, its corners a little nearer.
    assert 0.15 < min(seen) < 0.23


def test_solids_of_a_job_stand_where_it_says() -> None:
    job = read_scan_job(PAPER)
    solids = {one.name: one.solid for one in job.clearance.solid}
    np.testing.assert_allclose(solids["leg"].T[:3, :3], rot_y(np.pi / 2), atol=1e-15)
    leg = solids["leg"].shape
    assert isinstance(leg, Cylinder)
    assert (leg.radius, leg.length) == pytest.approx((0.3, 1.4))
    assert solids["floor"].shape == Box((4.0, 4.0, 0.1))


@pytest.mark.parametrize(
    ("solid", "message"),
    [
        ({"kind": "box", "radius_mm": 3.0}, "a box takes size_mm alone"),
        ({"kind": "cylinder", "radius_mm": 3.0}, "takes radius_mm and length_mm alone"),
        ({"kind": "capsule", "size_mm": [1.0, 1.0, 1.0]}, "takes radius_mm and length_mm alone"),
        ({"kind": "sphere", "radius_mm": 3.0}, "is none of"),
        ({"kind": "cylinder", "radius_mm": -3.0, "length_mm": 1.0}, "than or equal to 0.5"),
    ],
)
def test_a_solid_that_is_none_is_refused(solid: dict[str, object], message: str) -> None:
    solid = {"name": "thing", "position_mm": [0.0, 0.0, 0.0], **solid}
    with pytest.raises(ConfigurationError, match=message):
        read_scan_job(PAPER, {"clearance.solid": [solid]})


def test_waypoints_begin_and_end_where_they_should() -> None:
    path = interpolate_joints(HOME, HOME + 0.3)
    np.testing.assert_array_equal(path[[0, -1]], [HOME, HOME + 0.3])


def test_a_check_of_postures_says_what_their_distances_say() -> None:
    model = CollisionModel(kinematics(), [post(0.1), post(-0.3, y=-0.4)], [TIP])
    least = np.where([pair.own for pair in model.pairs], 0.005, 0.03)
    least[::7] = -np.inf
    check, found = model.make_nearness_check(least), set()
    looked_at = np.isfinite(least)
    for q in HOME + np.random.default_rng(0).uniform(-1.5, 1.5, (150, 6)):
        short = (model.distances(q) < least) & looked_at
        near = check(q)
        assert (near is not None) == short.any()
        named = [pair == near for pair in model.pairs]  # both walls have one name
        assert near is None or short[named].any()
        found.add(near is None)
    assert found == {True, False}
