"""Tow the cable along a seam: estimate, plan, send, ten times a second. Suzuki et al. (2022)."""

from __future__ import annotations

import time as host
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from math import hypot
from typing import Final, Protocol

import numpy as np

from tjscan.core.errors import TowHalted, VehicleFault, VehicleLinkLost
from tjscan.core.frames import Array
from tjscan.recording.journal import Journal, RunEvent, event_recorder
from tjscan.towing.following import PoseFollower, velocity_from_twist
from tjscan.towing.grip import GripWatch
from tjscan.towing.journal import WELDED_EVENT, TowCycle
from tjscan.towing.pose_filter import OUTLIER_SIGMAS, TeamEstimate, TeamPoseFilter
from tjscan.towing.seam import Seam
from tjscan.towing.shape.area import DiscObstacle
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.shape.plan import PlanInputs, ShapePlanner, TowingPlan
from tjscan.towing.standstill import StandstillWatch, WaitingPatience, WaitingReason
from tjscan.towing.tables import FollowingSettings, LocalisationSettings
from tjscan.vehicle.localisation import Localisation
from tjscan.vehicle.vehicle import AT_REST, Twist, Vehicle, VehicleState

PLAN_PERIOD: Final = 0.1
"""Seconds between plans."""

MEASUREMENTS_PER_PLAN: Final = 2
"""From one plan to the next: a localisation sees the vehicles more often than that."""

START_POSE_SIGMA: Final = 0.15e-3
"""Metres to which the poses of vehicles at rest are to be known before they drive."""

LONGEST_START_WAIT: Final = 10.0
"""Seconds that this may take; then they drive as well as they are known."""

START_POSITION_TOLERANCE: Final = 0.05
"""Metres by which the welder may be off its seam when a tow begins."""

START_VEHICLE_TOLERANCE: Final = 0.3
"""The same of a towing vehicle and its place in the first shape: it is led there."""

WELDER_OFF_PLAN: Final = 5e-3
"""Metres, and three standard deviations, that the welder may be from its plan while it welds: five
times what it is off in sound tows. The vehicles then follow it, and not the plan."""

VEHICLE_OFF_PLAN: Final = 0.05
"""Metres that a towing vehicle may be from where it was sent while the welder welds: at its top
speed it is some 20 mm behind."""

BACK_ON_PLAN_SHARE: Final = 0.5
"""Share of that from which on the welder goes on after it waited."""

SPARE_CLEARANCE: Final = 0.01
"""Metres by which an obstacle must be farther than the clearance before a welder that waited for it
goes on: more than the noise with which it is seen."""


class Team(Protocol):
    """The vehicles, the welder last, whose states come together."""

    @property
    def vehicles(self) -> Sequence[Vehicle]:
        """All of them, connected."""

    @property
    def time(self) -> float:
        """Seconds on the team's clock: simulated time, or this computer's."""

    def advance_to(self, time: float) -> Sequence[VehicleState | VehicleFault]:
        """Wait until a time, and return each vehicle's newest state, or what is wrong with it."""


@dataclass(frozen=True, slots=True)
class TowSetup:
    """What is towed, where to, and how patiently.

    Parameters
    ----------
    cable : Cable
    team : TowingTeam
    seam : Seam
    localisation : LocalisationSettings
    following : FollowingSettings
    obstacles : callable
        Gives the obstacles as they are at a time on the team's clock.
    clearance : float
        Between the welder's body and obstacles, metres. Walls and pillars may be nearer: work
        begins and ends at them.
    """

    cable: Cable
    team: TowingTeam
    seam: Seam
    localisation: LocalisationSettings
    following: FollowingSettings
    obstacles: Callable[[float], Sequence[DiscObstacle]]
    clearance: float = 0.02


class CableTow:
    """The loop of a tow.

    Parameters
    ----------
    vehicles : Team
        Connected; the last is the welder.
    localisation : Localisation
        Connected.
    setting : TowSetup
    planner : ShapePlanner
    journal : Journal
    """

    def __init__(
        self,
        vehicles: Team,
        localisation: Localisation,
        setting: TowSetup,
        planner: ShapePlanner,
        journal: Journal,
    ) -> None:
        self._team, self._localisation = vehicles, localisation
        self._setting, self._planner, self._journal = setting, planner, journal
        team, count = setting.team, len(setting.team.held_links)
        record_event = event_recorder(journal)
        self._poses = TeamPoseFilter(setting.cable, team, setting.localisation, record_event)
        turn = team.top_speed / team.body_radius
        self._followers = [
            PoseFollower(setting.following, team.top_speed, turn) for _ in range(count)
        ]
        self._standing = StandstillWatch(setting.cable, team, record_event)
        self._grip = GripWatch(count, team.force)
        self._patience = WaitingPatience(setting.following.patience, record_event)
        self._along = self._elapsed = self._due = self._measured_at = self._began = 0.0
        self._last: TowingPlan | None = None
        self._targets: Array | None = None
        self._asked: list[Twist] = [AT_REST] * count
        self._states: Sequence[VehicleState | VehicleFault] = ()
        self._measured: Array = np.full((count, 3), np.nan)
        self._shapeless = self._blocked = self._strayed = False

    def run(self, along: float = 0.0, last: TowingPlan | None = None, elapsed: float = 0.0) -> None:
        """Tow until the seam is welded.

        Parameters
        ----------
        along : float, optional
            Where along the seam it goes on, metres.
        last : TowingPlan, optional
            The shape that the cable has at the beginning, or was sent to before.
        elapsed : float, optional
            Seconds for which a welder that stays in one place has welded already.

        Raises
        ------
        TowHalted
            If there is no way on, and waiting did not help.
        VehicleFault
            The same, if a vehicle or the link to it is to blame.
        """
        self._along, self._began, self._last = along, host.process_time(), last
        self._elapsed = elapsed
        with self._stopping_vehicles_at_end():
            self._due = self._measured_at = self._team.time
            estimate = self._wait_for_poses()
            self._journal.record(RunEvent("start", f"{1e3 * along:.0f} mm along the seam"))
            while not self._is_finished:
                self._run_cycle(estimate)
                estimate = self._take_measurements()
            self._journal.record(RunEvent(WELDED_EVENT, f"{1e3 * self._along:.0f} mm of seam"))

    @property
    def _is_finished(self) -> bool:
        seam = self._setting.seam
        return self._along >= seam.length if seam.length else self._elapsed >= seam.seconds

    @contextmanager
    def _stopping_vehicles_at_end(self) -> Iterator[None]:
        """Bring all vehicles to rest at the end, whatever ends it."""
        try:
            yield
        except BaseException as error:
            self._stop_vehicles()
            interrupted = isinstance(error, KeyboardInterrupt)
            reason = "interrupted" if interrupted else str(error) or type(error).__name__
            self._journal.record(RunEvent("stop", reason))
            raise
        self._stop_vehicles()

    def _wait_for_poses(self) -> TeamEstimate:
        """Wait until every vehicle's pose is known, and check that the welder is at its seam."""
        limit = self._team.time + max(self._setting.localisation.lost, 5 * PLAN_PERIOD)
        estimate = self._take_measurements()
        while self._poses.unknown and self._team.time < limit:
            estimate = self._take_measurements()
        if self._poses.unknown:
            numbers = ", ".join(str(v + 1) for v in self._poses.unknown)
            seconds = f"{self._setting.localisation.lost:g} s"
            raise TowHalted(
                f"no pose of vehicle {numbers} came within {seconds}. See that the localisation is "
                "running."
            )
        limit = self._team.time + LONGEST_START_WAIT
        while estimate.sigmas[:, 0].max() > START_POSE_SIGMA and self._team.time < limit:
            estimate = self._take_measurements()
        places = estimate.poses.copy() if self._last is None else self._last.held_poses.copy()
        places[-1] = self._setting.seam.pose_at(self._along)
        for v, (place, pose) in enumerate(zip(places, estimate.poses, strict=True)):
            off, welder = hypot(*(pose - place)[:2]), v == self._setting.team.welder
            if off > (START_POSITION_TOLERANCE if welder else START_VEHICLE_TOLERANCE):
                name, (x, y) = self._setting.team.name_of(v), 1e3 * place[:2]
                raise TowHalted(
                    f"{name} is {1e3 * off:.0f} mm from where the tow begins. Bring it to "
                    f"({x:.0f}, {y:.0f}) mm, heading {np.degrees(place[2]) % 360:.0f}°."
                )
        return estimate

    def _take_measurements(self) -> TeamEstimate:
        """Let a period pass while the vehicles drive as asked, and take in what was measured."""
        due, begun = self._due + PLAN_PERIOD, self._due
        self._measured = np.full((len(self._followers), 3), np.nan)
        for look in range(1, MEASUREMENTS_PER_PLAN + 1):
            self._states = self._team.advance_to(begun + look * PLAN_PERIOD / MEASUREMENTS_PER_PLAN)
            measured, now = self._localisation.read(), self._team.time
            odometry = [
                state.odometry if isinstance(state, VehicleState) else AT_REST
                for state in self._states
            ]
            # Planning takes time too, in which they drive.
            estimate = self._poses.update(now, now - self._measured_at, odometry, measured)
            self._measured_at = now
            for v, pose in enumerate(measured):
                if pose is not None:
                    self._measured[v] = pose.x, pose.y, pose.heading
        self._due = due if now < due + PLAN_PERIOD else now  # what was missed is not made up for
        return estimate

    def _run_cycle(self, estimate: TeamEstimate) -> None:
        """Plan, and send the vehicles where to go."""
        now = self._team.time
        self._standing.update(now, PLAN_PERIOD, self._states, self._asked, estimate, self._targets)
        obstacles, pace = self._setting.obstacles(now), self._standing.pace(estimate.poses)
        waiting = self._reason_to_wait(estimate) or self._obstacle_in_way(estimate, obstacles)
        pace = allowed = 0.0 if waiting else pace
        discs = [(d.x, d.y, d.radius, *d.velocity) for d in obstacles]
        began = host.thread_time()
        plan, pace = self._plan_next_step(estimate, obstacles, pace)
        seconds = host.thread_time() - began
        pushes = self._wheel_pushes(estimate.poses)
        self._grip.update(plan, pushes[:, :2])
        if plan.halt or plan.retreat:
            waiting = waiting or WaitingReason(plan.halt or plan.retreat)
        elif pace == 0 and waiting is None:
            waiting = WaitingReason("one step on, the cable has no shape within its limits")
        self._shapeless = bool(plan.halt) or (pace == 0 and allowed > 0)
        self._patience.update(now, waiting, self._along)
        step = pace * self._setting.seam.settings.speed * PLAN_PERIOD
        along = min(self._along + step, self._setting.seam.length)
        targets = self._send_targets(estimate, plan, along)
        self._journal.record(
            TowCycle(
                time=now,
                along=along,
                pace=pace,
                seen=self._measured,
                poses=estimate.poses,
                sigmas=estimate.sigmas,
                targets=targets,
                asked=np.array([(t.speed, t.turn_rate, t.sideways) for t in self._asked]),
                obstacles=np.array(discs, dtype=float).reshape(-1, 5),
                plan=plan,
                seconds=seconds,
                host=host.process_time() - self._began,
                wait="" if waiting is None else waiting.why,
                stopped=self._standing.disobedient,
                forces=self._grip.forces,
                tension=self._grip.tension,
                pushes=pushes,
            )
        )
        self._along, self._targets = along, targets
        self._elapsed += PLAN_PERIOD if pace else 0.0
        if not plan.halt:
            self._last = plan

    def _wheel_pushes(self, poses: Array) -> Array:
        """Forces and moments of the wheels in frame w, shape (vehicles, 3); NaN if not known."""
        pushes = np.full((len(poses), 3), np.nan)
        for v, state in enumerate(self._states):
            if isinstance(state, VehicleState) and len(state.push) == 3:
                forward, aside, moment = state.push
                pushes[v] = velocity_from_twist(Twist(forward, moment, aside), poses[v, 2])
        return pushes

    def _plan_next_step(
        self, estimate: TeamEstimate, obstacles: Sequence[DiscObstacle], pace: float
    ) -> tuple[TowingPlan, float]:
        """The plan for one step on, or for the welder's place if that has none; and its pace.

        While the last plan allowed no step, a plan for the welder's place comes first: where that
        leads away from something, no step is worth a plan.
        """
        step = pace * self._setting.seam.settings.speed * PLAN_PERIOD
        here = None
        if not pace or self._shapeless:
            here = self._plan_ahead(estimate, obstacles, 0.0)
            if not pace or here.retreat:
                return here, 0.0
        if self._is_next_step_worth_planning(estimate, obstacles, step):
            plan = self._plan_ahead(estimate, obstacles, step)
            if not (plan.halt or plan.retreat):
                return plan, pace
        return here or self._plan_ahead(estimate, obstacles, 0.0), 0.0

    def _is_next_step_worth_planning(
        self, estimate: TeamEstimate, obstacles: Sequence[DiscObstacle], step: float
    ) -> bool:
        """Whether the next step is worth a plan.

        A welder that waited for a shape goes on only if there is one so far on that noise of the
        poses cannot take it away again.
        """
        noise = OUTLIER_SIGMAS * float(estimate.sigmas[:, 0].max())
        if not self._shapeless or noise <= step:
            return True
        plan = self._plan_ahead(estimate, obstacles, noise)
        return not (plan.halt or plan.retreat)

    def _plan_ahead(
        self, estimate: TeamEstimate, obstacles: Sequence[DiscObstacle], ahead: float
    ) -> TowingPlan:
        """The plan for a welder so many metres further along its seam."""
        poses, last, stopped = estimate.poses, len(self._followers) - 1, self._standing.disobedient
        welder = self._setting.seam.pose_at(self._along + ahead)
        if self._off_plan(estimate, last) > WELDER_OFF_PLAN:
            welder = poses[-1]
        return self._planner.plan(
            PlanInputs(poses, welder, PLAN_PERIOD, self._last, obstacles, stopped, estimate.sigmas)
        )

    def _send_targets(self, estimate: TeamEstimate, plan: TowingPlan, along: float) -> Array:
        """Command each vehicle towards its pose; returns where they are sent."""
        before, poses, seam = self._targets, estimate.poses, self._setting.seam
        if before is None:
            before = poses if self._last is None else self._last.held_poses
        targets = before.copy() if plan.halt else plan.held_poses.copy()
        before, stays = before.copy(), (targets == poses).all(axis=1)
        if not plan.halt:
            targets[:, :2] += self._grip.give_way()
        before[-1], targets[-1] = seam.pose_at(self._along), seam.pose_at(along)
        lost, welder = self._poses.lost(estimate), len(self._followers) - 1
        for v, (vehicle, follower) in enumerate(
            zip(self._team.vehicles, self._followers, strict=True)
        ):
            stopped = v < welder and (v in self._standing.stopped or stays[v])
            if v in lost or v in self._standing.runaways or stopped:
                follower.reset()
                targets[v], self._asked[v] = poses[v], AT_REST
            else:
                self._asked[v] = follower.follow(poses[v], before[v], targets[v], PLAN_PERIOD)
            with suppress(VehicleFault):  # its next state reports so too
                vehicle.command(self._asked[v])
        return targets

    def _off_plan(self, estimate: TeamEstimate, v: int) -> float:
        """Metres, less the noise, that a vehicle is from where it is to be."""
        one, welder = estimate.estimates[v], v == len(self._followers) - 1
        if self._targets is None or v in {*self._poses.lost(estimate), *self._standing.doubted}:
            return 0.0
        target = self._setting.seam.pose_at(self._along) if welder else self._targets[v]
        return hypot(*(one.pose - target)[:2]) - 3 * one.position_sigma

    def _reason_to_wait(self, estimate: TeamEstimate) -> WaitingReason | None:
        """Why the welder must wait, whatever the plan is."""
        team = self._setting.team
        gone = [v for v, s in enumerate(self._states) if isinstance(s, VehicleLinkLost)]
        if gone:
            return WaitingReason(f"vehicle {gone[0] + 1}: {self._states[gone[0]]}", device=True)
        lost = self._poses.lost(estimate)
        if lost:
            v, why = next(iter(lost.items()))
            return WaitingReason(f"the pose of vehicle {v + 1} is lost: {why}")
        waiting = self._standing.reason_to_wait(estimate, self._last)
        if waiting is None and (pull := self._grip.count_hard_pull()):
            force, v = pull
            name, most = team.name_of(v), team.force
            words = f"the cable pulls at {name} with {force:.0f} N of the {most:g} N that it can"
            return WaitingReason(f"{words} pull", device=True)
        *towing, welder = (self._off_plan(estimate, v) for v in range(len(self._followers)))
        if waiting is None and welder > WELDER_OFF_PLAN:
            return WaitingReason(f"the welder is {1e3 * welder:.0f} mm off its plan", device=True)
        limit = VEHICLE_OFF_PLAN * (BACK_ON_PLAN_SHARE if self._strayed else 1.0)
        self._strayed = max(towing) > limit
        if waiting is None and self._strayed:
            v = int(np.argmax(towing))
            off = f"{1e3 * towing[v]:.0f} mm from where it was sent"
            return WaitingReason(f"vehicle {v + 1} is {off}", device=True)
        return waiting

    def _obstacle_in_way(
        self, estimate: TeamEstimate, obstacles: Sequence[DiscObstacle]
    ) -> WaitingReason | None:
        """The obstacle that the welder's body would come too near to, if there is one."""
        setting = self._setting
        welder = estimate.estimates[-1]
        nearest, name = setting.seam.nearest_obstacle(welder.pose, self._along, obstacles)
        gap = nearest - setting.team.body_radius - 2 * welder.position_sigma
        self._blocked = gap < setting.clearance + (SPARE_CLEARANCE if self._blocked else 0.0)
        if not self._blocked:
            return None
        return WaitingReason(
            f"{name} is in the welder's way: it comes as near as {1e3 * max(gap, 0.0):.0f} mm"
        )

    def _stop_vehicles(self) -> None:
        for vehicle in self._team.vehicles:
            vehicle.stop()
