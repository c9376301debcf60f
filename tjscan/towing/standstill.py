"""Vehicles that do not drive though they should, and why and how long the welder waits."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, hypot, inf, isfinite, log, radians
from typing import Final

import numpy as np

from tjscan.core.devices import EventListener
from tjscan.core.errors import TowHalted, VehicleFault, VehicleLinkLost
from tjscan.core.frames import Array
from tjscan.towing.following import velocity_from_twist
from tjscan.towing.grip import EASED_GRIP_SHARE, USABLE_GRIP_SHARE
from tjscan.towing.pose_filter import TeamEstimate, VehiclePoseEstimate
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.shape.estimate import BEND_DEVIATIONS, LEAST_ANGLE_DEVIATION
from tjscan.towing.shape.plan import TowingPlan
from tjscan.vehicle.vehicle import Twist, VehicleState

SHORTEST_JUDGED_WINDOW: Final = 3.0
"""Seconds of motion that are judged, at least: the lag of a vehicle is short against them."""

LONGEST_JUDGED_WINDOW: Final = 30.0
"""The same at most, when much of it is needed to distinguish a standstill from noise."""

LEAST_WAY_TO_JUDGE_STANDSTILL: Final = 0.02
"""Metres that a vehicle must have been commanded to go before its standstill means anything."""

AT_TARGET_DISTANCE: Final = 2e-3
"""Metres within which a vehicle is where it was sent."""

LEAST_DRIVEN_SHARE: Final = 0.6
"""Share of the commanded way that a vehicle goes at least, if it drives: its wheels slip."""

STANDSTILL_ERROR_RATE: Final = 1e-6
"""Probability at most with which a check takes a driving vehicle for one at a standstill."""

DECIDING_EVIDENCE: Final = log(1 / STANDSTILL_ERROR_RATE)

EXPECTED_EVIDENCE_RATIO: Final = 2.0
"""Evidence to be expected in a window, over what is needed: it is found in spite of noise."""

FIRST_RETRY_SECONDS: Final = 10.0
"""Seconds after which a stopped vehicle is commanded to drive again; twice as long after each
time that it did not."""

TAUT_CABLE_CHORD_SHARE: Final = 0.98
"""Chord of a piece of cable beside a stopped vehicle, as share of its length, at which the
welder waits."""

SLACK_CABLE_CHORD_SHARE: Final = 0.95
"""The same from which on it goes slower, and below which it goes on after it waited: what noise of
the poses changes is less than the way between the two."""

CHORD_DEVIATIONS: Final = 2.0
"""Standard deviations of poses by which a chord must surely be too long."""

WATCHED_BEND: Final = 0.75
"""Share of the limit above which that is looked at: angles of a cable that is taut or
pressed together are known badly and are small."""

EASED_BEND: Final = radians(0.5)
"""Radians that an angle must be below that before the welder goes on after it waited."""

LEAST_WELDING_PACE: Final = 0.1
"""Share of its speed with which it goes on until it waits: ever slower, it would never arrive."""

FIGURE_WITH_UNIT: Final = re.compile(r"\d+(\.\d+)?(?= (mm|s|m/min|N)\b|°)")
"""A figure with its unit: if only such differ, nothing new is to be reported."""


DRIVEN_WINDOW: Final = 30
"""Periods, 3 s of them, over which commanded way and odometry are compared."""

LEAST_RUNAWAY_MOTION: Final = (0.01, radians(4.0))
"""Metres and radians by which they may differ without a cause, and below which a vehicle does not
drive, or turn."""

RUNAWAY_MOTION_SHARE: Final = 0.4
"""The same as a share of what is commanded: drives follow roughly."""

RESTING_WINDOW: Final = 10
"""Periods, a second of them, over which a vehicle that does not drive any more is told from one
that drives elsewhere: it is at a standstill."""

RESTING_SHARE: Final = 0.1
"""Share of the least motion of a runaway in that time."""

LEAST_TURNING_SHARE: Final = 0.1
"""Share of the commanded way below which wheels do not turn: what is moved then is dragged."""

DRIVE_LAG: Final = 0.3
"""Seconds by which drives may be behind their commands."""

MOST_SLIPPING_SHARE: Final = 1.5
"""Share of the wheels' way by which it is off at most if they slip: further back, it is pushed."""

LEAST_SLIPPING_SHARE: Final = 0.8
"""Share of the unexplained way that is against the wheels' way if they slip; else a vehicle is
moved by something other than its wheels."""


@dataclass(frozen=True, slots=True)
class WaitingReason:
    """Why the welder waits.

    Parameters
    ----------
    why : str
        In a sentence without its full stop.
    device : bool
        Whether a vehicle or the link to it is to blame.
    for_good : bool
        Whether waiting changes nothing.
    """

    why: str
    device: bool = False
    for_good: bool = False


class WaitingPatience:
    """Reports that the welder waits, and that it goes on; gives up when it has waited for too long.

    Parameters
    ----------
    seconds : float
        For which it may wait.
    report : callable
        Receives events: a name and a sentence.
    """

    def __init__(self, seconds: float, report: EventListener) -> None:
        self._seconds, self._report = seconds, report
        self._reported: set[str] = set()
        self._since = 0.0

    def update(self, now: float, waiting: WaitingReason | None, along: float) -> None:
        """Take in whether the welder waits.

        Parameters
        ----------
        now : float
            Seconds.
        waiting : WaitingReason or None
            Why it waits, if it does.
        along : float
            Where along its seam, metres.

        Raises
        ------
        TowHalted
            If it waited for too long, or waiting changes nothing.
        VehicleFault
            The same, if a vehicle or the link to it is to blame.
        """
        if waiting is None:
            if self._reported:
                self._report("goes on", f"after {now - self._since:.1f} s")
            self._reported.clear()
            return
        if not self._reported:
            self._since = now
        if (words := FIGURE_WITH_UNIT.sub("", waiting.why)) not in self._reported:
            self._report("waits", waiting.why)
            self._reported.add(words)
        if waiting.for_good or now - self._since > self._seconds:
            sentence = (
                f"{waiting.why}. The weld is halted {1e3 * along:.0f} mm along the seam; "
                "when the way is clear, go on with tjscan tow run --resume DIR"
            )
            raise VehicleFault(sentence) if waiting.device else TowHalted(sentence)


class RunawayCheck:
    """Whether the odometry of one vehicle shows that it does not follow its commands."""

    def __init__(self) -> None:
        self._motions: deque[tuple[Array, Array]] = deque(maxlen=DRIVEN_WINDOW)
        self._retry, self._until, self._words = FIRST_RETRY_SECONDS, -inf, ""

    def update(self, now: float, asked: Array, driven: Array, period: float) -> str:
        """How far it drove off its commands, in words; empty if it obeys, or does not move.

        Once it did not obey it counts so for `FIRST_RETRY_SECONDS`, twice as long each time.

        Parameters
        ----------
        now : float
            Seconds.
        asked, driven : ndarray, shape (3,)
            Way and turn in the last period as commanded and by odometry, metres and radians.
        period : float
            Seconds.
        """
        self._motions.append((asked, driven))
        sent, drove = np.sum(self._motions, axis=0)
        fastest = np.max([_way_and_turn(one) for one, _ in self._motions], axis=0) / period
        off, went = _way_and_turn(drove - sent), _way_and_turn(drove)
        allowed = RUNAWAY_MOTION_SHARE * _way_and_turn(sent) + DRIVE_LAG * fastest
        latest = np.sum([one for _, one in list(self._motions)[-RESTING_WINDOW:]], axis=0)
        is_at_rest = (_way_and_turn(latest) < RESTING_SHARE * np.array(LEAST_RUNAWAY_MOTION)).all()
        far = (off > LEAST_RUNAWAY_MOTION + allowed) & (went > LEAST_RUNAWAY_MOTION)
        if far.any() and not is_at_rest:
            if now > self._until:
                self._until = now + self._retry
                self._retry *= 2
            way, turn = 1e3 * off[0], degrees(off[1])
            self._words = f"it drove {way:.0f} mm and turned {turn:.0f}° off its commands"
            self._motions.clear()
        return self._words if now < self._until else ""


def _way_and_turn(motion: Array) -> Array:
    """Amounts of a motion along x and y, and in heading: metres and radians, shape (2,)."""
    return np.array((hypot(motion[0], motion[1]), abs(motion[2])))


def describe_unexplained_way(one: VehiclePoseEstimate) -> tuple[str, str]:
    """Name and sentence of what an unexplained way shows; empty if there is none."""
    off, way = one.unexplained, one.way
    if not off.any():
        return "", ""
    against = -(off @ way) > LEAST_SLIPPING_SHARE * hypot(*off) * hypot(*way) > 0
    if against and hypot(*off) < MOST_SLIPPING_SHARE * hypot(*way):
        went = hypot(*(off + way))
        turned = f"its wheels turned by {1e3 * hypot(*way):.0f} mm"
        return "slips", f"{turned}, and it went {1e3 * went:.0f} mm"
    return "moved", f"by {1e3 * hypot(*off):.0f} mm, and not by its wheels, if its poses are right"


class StandstillCheck:
    """Whether one vehicle is at a standstill; without a fault of its own it is tried again.

    Two hypotheses are compared: it goes `LEAST_DRIVEN_SHARE` of the way that it is commanded to
    go, and it goes none. Its measured way is off by the noise of the two poses at its ends. The
    logarithm of the likelihoods' ratio decides once it passes log(1 / `STANDSTILL_ERROR_RATE`):
    the other hypothesis then gives such a ratio no oftener than that (Wald, Sequential analysis,
    1947, 3.2). The window is as long as it takes until either is to be expected to pass it by far.
    """

    def __init__(self) -> None:
        self._way: deque[_WayPoint] = deque()
        self._since: float | None = None
        self._retry = FIRST_RETRY_SECONDS
        self._faulty = self.doubted = False
        """Whether it is at a standstill, or was and has not been seen to drive since its retry."""

    def update(
        self, time: float, pose: Array, asked: Array, *, sigma: float, fault: bool = False
    ) -> bool:
        """Whether it is at a standstill for good.

        Parameters
        ----------
        time : float
            Seconds.
        pose : ndarray, shape (3,)
            Where it is.
        asked : ndarray, shape (2,)
            Way along x and y that it was asked to go since the last update, metres.
        sigma : float
            Standard deviation of its place, metres.
        fault : bool, optional
            Whether it reports one itself.
        """
        if fault:  # when it is mended, the vehicle reports so itself
            self._since, self._faulty, self.doubted = None, True, True
            self._way.clear()
            return True
        if self._faulty:
            self._faulty = self.doubted = False
        if self._since is not None:
            if time - self._since < self._retry:
                return True
            self._retry *= 2
            self._since = None
            self._way.clear()
        if not asked.any():  # where it went meanwhile would be taken for a way against commands
            self._way.clear()
        total = asked + (self._way[-1].asked if self._way else 0.0)
        self._way.append(_WayPoint(time, pose[:2], total, sigma))
        while self._can_judge_from(1) or time - self._way[0].time > LONGEST_JUDGED_WINDOW:
            self._way.popleft()
        if not self._can_judge_from(0):
            return False
        evidence = self._standstill_evidence()
        if evidence > DECIDING_EVIDENCE:
            self.doubted, self._since = True, time
        elif evidence < -DECIDING_EVIDENCE:
            self.doubted, self._retry = False, FIRST_RETRY_SECONDS
        return self._since is not None

    def _can_judge_from(self, k: int) -> bool:
        """Whether the way from the one at k on is enough to judge it by."""
        if k >= len(self._way):
            return False
        begin, end = self._way[k], self._way[-1]
        asked, noise = hypot(*(end.asked - begin.asked)), hypot(begin.sigma, end.sigma)
        expected = (
            LEAST_DRIVEN_SHARE * asked / noise
        ) ** 2 / 2 >= EXPECTED_EVIDENCE_RATIO * DECIDING_EVIDENCE
        return (
            end.time - begin.time >= SHORTEST_JUDGED_WINDOW
            and asked > LEAST_WAY_TO_JUDGE_STANDSTILL
            and expected
        )

    def _standstill_evidence(self) -> float:
        """Logarithm of the likelihoods' ratio, a standstill over driving."""
        begin, end = self._way[0], self._way[-1]
        driven, moved = LEAST_DRIVEN_SHARE * (end.asked - begin.asked), end.place - begin.place
        off, still = np.sum((moved - driven) ** 2), np.sum(moved**2)
        return float((off - still) / (2 * (begin.sigma**2 + end.sigma**2)))


@dataclass(frozen=True, slots=True, eq=False)
class _WayPoint:
    """A vehicle at a time, where it is, how far it was asked to go until then, and the noise."""

    time: float
    place: Array
    asked: Array
    sigma: float


class StandstillWatch:
    """Notices vehicles at a standstill, and what that means for the weld.

    Parameters
    ----------
    cable : Cable
    team : TowingTeam
    report : callable
        Receives events: a name and a sentence.

    Attributes
    ----------
    stopped : tuple of int
        Those at a standstill for good.
    doubted : tuple of int
        Those at a standstill, or not seen to drive since.
    runaways : tuple of int
        Those that do not follow their commands.
    """

    def __init__(self, cable: Cable, team: TowingTeam, report: EventListener) -> None:
        self._cable, self._team, self._report = cable, team, report
        self._checks = [StandstillCheck() for _ in team.held_links]
        self._runaways = [RunawayCheck() for _ in team.held_links]
        self._reported: dict[int, str] = {}
        self._states: Sequence[VehicleState | VehicleFault] = ()
        self.doubted: tuple[int, ...] = ()
        self._taut = self._drawn = self._bent = False
        self.stopped: tuple[int, ...] = ()
        self.runaways: tuple[int, ...] = ()

    def update(
        self,
        now: float,
        period: float,
        states: Sequence[VehicleState | VehicleFault],
        asked: Sequence[Twist],
        estimate: TeamEstimate,
        targets: Array | None = None,
    ) -> None:
        """Take in what the vehicles did in a period with the twists that they were asked for.

        One that is at its target, shape (vehicles, 3), is at no standstill, whatever it was asked.
        """
        stopped, runaways = list[int](), list[int]()
        poses, sigmas = estimate.poses, estimate.sigmas
        for v, state in enumerate(states):
            told = driven = period * velocity_from_twist(asked[v], poses[v, 2])
            if isinstance(state, VehicleState):
                driven = period * velocity_from_twist(state.odometry, poses[v, 2])
            astray, check = self._runaways[v].update(now, told, driven, period), self._checks[v]
            way = told[:2]
            if targets is not None and hypot(*(poses[v] - targets[v])[:2]) < AT_TARGET_DISTANCE:
                way = np.zeros(2)
            turns = hypot(*driven[:2]) > LEAST_TURNING_SHARE * hypot(*told[:2])
            moved = describe_unexplained_way(estimate.estimates[v])[0] == "moved"
            if moved and turns:  # what else moves it shows nothing of its drives
                check = self._checks[v] = StandstillCheck()
            if astray:
                runaways.append(v)
                check = self._checks[v] = StandstillCheck()
            fault = isinstance(state, VehicleFault) or bool(state.fault)
            if check.update(now, poses[v], way, sigma=sigmas[v, 0], fault=fault):
                stopped.append(v)
                if v not in self.doubted and not isinstance(state, VehicleLinkLost):
                    why = _describe_fault(state) or "it is commanded to drive, and does not move"
                    self._report("stopped", f"vehicle {v + 1}: {why}")
            self._report_motion(v, astray, estimate.estimates[v])
        doubted = tuple(v for v, check in enumerate(self._checks) if check.doubted)
        for v in sorted(set(self.doubted) - set(doubted)):
            self._report("drives again", f"vehicle {v + 1}")
        self._states, self.stopped, self.doubted = states, tuple(stopped), doubted
        self.runaways = tuple(runaways)

    def _report_motion(self, v: int, astray: str, one: VehiclePoseEstimate) -> None:
        """Report how a vehicle's motion differs from its commands, or from its wheels'."""
        name, words = describe_unexplained_way(one)
        if name == "moved" and {v - 1, v + 1} & set(self.doubted):
            name = ""  # by the cable, which the one at a standstill holds
        if astray:
            name, words = "off plan", astray
        if name and self._reported.get(v) != name and not self._checks[v].doubted:
            self._report(name, f"vehicle {v + 1}: {words}")
        self._reported[v] = name

    @property
    def disobedient(self) -> tuple[int, ...]:
        """Vehicles that plans must take for where they are: at a standstill, or running away."""
        return tuple(sorted({*self.stopped, *self.runaways}))

    def reason_to_wait(
        self, estimate: TeamEstimate, last: TowingPlan | None
    ) -> WaitingReason | None:
        """Why the welder must wait for those at a standstill, or for a cable drawn straight.

        Parameters
        ----------
        estimate : TeamEstimate
        last : TowingPlan or None
            That was sent last.
        """
        welder, poses, sigmas = self._team.welder, estimate.poses, estimate.sigmas
        if welder in self.stopped:
            why = _describe_fault(self._states[welder]) or "it does not move"
            return WaitingReason(f"the welder is stopped: {why}", device=True)
        if self._reported.get(welder) == "moved":  # it would weld on where it is taken to be
            _, words = describe_unexplained_way(estimate.estimates[welder])
            return WaitingReason(f"the welder was moved {words}: see where it is", for_good=True)
        if self.runaways:
            name = self._team.name_of(self.runaways[0])
            return WaitingReason(f"{name} does not follow its commands", device=True)
        share, v = self._tautest_piece(poses)
        self._taut = share >= (SLACK_CABLE_CHORD_SHARE if self._taut else TAUT_CABLE_CHORD_SHARE)
        if self._taut:
            why = f"vehicle {v + 1} is stopped, and the cable beside it is taut"
            return WaitingReason(why, device=True)
        pull = EASED_GRIP_SHARE if self._drawn else USABLE_GRIP_SHARE
        chords = self._cable.longest_chords(self._team.held_links, pull * self._team.force)
        beyond = self._chords(poses) - chords - np.sqrt(2) * CHORD_DEVIATIONS * sigmas[:, 0]
        self._drawn = bool(beyond.max() > 0.0) and isfinite(self._team.force)
        v = int(beyond.argmax())
        if self._drawn:
            why = f"the cable before {self._team.name_of(v)} is drawn straight"
            return WaitingReason(why, device=True)
        return None if last is None else self._bent_too_far(last)

    def _bent_too_far(self, last: TowingPlan) -> WaitingReason | None:
        """Whether a joint may be bent beyond its limit: by two deviations more than is estimated.

        Where a plan would bend it is the planner's to heed.
        """
        angles, limit = np.abs(last.estimate), self._cable.joint_limit
        known = LEAST_ANGLE_DEVIATION if last.deviations is None else last.deviations
        doubt = BEND_DEVIATIONS * (np.zeros(len(angles)) + known)
        worst = np.where(angles > WATCHED_BEND * limit, angles + doubt, 0.0)
        pieces = np.searchsorted(self._team.held_links, np.arange(len(angles)))
        beside = np.isin(pieces, self.doubted) | np.isin(pieces - 1, self.doubted)
        joint = max(range(len(worst)), key=lambda one: (worst[one], beside[one]))
        self._bent = bool(worst[joint] > limit - (EASED_BEND if self._bent else 0.0))
        if not self._bent:
            return None
        angle, off, most = np.degrees((angles[joint], doubt[joint], limit))
        why = f"joint {joint} is bent by {angle:.1f}° ± {off:.1f}°, and its limit is {most:.1f}°"
        if beside[joint]:
            v = next(v for v in (pieces[joint], pieces[joint] - 1) if v in self.doubted)
            return WaitingReason(f"vehicle {v + 1} is stopped, and beside it {why}", device=True)
        return WaitingReason(why)

    def pace(self, poses: Array) -> float:
        """Share of the welding speed that the pieces of cable beside them allow."""
        share, _ = self._tautest_piece(poses)
        return float(
            np.clip(
                (TAUT_CABLE_CHORD_SHARE - share)
                / (TAUT_CABLE_CHORD_SHARE - SLACK_CABLE_CHORD_SHARE),
                LEAST_WELDING_PACE,
                1.0,
            )
        )

    def _chords(self, poses: Array) -> Array:
        """Of the pieces of cable before each vehicle, metres."""
        steps = np.diff(np.vstack((self._cable.root[:2], poses[:, :2])), axis=0)
        return np.asarray(np.hypot(steps[:, 0], steps[:, 1]))

    def _tautest_piece(self, poses: Array) -> tuple[float, int]:
        """Largest chord of a piece beside one at a standstill, over its length, and which one."""
        lengths = self._cable.link_length * np.diff(self._team.held_links, prepend=-1)
        shares = self._chords(poses) / lengths
        beside = [
            (float(shares[k]), v) for v in self.doubted for k in (v, v + 1) if k < len(shares)
        ]
        return max(beside, default=(0.0, 0))


def _describe_fault(state: VehicleState | VehicleFault) -> str:
    return state.fault if isinstance(state, VehicleState) else str(state)
