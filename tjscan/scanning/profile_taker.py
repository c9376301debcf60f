"""The arm with the laser on it: moves to set-points and takes profiles that show what is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tjscan.core.errors import LaserFault, PoseUnreachable
from tjscan.core.frames import Array, array_dataclass, inverse_pose
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm, ArmState
from tjscan.scanning.journal import ScanEvent, ScanResultsJournal
from tjscan.scanning.retries import MERGED_PROFILES, MOST_MISSING_PROFILES
from tjscan.scanning.section import ProfileView, SetPoint, Substep
from tjscan.scanning.sections_before import GrooveReader
from tjscan.scanning.settle import SettledProfile, SettleSettings, SettlingLaser
from tjscan.scanning.stopping import StopRequest

SENSOR_MOTION_TOLERANCE: Final = 1e-4
"""Metres, or entries of a rotation: a sensor that moved further sees another profile."""

AGREEING_PROFILES: Final = 3
"""Profiles that have to agree on a column. Among seven with 30 % of their points anywhere, 97 % of
the columns have as many right ones; chance makes three wrong ones agree in a column of thousands.
"""

AGREEMENT_SPAN: Final = 0.3e-3
"""Metres of range within which points agree: six standard deviations of a sensor's noise."""


@array_dataclass
class ScanSetup:
    """Equipment of a scan: arm, laser, pose of the sensor on the flange, and groove reader.

    Parameters
    ----------
    arm : Arm
        Carries the laser.
    laser : LineLaser
        Takes the profiles.
    T_f_s : ndarray, shape (4, 4)
        Pose of the sensor on the flange, from calibration, metres.
    read : callable
        Turns a profile, with what the sections before it show, into a groove section, or raises
        GrooveNotFound.
    """

    arm: Arm
    laser: LineLaser
    T_f_s: Array
    read: GrooveReader


class ProfileTaker:
    """Moves the arm and takes profiles, again while they are missing, late or frozen.

    Parameters
    ----------
    setup : ScanSetup
        Arm and laser.
    log : ScanResultsJournal
        Receives every view and event.
    stop : StopRequest
        Lets nothing begin once everything is to stop.
    settle : SettleSettings, optional
        How well the place of rest has to be known; see `SettlingLaser`.
    """

    def __init__(
        self,
        setup: ScanSetup,
        log: ScanResultsJournal,
        stop: StopRequest,
        settle: SettleSettings | None = None,
    ) -> None:
        self._setup, self._log, self._stop = setup, log, stop
        self._settling: SettlingLaser | None = None
        if settle is not None:
            self._settling = SettlingLaser(setup.laser, settle, stop.raise_if_stop_now)
        self._place_of_digest: dict[bytes, Array] = {}

    def remember_view(self, view: ProfileView) -> None:
        """Remember where a profile was taken, so that it is recognised if it comes again, frozen.

        All profiles without a point are alike.
        """
        if view.profile.valid.any():
            self._place_of_digest.setdefault(view.profile.digest, view.T_b_f)

    def move_joint_to_pose(self, T_b_f: Array, near: Array | None = None) -> ArmState:
        """Move the flange to a pose, shape (4, 4), on a path in joint space.

        It ends in the configuration nearest to the joint angles `near`, shape (n,), radians. In
        another one than it scanned in, the arm may not come round the rest of the joint.

        Raises
        ------
        PoseUnreachable
            If there is no way into that configuration.
        """
        self._stop.raise_if_stop_now()
        return self._setup.arm.move_joint_to_pose(T_b_f, near=near)

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Move the flange to a pose, shape (4, 4), on a straight line."""
        self._stop.raise_if_stop_now()
        return self._setup.arm.move_linear(T_b_f)

    def move_to_set_point(self, to: SetPoint) -> ArmState:
        """Move to a set-point: on a line if that is wanted or the path in joint space blocked.

        Raises
        ------
        PoseUnreachable
            If it can't be reached on a line.
        ArmFault
            If the arm stopped on the way.
        """
        T_b_f = to.T_b_t @ inverse_pose(self._setup.T_f_s @ to.T_s_t)
        if not to.straight:
            try:
                # In the present configuration or not at all: the arm never changes sides on its
                # way round a joint.
                self._stop.raise_if_stop_now()
                here = self._setup.arm.state().q
                return self._setup.arm.move_joint_to_pose(T_b_f, near=here, direct=True)
            except PoseUnreachable as error:
                self._log.record_event(ScanEvent.STRAIGHT, str(error))
        return self.move_linear(T_b_f)

    def take_view(self, index: int, substep: Substep, state: ArmState) -> ProfileView:
        """Take a profile with the arm at rest; again while it is missing, late or frozen.

        Parameters
        ----------
        index : int
            Number of the section.
        substep : Substep
            What the profile is taken for.
        state : ArmState
            Where the arm came to rest.

        Raises
        ------
        LaserFault
            If more than `MOST_MISSING_PROFILES` profiles in a row are missing, late or frozen.
        ScanInterrupted
            If everything is to stop at once.
        """
        taken = self._capture_until_good(index, substep, state)
        T_f_s = self._setup.T_f_s
        T_b_s = state.T_b_f @ T_f_s @ taken.T_rest_s
        T_b_f = state.T_b_f if taken.sigmas is None else T_b_s @ inverse_pose(T_f_s)
        view = ProfileView(
            index, substep, T_b_f, T_b_s, taken.profile, state.time, state.q, taken.sigmas
        )
        if taken.detail:
            where = f"section {index}, {substep}"
            self._log.record_event(ScanEvent.SWAY, f"{where}: {taken.detail}")
        self.remember_view(view)
        self._log.record(view)
        return view

    def take_and_merge_views(
        self, views: Sequence[ProfileView], state: ArmState
    ) -> ProfileView | None:
        """Take `MERGED_PROFILES` profiles of one place and merge them; None if all are the same.

        Those of bursts are each of another place of the sway, and are not merged.

        Parameters
        ----------
        views : sequence of ProfileView
            Those taken there already, one at least; the others are taken now.
        state : ArmState
            Where the arm came to rest.
        """
        if self._settling is not None:
            return None
        first, profiles = views[0], [view.profile for view in views]
        while len(profiles) < MERGED_PROFILES:
            profiles.append(self.take_view(first.index, first.substep, state).profile)
        if (profile := merge_repeated_profiles(profiles)) is None:
            return None
        view = replace(first, profile=profile)
        self._log.record(view)
        return view

    def _capture_until_good(self, index: int, substep: Substep, state: ArmState) -> SettledProfile:
        missed = 0
        while True:
            self._stop.raise_if_stop_now()
            try:
                taken = self._capture()
                self._check_profile_is_new(taken.profile, state)
                return taken
            except LaserFault as error:
                missed += 1
                if missed > MOST_MISSING_PROFILES:
                    raise LaserFault(
                        f"{missed} profiles in a row were no good, the last one because: {error}"
                    ) from error
                detail = f"section {index}, {substep}: {error}"
                self._log.record_event(ScanEvent.TAKEN_AGAIN, detail)

    def _capture(self) -> SettledProfile:
        """Take a profile as the sensor is, or as it would be at rest."""
        if self._settling is None:
            return SettledProfile(self._setup.laser.capture(), np.eye(4))
        return self._settling.capture()

    def _check_profile_is_new(self, profile: Profile, state: ArmState) -> None:
        """Refuse a profile that is late or frozen.

        Parameters
        ----------
        profile : Profile
            As it came.
        state : ArmState
            Where the arm came to rest before.

        Raises
        ------
        LaserFault
            If it was taken before the arm came to rest (if the sensor gives the time), or is
            the same to the last bit as one of another place, however long ago: no sensor measures
            the same noise twice.
        """
        if 0.0 < profile.time < state.time:
            raise LaserFault(
                f"the profile is late: it was taken {1e3 * (state.time - profile.time):.0f} ms "
                "before the arm came to rest"
            )
        place = self._place_of_digest.get(profile.digest)
        if place is not None and np.abs(state.T_b_f - place).max() > SENSOR_MOTION_TOLERANCE:
            raise LaserFault("the profile is frozen: it is one of a place before")


def merge_repeated_profiles(profiles: Sequence[Profile]) -> Profile | None:
    """Keep what several profiles, taken with the arm at rest, agree on, column by column.

    Parameters
    ----------
    profiles : sequence of Profile
        Of one sensor, with the same columns. What is the same to the last bit counts once: it
        was measured once.

    Returns
    -------
    Profile or None
        Means of the points that agree, with the time of the last profile; None if fewer than
        `AGREEING_PROFILES` profiles differ.
    """
    distinct = list({profile.z_s.tobytes(): profile for profile in profiles}.values())
    if len(distinct) < AGREEING_PROFILES or len({len(profile) for profile in distinct}) > 1:
        return None
    x_s = np.array([profile.x_s for profile in distinct])
    z_s = np.array([profile.z_s for profile in distinct])
    order = np.argsort(z_s, axis=0)  # NaN last
    ranked = np.take_along_axis(z_s, order, axis=0)
    spans = ranked[AGREEING_PROFILES - 1 :] - ranked[: len(distinct) - AGREEING_PROFILES + 1]
    first = np.argmin(np.nan_to_num(spans, nan=np.inf), axis=0)
    middle = np.take_along_axis(ranked, first[None] + AGREEING_PROFILES // 2, axis=0)
    agree = np.abs(z_s - middle) <= AGREEMENT_SPAN / 2
    count = agree.sum(axis=0)
    kept = count >= AGREEING_PROFILES
    divisor = np.maximum(count, 1)
    x, z = (np.where(agree, v, 0.0).sum(axis=0) / divisor for v in (x_s, z_s))
    x_s, z_s = (np.where(kept, values, np.nan) for values in (x, z))
    return replace(profiles[-1], x_s=x_s, z_s=z_s, intensity=None)
