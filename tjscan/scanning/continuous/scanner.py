"""The continuous scan: follow the groove in one motion, and measure it on the way."""

from __future__ import annotations

from collections import deque
from functools import partial
from typing import Final

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array, unit_vector
from tjscan.laser.line_laser import StreamingLaser
from tjscan.laser.profile import Profile
from tjscan.recording.journal import Journal
from tjscan.robot.following import Following, start_following
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan.robot.time_optimal import PathTiming
from tjscan.scanning import retries, sections_before
from tjscan.scanning.continuous.fusing import ProfileFuser
from tjscan.scanning.continuous.path_ahead import FollowedPath, PathAhead
from tjscan.scanning.continuous.poses import ActualPoses
from tjscan.scanning.continuous.seam_ahead import (
    PLANNING_SPACING,
    SeamAhead,
    planning_sections,
    predict_seam,
)
from tjscan.scanning.journal import ScanEvent, ScanResult, StopReason, groove_length
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.profile_taker import ScanSetup
from tjscan.scanning.scanner import Scanner
from tjscan.scanning.section import ProfileView, ScannedSection, Sections, StepRequest, Substep
from tjscan.scanning.smooth import tube_fit_predictor
from tjscan.scanning.stopping import StopRequest

PROFILE_PERIOD: Final = 0.005
"""Seconds from profile to profile."""

SETTLING_TIME: Final = 0.3
"""Seconds after the end of a path in which the arm, which lags behind, comes to rest."""

FEWEST_SECTIONS_TO_PLAN: Final = 3
"""Sections to which a seam is fitted before the path is led on along it."""


class ContinuousScanner(Scanner):
    """A scan that does not stop, along a path that grows ahead of what was measured.

    Where the groove is lost, the arm comes to rest on the path that was checked, and steps on as
    the stepwise scan does until the groove is read again.

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
    stop : StopRequest, optional
        Asks for an end before the plan is fulfilled.

    Raises
    ------
    ConfigurationError
        If the laser does not stream.
    """

    def __init__(
        self,
        setup: ScanSetup,
        plan: ScanPlan,
        journal: Journal,
        kinematics: Kinematics,
        limits: MotionLimits,
        stop: StopRequest | None = None,
    ) -> None:
        predict = tube_fit_predictor(plan)
        super().__init__(
            setup, plan, journal, lambda done, step: predict(planning_sections(done), step), stop
        )
        if not isinstance(setup.laser, StreamingLaser):
            raise errors.ConfigurationError(
                "this laser's driver takes profiles one by one and does not say when: scan "
                "stepwise",
                key="scan.mode",
            )
        self._laser = setup.laser
        p_s_t = np.array((plan.offset, 0.0, plan.standoff))
        timing = PathTiming(kinematics, limits, plan.speed)
        self._planner = PathAhead(kinematics, timing, setup.T_f_s, p_s_t)
        self._poses = ActualPoses(kinematics)
        self._fuser = ProfileFuser(plan.section_spacing, p_s_t)
        self._along_b = np.zeros(3)
        self._section_lengths: list[float] = []
        self._start_length = 0.0

    def run(self, T_b_f_first: Array, T_b_f_second: Array) -> ScanResult:
        """Scan from two taught flange poses. See `Scanner.run`."""
        state = self._taker.move_joint_to_pose(T_b_f_first)
        self._scan_taught("first", state)
        path = self._planner.straight(state.q, T_b_f_second, state.time)
        ahead = self._planner.groove_point(T_b_f_second) - self._planner.groove_point(state.T_b_f)
        self._along_b, self._start_length = unit_vector(ahead), path.length
        self._section_lengths = [0.0]
        self._fuser.start_at(state.T_b_f @ self._setup.T_f_s, 0.0)
        return self._scan_on(path)

    def _scan_until_done(self) -> ScanResult:
        """Go on from where the arm stands."""
        state = self._setup.arm.state()
        length = groove_length(self._log.sections)
        self._section_lengths = np.concatenate(
            ([0.0], np.cumsum(_chords(self._log.sections)))
        ).tolist()
        self._fuser.start_at(state.T_b_f @ self._setup.T_f_s, length)
        return self._scan_on(FollowedPath.standing(state.q, length, state.time))

    def _scan_on(self, path: FollowedPath) -> ScanResult:
        """Follow, and step where that fails, until the plan is fulfilled or nothing leads on."""
        while True:
            path = self._follow(path)
            if (stop := self._reason_to_stop()) is not None:
                return self._end_scan(stop)
            raise NotImplementedError

    def _follow(self, path: FollowedPath) -> FollowedPath:
        """Follow a path, extending it, until it ends; gives the last one."""
        pending: deque[Profile] = deque()
        with start_following(self._setup.arm) as following:
            if path.end > path.gone.times[0] and path.gone.speeds.any():
                following.replace(path.motion)
            for profile in self._laser.stream(PROFILE_PERIOD):
                self._stop.raise_if_stop_now()
                states = following.states()
                self._poses.add(states)
                pending.append(profile)
                while pending and self._poses.cover(pending[0].time):
                    now = pending[0].time
                    if self._take(pending.popleft()):
                        path = self._lead_on(following, path, now)
                if profile.time > path.end + SETTLING_TIME:
                    return path
        raise AssertionError  # a stream has no end

    def _take(self, profile: Profile) -> bool:
        """Record a profile, read what it makes whole; whether there are sections to plan with."""
        state = self._poses.at(profile.time)
        T_b_s = state.T_b_f @ self._setup.T_f_s
        index = len(self._log.sections)
        view = ProfileView(
            index, Substep.PASSING, state.T_b_f, T_b_s, profile, state.time, state.q
        )
        self._log.record(view)
        found = False
        for length, fused in self._fuser.add(view, self._along_b):
            found |= self._read(length, fused)
        return found

    def _read(self, length: float, view: ProfileView) -> bool:
        """Read a section; whether one was found."""
        view = ProfileView(
            len(self._log.sections), view.substep, view.T_b_f, view.T_b_s, view.profile, view.time,
            view.q,
        )
        before = planning_sections(self._log.sections)
        try:
            section = sections_before.read_section(
                self._setup.read,
                view,
                lambda groove: self._plan.target_pose_in_sensor(groove.work_angle),
                before,
            )
            sections_before.check_section_orientation(section.groove)
        except errors.GrooveNotFound:
            return False
        self._log.record(view)
        self._finish_section(section)
        self._section_lengths.append(length)
        return True

    def _lead_on(self, following: Following, path: FollowedPath, now: float) -> FollowedPath:
        """Lead the path on along the seam that the sections show."""
        sections = planning_sections(self._log.sections)
        if len(sections) < FEWEST_SECTIONS_TO_PLAN:
            return path
        try:
            seam = predict_seam(sections, self._plan, self._plan.horizon)
        except errors.TubesNotFound:
            return path
        start = self._section_lengths[-1]
        self._along_b = seam.T_b_t[0, :3, 0]
        end = np.inf
        if self._plan.length is not None:
            end = self._start_length + self._plan.length + self._plan.section_spacing
        if path.length > end - 1e-4:
            return path
        new = self._planner.extend(path, seam, start, end, now)
        if new is None:
            return path
        try:
            following.replace(new.motion)
        except (errors.PoseUnreachable, errors.ArmFault):
            return path
        return new

    def _reason_to_stop(self) -> StopReason | None:
        if self._plan.length is not None:
            left = self._start_length + self._plan.length - self._section_lengths[-1]
            if left < self._plan.section_spacing:
                return StopReason.LENGTH
        return None


def _chords(sections: Sections) -> Array:
    origins = np.array([section.T_b_g[:3, 3] for section in sections])
    return np.linalg.norm(np.diff(origins, axis=0), axis=1)
