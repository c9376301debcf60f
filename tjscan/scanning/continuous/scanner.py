"""The continuous scan: follow the groove in one motion, and measure it on the way."""

from __future__ import annotations

from dataclasses import replace
from math import dist
from typing import Final

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile, ProfileRepeats
from tjscan.recording.journal import Journal
from tjscan.robot.arm import ArmState
from tjscan.robot.following import Following
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan.scanning import sections_before
from tjscan.scanning.continuous.clocks import (
    LATEST_ARRIVAL,
    LaserClock,
    ShuttleViews,
    clock_offset,
)
from tjscan.scanning.continuous.fusing import ProfileFuser
from tjscan.scanning.continuous.path_ahead import FollowedPath, PathAhead
from tjscan.scanning.continuous.poses import ActualPoses
from tjscan.scanning.continuous.seam_ahead import predict_seam, seam_direction
from tjscan.scanning.continuous.stream import PlacedProfiles, devices_that_follow
from tjscan.scanning.journal import (
    ScanEvent,
    ScanResult,
    StopReason,
    groove_length,
)
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.profile_taker import ScanSetup
from tjscan.scanning.scanner import Scanner
from tjscan.scanning.section import ProfileView, ScannedSection, Sections, StepRequest, Substep
from tjscan.scanning.sections_before import PLANNING_SPACING, planning_sections
from tjscan.scanning.smooth import tube_fit_predictor
from tjscan.scanning.stopping import StopRequest

SETTLING_TIME: Final = 0.3
"""Seconds after the end of a path in which the arm, which lags behind, comes to rest."""

FEWEST_SECTIONS_TO_PLAN: Final = 3
"""Sections, `PLANNING_SPACING` apart, to which a seam is fitted before the path is led along it."""

CLOSING_SPACINGS: Final = 1.5
"""Spacings of sections within which the groove is back at the first one."""

LEAST_TAUGHT_DISTANCE: Final = 10e-3
"""Metres from one taught pose to the other: nearer ones do not tell the groove's direction."""

LONGEST_GAP: Final = 8e-3
"""Metres of groove without a section beyond which the arm goes back."""

LEAST_STEP: Final = 5e-3
"""Metres of a step from rest."""

UNSURE_SIGMA: Final = 0.3e-3
"""Metres, standard deviation of a corner from which a section is read in more profiles."""

FEWEST_SHUTTLE_SECTIONS: Final = 6
"""Sections read in each quarter of a shuttle from which the laser's clock is laid on the arm's."""


class ContinuousScanner(Scanner):
    """A scan that does not stop, along a path that grows ahead of what was measured.

    Where the groove is lost, the arm comes to rest on the path that was checked, and makes a step
    as the stepwise scan does; from there it follows the groove again.

    Parameters
    ----------
    setup : ScanSetup
        An arm that follows and a laser that streams, how the laser is mounted, and what reads its
        profiles.
    plan : ScanPlan
        Speed, spacing, direction, view and end.
    journal : Journal
        Receives everything at once.
    kinematics : Kinematics
        Of the arm, as calibrated.
    limits : MotionLimits
        How fast the arm may go.
    T_b_f_second : ndarray, shape (4, 4)
        The second taught pose, from which the plan's length counts, metres.
    stop : StopRequest, optional
        Asks for an end before the plan is fulfilled.

    Raises
    ------
    ConfigurationError
        As `devices_that_follow`.
    """

    def __init__(
        self,
        setup: ScanSetup,
        plan: ScanPlan,
        journal: Journal,
        kinematics: Kinematics,
        limits: MotionLimits,
        T_b_f_second: Array,
        stop: StopRequest | None = None,
    ) -> None:
        predict = tube_fit_predictor(plan)
        super().__init__(
            setup, plan, journal, lambda done, step: predict(planning_sections(done), step), stop
        )
        self._arm, laser = devices_that_follow(setup.arm, setup.laser)
        p_s_t = np.array((plan.offset, 0.0, plan.standoff))
        self._kinematics = kinematics
        self._planner = PathAhead(kinematics, limits, plan.speed, setup.T_f_s, p_s_t)
        self._T_b_f_second = T_b_f_second
        self._second_point = self._planner.groove_point(T_b_f_second)
        self._poses = ActualPoses(kinematics)
        self._clock: LaserClock
        self._stream = PlacedProfiles(laser, self._poses, ProfileRepeats())
        self._fuser = ProfileFuser(plan.section_spacing, p_s_t)
        self._along_b = np.zeros(3)
        self._path_before: FollowedPath
        # Lengths along the groove: of the last section, of the one that a path was planned from
        # last, and of the second taught pose.
        self._length = self._planned_length = self._second_length = 0.0
        self._passed_second = self._left_first = self._closed = False
        self._why_not_on = ""

    def run(self, T_b_f_first: Array, T_b_f_second: Array) -> ScanResult:
        """Scan from two taught flange poses. See `Scanner.run`."""
        first = self._kinematics.inverse(T_b_f_first, near=self._setup.arm.state().q)
        self._planner.check_plan(first, T_b_f_second, self._plan.horizon)
        state = self._taker.move_joint_to_pose(T_b_f_first)
        self._scan_taught("first", state)
        sections_before.check_second_is_ahead(
            self._log.sections[0].T_b_g,
            self._second_point,
            self._plan.direction,
            LEAST_TAUGHT_DISTANCE,
        )
        self._lay_clock(state)
        return self._scan_on(self._straight_to_second())

    def _straight_to_second(self) -> FollowedPath:
        """The way from where the arm stands to the second taught pose; lengths count from here.

        The last section tells the groove's direction. The way from pose to pose does not: where a
        hand's pose sees the groove is not known, and 5 degrees are 20 mm there.
        """
        state, last = self._setup.arm.state(), self._log.sections[-1]
        path = self._planner.straight(state.q, self._T_b_f_second, state.time)
        ahead = self._second_point - self._planner.groove_point(state.T_b_f)
        along = last.T_b_g[:3, 0]
        self._along_b = along if along @ ahead > 0 else -along
        self._length, self._planned_length = 0.0, 0.0
        self._second_length = float(ahead @ self._along_b)
        self._fuser.start_at(state.T_b_f @ self._setup.T_f_s, 0.0)
        return path

    def _scan_until_done(self) -> ScanResult:
        """Go on from where the arm stands, at the last section of a scan that was interrupted."""
        sections = self._log.sections
        self._lay_clock(self._setup.arm.state())
        origins = np.array([section.T_b_g[:3, 3] for section in sections])
        near = CLOSING_SPACINGS * self._plan.section_spacing
        self._left_first = bool(np.linalg.norm(origins - origins[0], axis=1).max() > 2 * near)
        from_second = np.linalg.norm(origins - self._second_point, axis=1)
        nearest = int(from_second.argmin())
        if len(planning_sections(sections)) < FEWEST_SECTIONS_TO_PLAN:
            return self._scan_on(self._straight_to_second())
        self._second_length = groove_length(sections[: nearest + 1])
        if nearest == len(sections) - 1:  # the second pose is still ahead
            ahead = float((self._second_point - origins[-1]) @ seam_direction(sections))
            self._second_length += max(ahead, 0.0)
        return self._scan_on(self._standing(groove_length(sections)))

    def _scan_on(self, path: FollowedPath) -> ScanResult:
        """Follow until the plan is fulfilled; where the arm rests before, from the last section.

        Where that led no further than before, a step is made as the stepwise scan makes it.
        """
        reached = self._length
        while True:
            asked = self._follow(path)
            if (stop := self._reason_to_stop()) is not None:
                return self._end_scan(stop)
            if (ended := self._wait_for_permission()) is not None:
                return ended
            why = f"at {1e3 * self._length:.1f} mm: {self._why_not_on}"
            further = asked or self._length > reached
            before_second = self._length < self._second_length - LONGEST_GAP
            if further:
                if not asked:
                    self._log.record_event(ScanEvent.RETREAT, why)
                ended = self._ended_by(self._return_to_last_section)
                length = self._length
            elif before_second:
                ended = self._ended_by(self._scan_second)
                length = self._second_length
            else:
                self._log.record_event(ScanEvent.STEPWISE, why)
                step = max(min(self._plan.step, self._end_length - self._length), LEAST_STEP)
                ended = self._make_step(step)
                length = self._length + groove_length(self._log.sections[-2:])
            if ended is not None:
                return ended
            on = further and before_second
            path = self._straight_to_second() if on else self._standing(length)
            reached = self._length

    def _scan_second(self) -> None:
        """Read the groove at the second taught pose."""
        self._scan_taught("second", self._taker.move_joint_to_pose(self._T_b_f_second))

    def _standing(self, length: float) -> FollowedPath:
        """No path yet, from the section before which the arm stands."""
        state = self._setup.arm.state()
        self._length, self._planned_length = length, -np.inf
        self._along_b = seam_direction(self._log.sections)
        self._fuser.start_at(state.T_b_f @ self._setup.T_f_s, length)
        return FollowedPath.standing(state.q, length, state.time)

    def _follow(self, path: FollowedPath) -> bool:
        """Follow a path, leading it on along the groove, until the arm rests at its end.

        Gives whether it was asked to rest; it measures a section before it does.
        """
        rests, self._path_before, start = False, path, self._length
        with self._arm.follow() as following:
            stream = self._stream.placed(following, self._clock)
            next(stream)  # a laser takes its time to begin
            if path.leads_on:
                path = path.begun_from_rest(self._setup.arm.state().time)
                following.replace(path.motion)
            for placed in stream:
                self._stop.raise_if_stop_now()
                for state, profile in placed:
                    self._take(state, profile)
                asked = self._stop.asks_for_rest and self._length > start
                lost = self._fuser.gone > self._length + LONGEST_GAP
                if asked or lost or self._closed:
                    if not rests:
                        path, rests = self._lead_to_rest(following, path)
                elif self._length >= self._planned_length + PLANNING_SPACING:
                    self._planned_length = self._length
                    path = self._lead_on(following, path)
                # A laser that is silent is waited for, if it is still needed.
                done = self._reason_to_stop() is not None
                rest = path.end + SETTLING_TIME
                behind = self._poses.latest - following.now
                if following.now > rest if done else self._stream.has_passed(rest + behind):
                    return asked
        raise AssertionError("a stream has no end")

    def _take(self, state: ArmState, profile: Profile) -> None:
        """Record a profile that was taken in passing, and read the sections it completes."""
        view = self._record_view(state, profile)
        for length, views in self._fuser.add(view, self._along_b):
            missed = length > self._length + LONGEST_GAP
            if missed or length > self._end_length or self._closed:
                return
            sections, before = [], planning_sections(self._log.sections)
            for fused in views:
                try:
                    sections.append(self._read(length, fused, before))
                except errors.GrooveNotFound as error:
                    self._why_not_on = str(error)
                else:
                    if _unsureness(sections[-1].groove) < UNSURE_SIGMA:
                        break
            if sections:
                surest = min(sections, key=lambda one: _unsureness(one.groove))
                self._log.record(surest.view)
                self._finish(length, surest)

    def _record_view(self, state: ArmState, profile: Profile) -> ProfileView:
        """Record a profile taken in passing, its time on the arm's clock.

        The one with which the second taught pose is passed counts as taught.
        """
        past = self._fuser.gone >= self._second_length > 0
        substep = Substep.TAUGHT if past and not self._passed_second else Substep.PASSING
        self._passed_second |= past
        sigma = self._clock.sigma_at(profile.time)
        profile = replace(profile, time=state.time, time_uncertainty=sigma)
        T_b_s, index = state.T_b_f @ self._setup.T_f_s, len(self._log.sections)
        view = ProfileView(index, substep, state.T_b_f, T_b_s, profile, state.time, state.q)
        self._log.record(view)
        return view

    def _read(self, length: float, view: ProfileView, before: Sections) -> ScannedSection:
        """Read a section in the profiles about a place.

        Raises
        ------
        GrooveNotFound
            If no groove is read, or another one than was expected.
        """

        def wanted(groove: GrooveSection) -> Array:
            return self._plan.target_pose_in_sensor(groove.work_angle)

        view = replace(view, index=len(self._log.sections))
        section = sections_before.read_section(self._setup.read, view, wanted, before)
        sections_before.check_section_orientation(section.groove)
        last, gone = self._log.sections[-1], length - self._length
        sections_before.check_leads_on(section, last, self._along_b, gone)
        if len(before) > 1:
            origin, behind = before[-2].T_b_g[:3, 3], last.T_b_g[:3, 3]
            step = gone + float(np.linalg.norm(behind - origin))
            ahead = StepRequest(before[-2], origin + step * self._along_b, step)
            sections_before.check_section_one_step_ahead(section, ahead)
            sections_before.check_measures_plausible(section, ahead)
        return section

    def _finish(self, length: float, section: ScannedSection) -> None:
        """Add a section, and see whether the groove is closed with it."""
        self._finish_section(section)
        self._length = length
        if len(planning_sections(self._log.sections)) > 1:  # nearer ones show less than the way
            self._along_b = seam_direction(self._log.sections)
        origins = (one.T_b_g[:3, 3] for one in (section, self._log.sections[0]))
        away, near = dist(*origins), CLOSING_SPACINGS * self._plan.section_spacing
        self._left_first |= away > 2 * near
        self._closed = self._left_first and away < near

    def _lead_on(self, following: Following, path: FollowedPath) -> FollowedPath:
        """Lead the path on along the seam that the sections show, if it can be."""
        sections = planning_sections(self._log.sections)
        end = self._end_length + self._plan.section_spacing
        if len(sections) < FEWEST_SECTIONS_TO_PLAN:
            return path
        try:
            seam = predict_seam(sections, self._plan, self._plan.horizon)
            new = self._planner.extend(path, seam, self._length, end, following.now)
            following.replace(new.motion)
        except (errors.TubesNotFound, errors.PoseUnreachable, errors.PathNotExtended) as error:
            self._why_not_on = str(error)
            # A controller that refused the last path follows the one before.
            return min((path, self._path_before), key=lambda one: abs(one.end - following.end))
        self._path_before = path
        return new

    def _lead_to_rest(self, following: Following, path: FollowedPath) -> tuple[FollowedPath, bool]:
        """Let the path end as soon as the arm can rest on it; whether it does."""
        try:
            new = self._planner.shorten(path, following.now)
            if new is not path:
                following.replace(new.motion)
        except (errors.PoseUnreachable, errors.PathNotExtended):
            return path, False
        return new, True

    @property
    def _length_gone(self) -> float:
        return self._length - self._second_length

    @property
    def _end_length(self) -> float:
        """Length along the groove at which the last section is wanted; infinite without."""
        length = self._plan.length
        return np.inf if length is None else self._second_length + length

    def _reason_to_stop(self) -> StopReason | None:
        """Reason why the scan is done."""
        if self._length > self._end_length - self._plan.section_spacing:
            return StopReason.LENGTH
        return StopReason.CLOSED if self._closed else None

    def _lay_clock(self, state: ArmState) -> None:
        """Move the laser to and fro across the groove, and lay its clock on the arm's.

        Raises
        ------
        LaserFault
            If the groove is not seen, or no offset lets it stand still.
        """
        profiles, arrivals, seen = [], [], []
        path = self._planner.shuttle(state.q, state.time)
        with self._arm.follow() as following:
            stream = self._stream.profiles(following)
            next(stream)
            path = path.begun_from_rest(self._setup.arm.state().time)
            following.replace(path.motion)
            for profile in stream:
                self._stop.raise_if_stop_now()
                if profile is not None:
                    profiles.append(profile)
                    arrivals.append(self._stream.heard - profile.time)
                    if max(arrivals) - min(arrivals) > LATEST_ARRIVAL:
                        raise errors.LaserFault(
                            f"profiles came {min(arrivals):.1f} to {max(arrivals):.1f} s after "
                            "their stamps: these are no times on a clock that runs evenly. Set the "
                            "laser to stamp each profile in seconds, when it is taken"
                        )
                    try:
                        seen.append((profile.time, self._setup.read(profile, prior=None)))
                    except errors.GrooveNotFound as error:
                        self._why_not_on = str(error)
                    behind = self._poses.latest - following.now
                    if profile.time + min(arrivals) > path.end + behind + SETTLING_TIME:
                        break
        # In each quarter of the way: a part of it tells a wrong offset as surely as the right one.
        quarters = np.linspace(path.gone.times[0], path.end + behind, 5)
        late = min(arrivals, default=0.0)
        read, _ = np.histogram([stamp + late for stamp, _ in seen], quarters)
        if read.min() < FEWEST_SHUTTLE_SECTIONS:
            raise errors.LaserFault(
                f"the groove was read in {', '.join(map(str, read))} profiles of the quarters of "
                "the laser's way to and fro across it; in each "
                f"{FEWEST_SHUTTLE_SECTIONS} are needed to find the offset of its clock: "
                f"{self._why_not_on or 'no profiles came'}"
            )
        views = ShuttleViews.of_sections(seen)
        offset, sigma = clock_offset(views, self._poses, self._setup.T_f_s, late)
        middle = seen[len(seen) // 2][0]
        self._clock = LaserClock(
            offset,
            sigma,
            middle,
            (late - offset, float(np.median(arrivals)) - offset),
            self._poses.period,
        )
        for profile in profiles:
            if self._poses.cover(time := self._clock.arm_time(profile.time)):
                self._record_view(self._poses.at(time), profile)
        self._log.record_event(
            ScanEvent.CLOCK,
            f"the arm's clock is {1e3 * offset:.2f} ± {1e3 * sigma:.2f} ms ahead of the laser's, "
            f"from {len(seen)} profiles of a shuttle across the groove",
        )


def _unsureness(groove: GrooveSection) -> float:
    """Largest standard deviation of the corners that are seen, metres."""
    seen = [name not in groove.absent for name in ("p2", "p3", "p4")]
    variances = np.trace(groove.corner_covariances_s[seen], axis1=1, axis2=2)
    return float(np.sqrt(variances.max(initial=0.0)))
