"""The loop of a tow, with vehicles that go exactly as told and a planner that is no optimiser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pytest
from kinematic_team import ExactLocalisation, KinematicTeam, RowPlanner

from tjscan.core.errors import TowHalted, VehicleFault
from tjscan.core.frames import Array
from tjscan.recording.journal import RunEvent
from tjscan.towing.journal import TowCycle
from tjscan.towing.loop import CableTow, TowSetup
from tjscan.towing.seam import Seam
from tjscan.towing.shape.area import DiscObstacle
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.shape.estimate import LEAST_ANGLE_DEVIATION
from tjscan.towing.shape.plan import PlanInputs, TowingPlan
from tjscan.towing.tables import FollowingSettings, LocalisationSettings, SeamSettings
from tjscan.vehicle.localisation import VehiclePose
from tjscan.vehicle.vehicle import Twist

SEAM = SeamSettings(points=((3.0, 0.0), (3.2, 0.0)), speed=0.01)


class Kept:
    def __init__(self) -> None:
        self.cycles: list[TowCycle] = []
        self.events: list[tuple[str, str]] = []

    def record(self, message: object) -> None:
        match message:
            case TowCycle():
                self.cycles.append(message)
            case RunEvent(name, detail):
                self.events.append((name, detail))

    @property
    def names(self) -> list[str]:
        return [name for name, _ in self.events]


class Rig:
    """Three vehicles a metre apart, on a cable of 3.3 m with slack between them."""

    def __init__(
        self,
        change: Callable[[int, VehiclePose], VehiclePose | None] = lambda v, pose: pose,
        disturb: Callable[[Rig, float], None] = lambda rig, time: None,
        halt: Callable[[Array], str] = lambda tip: "",
        seam: SeamSettings = SEAM,
        patience: float = 2.0,
        obstacles: Callable[[float], list[DiscObstacle]] = lambda time: [],
        force: float = inf,
    ) -> None:
        self.kept, self.planner = Kept(), RowPlanner(33, 1.0, 3, halt)
        start = self.planner.start(Seam(seam).pose_at(0.0)).held_poses
        self.team = KinematicTeam(start, lambda time: disturb(self, time))
        setting = TowSetup(
            Cable(links=33),
            TowingTeam((10, 21, 32), force=force),
            Seam(seam),
            LocalisationSettings(),
            FollowingSettings(patience=patience),
            obstacles,
        )
        self.tow = CableTow(
            self.team,  # type: ignore[arg-type]
            ExactLocalisation(self.team, change),
            setting,
            self.planner,
            self.kept,
        )

    def run(self, elapsed: float = 0.0) -> None:
        try:
            self.tow.run(elapsed=elapsed)
        finally:
            assert all(vehicle.stopped for vehicle in self.team.vehicles)


def test_a_welder_that_stands_goes_on_with_what_is_left_of_its_time() -> None:
    seam = SeamSettings(points=((3.0, 0.0),), heading=0.0, seconds=2.0)
    whole, rest = Rig(seam=seam), Rig(seam=seam)
    whole.run()
    rest.run(elapsed=1.5)
    assert len(whole.kept.cycles) == 20
    assert len(rest.kept.cycles) == 5


def test_a_seam_is_welded_at_its_speed_with_every_vehicle_where_it_was_sent() -> None:
    rig = Rig()
    rig.run()
    assert rig.kept.names == ["start", "welded"]
    assert rig.kept.cycles[-1].along == pytest.approx(0.2)
    assert len(rig.kept.cycles) == pytest.approx(200, abs=2)
    for cycle in rig.kept.cycles[20:]:
        np.testing.assert_allclose(cycle.poses[:, :2], cycle.targets[:, :2], atol=2e-3)


def test_vehicles_drive_on_while_a_slow_computer_plans_and_nobody_counts_as_moved() -> None:
    def think(tip: Array) -> str:
        rig.team.advance_to(rig.team.time + 0.04)
        return ""

    rig = Rig(halt=think)
    rig.run()
    assert rig.kept.names == ["start", "welded"]


def test_a_plan_that_halts_stops_the_weld_and_a_short_halt_is_waited_out() -> None:
    rig = Rig(halt=lambda tip: "something is in the way" if 10 < rig.team.time < 11 else "")
    rig.run()
    assert rig.kept.names == ["start", "waits", "goes on", "welded"]
    waited = [cycle for cycle in rig.kept.cycles if cycle.wait]
    assert {cycle.along for cycle in waited} == {waited[0].along}
    assert max(abs(cycle.asked[:, 0]).max() for cycle in waited[5:]) < 2e-3


def test_noise_makes_nobody_go_on_and_wait_in_turn() -> None:
    """A wall that seems to be nearer and farther by what the poses scatter, and goes at last."""
    rng = np.random.default_rng(3)

    def blocked(tip: Array) -> str:
        wall = 3.05 + 2e-4 * rng.standard_normal()
        return "a wall is too near" if tip[0] > wall and rig.team.time < 22 else ""

    def scatter(v: int, pose: VehiclePose) -> VehiclePose:
        x, y = 3e-3 * rng.standard_normal(2)
        return replace(pose, x=pose.x + x, y=pose.y + y)

    rig = Rig(scatter, halt=blocked, patience=60.0)
    rig.run()
    assert rig.kept.names.count("goes on") == 1
    assert rig.kept.names[-1] == "welded"


def test_a_halt_that_lasts_ends_the_tow_with_the_planners_reason() -> None:
    rig = Rig(halt=lambda tip: "a wall is too near" if tip[0] > 3.1 else "")
    with pytest.raises(TowHalted, match="no shape within its limits"):
        rig.run()
    assert rig.kept.names[-1] == "stop"
    assert rig.kept.cycles[-1].along == pytest.approx(0.1, abs=2e-3)


def test_a_vehicle_with_a_drive_fault_is_planned_around_until_the_cable_is_taut() -> None:
    def break_down(rig: Rig, time: float) -> None:
        if time > 1.0:
            rig.team.vehicles[1].fault = "left drive: over temperature"

    rig = Rig(disturb=break_down)
    with pytest.raises(VehicleFault, match="vehicle 2 is stopped, and the cable beside it is taut"):
        rig.run()
    assert (1,) in rig.planner.asked
    assert ("stopped", "vehicle 2: left drive: over temperature") in rig.kept.events
    chord = np.hypot(*(rig.team.vehicles[2].pose - rig.team.vehicles[1].pose)[:2])
    assert chord < 0.99 * 1.1


def test_a_vehicle_that_is_told_to_drive_and_does_not_is_noticed() -> None:
    def jam(rig: Rig, time: float) -> None:
        rig.team.vehicles[0].jammed = time > 1.0

    rig = Rig(disturb=jam)
    with pytest.raises(VehicleFault, match="vehicle 1 is stopped"):
        rig.run()


def test_a_cable_that_is_drawn_straight_halts_the_weld_before_its_pull_is_known() -> None:
    """With 16 of 20 N, before vehicle 1, which goes away from the root."""
    rig = Rig(force=20.0)
    with pytest.raises(VehicleFault, match="the cable before vehicle 1 is drawn straight"):
        rig.run()
    (chord, *_) = Cable(links=33).longest_chords((10, 21, 32), 16.0)
    assert rig.kept.cycles[-1].poses[0, 0] == pytest.approx(chord, abs=2e-3)


def test_a_vehicle_that_stands_for_good_makes_the_weld_wait_once() -> None:
    """It is tried again meanwhile, and as it does not drive, nothing goes on."""

    def jam(rig: Rig, time: float) -> None:
        rig.team.vehicles[0].jammed = time > 1.0

    rig = Rig(disturb=jam, patience=40.0)
    with pytest.raises(VehicleFault, match="vehicle 1 is stopped, and the cable beside it is taut"):
        rig.run()
    assert rig.kept.names == ["start", "slips", "stopped", "waits", "stop"]
    assert {()} < {tuple(asked) for asked in rig.planner.asked[-350:]}


def test_the_welder_waits_before_the_cable_beside_one_that_stands_is_bent_too_far() -> None:
    def break_down(rig: Rig, time: float) -> None:
        rig.team.vehicles[1].fault = "left drive: over temperature"

    limit = Cable(links=33).joint_limit
    rig = Rig(disturb=break_down)
    rig.planner.bend = lambda tip: 0.8 * limit + 4.0 * (tip[0] - 3.0)
    with pytest.raises(
        VehicleFault, match=r"vehicle 2 is stopped, and beside it joint \d+ is bent"
    ):
        rig.run()
    estimate = abs(rig.kept.cycles[-1].plan.estimate).max()
    assert estimate < limit - 2 * LEAST_ANGLE_DEVIATION + 0.01


def test_vehicles_that_are_to_stay_where_they_are_stop_at_once() -> None:
    """What they lagged behind by before is not made up for."""
    rig = Rig()

    def plan(inputs: PlanInputs) -> TowingPlan:
        found = RowPlanner.plan(rig.planner, inputs)
        stays = rig.team.time > 3.0
        return replace(found, held_poses=inputs.poses, retreat="to stay") if stays else found

    rig.planner.plan = plan  # type: ignore[method-assign]
    with pytest.raises(TowHalted, match="to stay"):
        rig.run()
    before, after = ([c for c in rig.kept.cycles if bool(c.wait) is held] for held in (False, True))
    assert np.abs([c.asked[:2, 0] for c in before]).max() > 5e-3
    assert not np.abs([c.asked[:2] for c in after]).any()


def test_a_joint_that_may_be_bent_too_far_by_what_its_estimate_is_doubted_halts_the_weld() -> None:
    """Whoever causes it, and at its limit less two standard deviations."""
    limit, doubt = Cable(links=33).joint_limit, 0.04
    rig = Rig()

    def plan(*given: Any, **named: Any) -> TowingPlan:
        found = RowPlanner.plan(rig.planner, *given, **named)
        return replace(found, deviations=np.full(33, doubt))

    rig.planner.bend = lambda tip: 0.8 * limit + 4.0 * (tip[0] - 3.0)
    rig.planner.plan = plan  # type: ignore[method-assign]
    with pytest.raises(TowHalted, match=r"joint 0 is bent by 3\d\.\d° ± 4\.6°"):
        rig.run()
    estimate = abs(rig.kept.cycles[-1].plan.estimate).max()
    assert limit - 2 * doubt - 0.02 < estimate < limit - 2 * doubt + 0.01


def test_a_cable_that_pulls_too_hard_halts_the_weld_by_the_vehicles_name_and_noise_does_not() -> (
    None
):
    """Its force on vehicle 2 rises to 18 of 20 N; on vehicle 1 it is noise alone."""
    rig, rng = Rig(force=20.0), np.random.default_rng(5)

    def plan(*given: Any, **named: Any) -> TowingPlan:
        found = RowPlanner.plan(rig.planner, *given, **named)
        forces = np.zeros((3, 2))
        forces[1, 0], forces[0] = -min(18.0, 4.0 * rig.team.time), 40.0 * rng.standard_normal(2)
        return replace(found, forces=forces, tension=np.full(33, 12.0))

    rig.planner.plan = plan  # type: ignore[method-assign]
    with pytest.raises(VehicleFault, match=r"the cable pulls at vehicle 2 with \d+ N of the 20 N"):
        rig.run()
    last = rig.kept.cycles[-1]
    assert last.tension == pytest.approx(12.0)
    assert 6.0 < rig.kept.cycles[-1].time < 12.0
    assert last.targets[1, 0] < last.plan.held_poses[1, 0] - 5e-3  # it gives way


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda pose: None, "none comes"),
        (lambda pose: replace(pose, y=pose.y + 0.5), "jumped"),
        (lambda pose: replace(pose, x=float("nan")), "not a number"),
        (lambda pose: replace(pose, time=3.0), "none comes"),
    ],
)
def test_poses_that_cannot_be_true_halt_the_weld_with_a_named_cause(
    change: Callable[[VehiclePose], VehiclePose | None], why: str
) -> None:
    rig = Rig(lambda v, pose: change(pose) if v == 0 and pose.time > 5.0 else pose)
    with pytest.raises(TowHalted, match=f"pose of vehicle 1 is lost: {why}"):
        rig.run()
    assert rig.kept.cycles[-1].along < 0.07


def test_swapped_poses_are_never_taken() -> None:
    def swap(v: int, pose: VehiclePose) -> VehiclePose:
        if pose.time < 5.0 or v == 2:
            return pose
        return VehiclePose(pose.time, *rig.team.vehicles[1 - v].pose.tolist())

    rig = Rig(swap)
    with pytest.raises(TowHalted, match="jumped"):
        rig.run()
    assert rig.kept.cycles[-1].poses[0, 0] == pytest.approx(1.05, abs=0.02)


def test_a_vehicle_that_was_pushed_is_found_again_and_led_back() -> None:
    def push(rig: Rig, time: float) -> None:
        if 5.0 < time <= 5.25:
            rig.team.vehicles[1].pose += (0.0, 0.04, 0.0)

    rig = Rig(disturb=push, patience=5.0)
    rig.run()
    assert "moved" in rig.kept.names
    assert rig.kept.cycles[-1].poses[1, 1] == pytest.approx(0.0, abs=5e-3)


def jump(pose: VehiclePose, y: float, heading_deg: float = 0.0) -> VehiclePose:
    return replace(pose, y=pose.y + y, heading=pose.heading + np.radians(heading_deg))


@pytest.mark.parametrize(
    "lie",
    [
        lambda pose: jump(pose, 0.2),
        lambda pose: jump(pose, 0.0, 60.0),
        lambda pose: jump(pose, 0.04 if pose.time < 5.3 else 0.2),
        lambda pose: jump(pose, 0.2 if 5.2 < pose.time < 5.7 else np.nan),
        lambda pose: jump(pose, min(0.8 * (pose.time - 5.0), 1.5)),  # the cable does not reach
    ],
)
def test_what_is_no_motion_of_a_vehicle_is_never_taken(
    lie: Callable[[VehiclePose], VehiclePose],
) -> None:
    rig = Rig(lambda v, pose: lie(pose) if v == 1 and pose.time > 5.0 else pose)
    with pytest.raises(TowHalted, match="pose of vehicle 2 is lost"):
        rig.run()
    assert "moved" not in rig.kept.names


@pytest.mark.parametrize("begins", [0.0, 5.0])
def test_a_single_lie_after_silence_is_forgotten(begins: float) -> None:
    def spoil(v: int, pose: VehiclePose) -> VehiclePose | None:
        late = pose.time - begins
        if v != 1 or not 0.0 <= late < 1.3:
            return pose
        return jump(pose, 0.2) if late > 1.22 or (begins == 0.0 and late < 0.06) else None

    rig = Rig(spoil, patience=5.0)
    rig.run()
    assert max(abs(cycle.poses[1, 1]) for cycle in rig.kept.cycles[20:]) < 5e-3


@pytest.mark.parametrize("off", [lambda time: 0.03, lambda time: min(0.8 * time, 0.2)])
def test_a_welder_that_was_moved_halts_the_weld(off: Callable[[float], float]) -> None:
    """It would weld on where it is taken to be, and a localisation may lie."""
    rig = Rig(lambda v, pose: jump(pose, off(pose.time - 5)) if v == 2 < pose.time - 3 else pose)
    with pytest.raises(TowHalted, match=r"the welder was moved|pose of vehicle 3 is lost"):
        rig.run()
    assert rig.kept.cycles[-1].along < 0.07


def test_the_welder_must_stand_at_its_seam() -> None:
    rig = Rig()
    rig.team.vehicles[2].pose += (0.0, 0.3, 0.0)
    with pytest.raises(TowHalted, match="the welder is 300 mm from where"):
        rig.run()


def test_no_pose_at_all_is_said_with_the_vehicles_number() -> None:
    rig = Rig(lambda v, pose: None if v == 1 else pose)
    with pytest.raises(TowHalted, match="no pose of vehicle 2"):
        rig.run()


def test_a_vehicle_is_stopped_by_whatever_ends_the_loop() -> None:
    def interrupt(rig: Rig, time: float) -> None:
        if time > 2.0:
            raise KeyboardInterrupt

    rig = Rig(disturb=interrupt)
    with pytest.raises(KeyboardInterrupt):
        rig.run()
    assert rig.kept.events[-1] == ("stop", "interrupted")


@pytest.mark.parametrize("speed", [0.02, 0.2])
def test_the_welder_stops_before_what_comes_onto_its_seam_and_goes_on_when_it_left(
    speed: float,
) -> None:
    """It comes onto the seam's line 400 mm ahead, stands there for 30 s, and goes back."""

    def visit(time: float) -> list[DiscObstacle]:
        there, gone = 0.35 / speed, 0.35 / speed + 30.0
        off = max(there - time, time - gone, 0.0) * speed
        moves = 0.0 if off == 0.0 else speed * (-1.0 if time < gone else 1.0)
        return [DiscObstacle(3.4, off, 0.1, (0.0, moves), "a trolley")]

    rig = Rig(obstacles=visit, patience=120.0)
    rig.run()
    waits = [detail for name, detail in rig.kept.events if name == "waits"]
    assert waits[0].startswith("a trolley is in the welder's way")
    assert rig.kept.names[-1] == "welded"
    for cycle in rig.kept.cycles:
        x, y, radius, *_ = cycle.obstacles[0]
        assert np.hypot(*(cycle.poses[-1, :2] - (x, y))) > radius + 0.15 + 0.015
    waited = sum(0.1 for cycle in rig.kept.cycles if cycle.wait)
    assert waited < 30.0 + 2 * 0.35 / speed + 2.0


def test_what_stays_on_the_seam_ends_the_tow_by_name() -> None:
    rig = Rig(obstacles=lambda time: [DiscObstacle(3.3, 0.0, 0.1, name="a trolley")])
    with pytest.raises(TowHalted, match="a trolley is in the welder's way"):
        rig.run()
    assert rig.team.vehicles[-1].pose[0] < 3.3 - 0.1 - 0.15 - 0.02


def test_what_stands_beside_the_seam_and_leaves_room_is_passed() -> None:
    rig = Rig(obstacles=lambda time: [DiscObstacle(3.1, 0.281, 0.1)])
    rig.run()
    assert rig.kept.names == ["start", "welded"]


def run_away(v: int, velocity: Array, since: float = 5.0) -> Callable[[Rig, float], None]:
    """A vehicle that drives at a velocity, m/s and rad/s, whatever it is told, and shows so."""

    def disturb(rig: Rig, time: float) -> None:
        if time > since:
            rig.team.vehicles[v].command = lambda twist: None  # type: ignore[method-assign]
            rig.team.vehicles[v].twist = Twist(*velocity)

    return disturb


def test_a_welder_that_runs_off_is_followed_and_the_tow_ends_with_its_name() -> None:
    """The row planner keeps the vehicles behind the pose that it is given."""
    rig = Rig(disturb=run_away(2, np.array((0.0, 0.0, 0.02))), patience=4.0)
    with pytest.raises(VehicleFault, match="the welder does not follow its commands"):
        rig.run()
    last = rig.kept.cycles[-1]
    assert last.poses[2, 1] > 0.06
    np.testing.assert_allclose(last.poses[:2, 1], last.poses[2, 1], atol=0.03)
    assert {cycle.along for cycle in rig.kept.cycles if cycle.time > 5.5} == {last.along}


def test_a_vehicle_that_turns_on_the_spot_is_named() -> None:
    """By 4° a second: its place stays, and the cable that it holds is bent."""
    rig = Rig(disturb=run_away(1, np.array((0.0, np.radians(4.0), 0.0))))
    with pytest.raises(VehicleFault, match="vehicle 2"):
        rig.run()
    assert "off plan" in rig.kept.names


def test_a_towing_vehicle_that_runs_off_is_named_and_planned_around() -> None:
    rig = Rig(disturb=run_away(1, np.array((0.0, 0.0, 0.02))))
    with pytest.raises(VehicleFault, match="vehicle 2 does not follow its commands"):
        rig.run()
    assert (1,) in rig.planner.asked
    assert [n for n in rig.kept.names if n in {"slips", "moved", "stopped"}] == []


@pytest.mark.parametrize(
    ("drift", "name"), [((-0.006, 0.0), "slips"), ((0.0, 0.006), "moved"), ((0.0, 0.0), "")]
)
def test_what_moves_a_vehicle_unseen_by_its_wheels_is_told_apart(
    drift: tuple[float, float], name: str
) -> None:
    """The floor carries it: against its way as wheels that slip, or aside."""

    def carry(rig: Rig, time: float) -> None:
        rig.team.vehicles[0].pose[:2] += 0.05 * np.array(drift)

    rig = Rig(disturb=carry)
    rig.run()
    assert set(rig.kept.names) - {"start", "welded"} == {name} - {""}


def test_poses_noisier_than_stated_are_named_with_figures_and_the_welder_keeps_its_line() -> None:
    """5 mm and 1°, where 0.5 mm and 0.1° are stated."""
    rng, noise = np.random.default_rng(7), np.array((5e-3, 5e-3, np.radians(1.0)))

    def scatter(v: int, pose: VehiclePose) -> VehiclePose:
        at = (pose.x, pose.y, pose.heading) + noise * rng.standard_normal(3) * (pose.time > 5.0)
        return VehiclePose(pose.time, *at.tolist())

    rig, off = Rig(scatter), [0.0]
    rig.team.disturb = lambda time: off.append(abs(rig.team.vehicles[2].pose[1]))
    rig.run()
    assert sum(name == "noisy poses" for name in rig.kept.names) == 3
    assert set(rig.kept.names) == {"start", "noisy poses", "welded"}
    assert max(off) < 2e-3
