"""Calibration from recorded profiles: nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tjscan.calibration.fits.posed_profile import (
    PosedProfile,
    fit_arc_samples,
    fit_line_samples,
    fit_roof_samples,
)
from tjscan.calibration.hand_eye import calibrate_on_targets
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.solve.seen import SeenBall, SeenBoard, SeenRoof
from tjscan.calibration.targets import PlaneTarget, SphereTarget, UnknownRoof
from tjscan.core.errors import CalibrationRefused

RecordedTarget = PlaneTarget | SphereTarget | UnknownRoof | None
"""A board, a ball or a roof edge; none for a board whose place is unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetRecording:
    """Recorded profiles of one target.

    Parameters
    ----------
    profiles : sequence of PosedProfile
        Profiles and their poses.
    target : PlaneTarget, SphereTarget, UnknownRoof or None
        What they show; none for a board whose place is unknown.
    """

    profiles: Sequence[PosedProfile]
    target: RecordedTarget


def calibrate_from_profiles(
    recordings: Sequence[TargetRecording],
    noise: NoiseModel,
    report: Callable[[str], None],
    *,
    sensor_is_fixed: bool = False,
) -> HandEyeCalibration:
    """Calibrate from recorded profiles of one or several targets, all solved together.

    Parameters
    ----------
    recordings : sequence of TargetRecording
        Of the same sensor on the same arm.
    noise : NoiseModel
        What they err by.
    report : callable
        Receives a message about each profile that holds no line, arc or edge, before anything is
        solved.
    sensor_is_fixed : bool
        The sensor stands fixed in the room, and the arm carries the targets.

    Raises
    ------
    CalibrationRefused
        As `calibrate_on_targets` does.
    """
    return calibrate_on_targets(
        [seen_in_recording(recording, noise, report) for recording in recordings],
        noise,
        sensor_is_fixed=sensor_is_fixed,
        check_conventions=True,
    )


def seen_in_recording(
    recording: TargetRecording, noise: NoiseModel, report: Callable[[str], None]
) -> SeenBoard | SeenBall | SeenRoof:
    """Fit line, arc or edge to every profile of a recording, and report those that hold none."""
    target = recording.target
    seen: SeenBoard | SeenBall | SeenRoof
    unread: dict[str, CalibrationRefused]
    if isinstance(target, SphereTarget):
        arcs, unread = fit_arc_samples(recording.profiles, noise)
        seen = SeenBall(arcs, target, noise)
    elif isinstance(target, UnknownRoof):
        roofs, unread = fit_roof_samples(recording.profiles, noise)
        seen = SeenRoof(roofs, noise)
    else:
        lines, unread = fit_line_samples(recording.profiles, noise)
        seen = SeenBoard(lines, target, noise)
    for name, refusal in unread.items():
        report(f"{name} is left out: {refusal.reason}, {refusal.evidence}")
    return seen
