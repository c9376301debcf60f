"""Calibration from recorded profiles: nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tjscan.calibration.hand_eye import HandEyeCalibration, calibrate_on_plane, calibrate_on_sphere
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.posed_profile import PosedProfile, fit_arc_samples, fit_line_samples
from tjscan.calibration.targets import PlaneTarget, SphereTarget


def calibrate_from_profiles(
    profiles: Sequence[PosedProfile],
    target: PlaneTarget | SphereTarget | None,
    noise: NoiseModel,
    report: Callable[[str], None],
) -> HandEyeCalibration:
    """Calibrate from recorded profiles of a board or a ball.

    Parameters
    ----------
    profiles : sequence of PosedProfile
        Profiles and their poses.
    target : PlaneTarget, SphereTarget or None
        The board or the ball; none for a board whose place is unknown.
    noise : NoiseModel
        What they err by.
    report : callable
        Receives a message about each profile that holds no line or arc, before anything is solved.

    Raises
    ------
    CalibrationRefused
        As `calibrate_on_plane` and `calibrate_on_sphere` do.
    """
    if isinstance(target, SphereTarget):
        arcs, unread = fit_arc_samples(profiles, noise)
    else:
        lines, unread = fit_line_samples(profiles, noise)
    for name, refusal in unread.items():
        report(f"{name} is left out: {refusal.reason}, {refusal.evidence}")
    if isinstance(target, SphereTarget):
        return calibrate_on_sphere(arcs, target, noise)
    return calibrate_on_plane(lines, target, noise)
