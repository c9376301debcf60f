"""Continuous scans of the example's cell, for tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from cells import PAPER, Notes

from tjscan.core.frames import Array
from tjscan.groove.read import read_groove
from tjscan.job.cell import motion_limits_of_job
from tjscan.job.files import read_scan_job
from tjscan.laser.line_laser import StreamedProfile, StreamingLaser
from tjscan.laser.profile import Profile
from tjscan.runs.scan.run import ScanContext
from tjscan.scanning.continuous.scanner import ContinuousScanner
from tjscan.scanning.journal import ScanResult
from tjscan.scanning.profile_taker import ScanSetup
from tjscan.scanning.section import ProfileView, Substep
from tjscan.scanning.stopping import StopRequest

SHORT = {"scan.mode": "continuous", "scan.length_mm": 60.0}


class HeardThrough:
    """A laser whose stream is changed on its way, beginning after the shuttle.

    Parameters
    ----------
    change : callable
        Receives how many profiles came since the second stream began, and the profile; gives
        what arrives.
    """

    def __init__(self, change: Callable[[int, Profile | None], Profile | None]) -> None:
        self._change, self._streams = change, 0
        self.laser: Any = None

    def __call__(self, laser: Any) -> HeardThrough:
        self.laser = laser
        return self

    def capture(self) -> Profile:
        profile: Profile = self.laser.capture()
        return profile

    def check_stream(self, period: float) -> None:
        self.laser.check_stream(period)

    def stream(self, period: float) -> Iterator[StreamedProfile | None]:
        self._streams += 1
        for number, streamed in enumerate(self.laser.stream(period)):
            profile = streamed.profile
            if self._streams > 1:
                profile = self._change(number, profile)
            yield None if profile is None else StreamedProfile(profile)


def scan_continuously(
    overrides: dict[str, Any],
    *,
    file: Path = PAPER,
    notes: Notes | None = None,
    through: Callable[[Any], Any] = lambda laser: laser,
    stop: StopRequest | None = None,
) -> ScanResult:
    """Scan an example without stopping, its laser heard `through` another one."""
    job = read_scan_job(file, SHORT | overrides)
    with ScanContext(job, file).make_cell() as cell:
        assert isinstance(cell.laser, StreamingLaser)
        setup = ScanSetup(cell.arm, through(cell.laser), cell.T_f_s, read_groove)
        limits = motion_limits_of_job(job)
        first, second = job.start_poses
        arm = cell.clearance.kinematics
        scanner = ContinuousScanner(setup, job.scan, notes or Notes(), arm, limits, second.T, stop)
        return scanner.run(first.T, second.T)


def passing_views(notes: Notes) -> list[ProfileView]:
    """Views taken in passing from the second taught pose on, in order."""
    profiles = [view for view in notes.views if view.substep is not Substep.FUSED]
    taught = [i for i, v in enumerate(profiles) if v.substep is Substep.TAUGHT and v.index > 0]
    return [view for view in profiles[taught[0] :] if view.substep is Substep.PASSING]


def flange_speeds(views: list[ProfileView]) -> Array:
    """Metres per second between neighbouring views."""
    places = np.array([view.T_b_f[:3, 3] for view in views])
    times = np.array([view.time for view in views])
    return np.asarray(np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times))
