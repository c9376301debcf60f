"""What a calibration in a cell rests on, from its measurements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tjscan.calibration.basis import BasisEntry, ShrinkingEntry, views_of_poses
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.targets import PlaneTarget
from tjscan.calibration.wizard.logbook import MeasurementsSoFar
from tjscan.calibration.wizard.plan import CalibrationPlan
from tjscan.calibration.wizard.session import current_progress, fit_touched_board


def basis_of_lines(
    task: CalibrationPlan, measured: MeasurementsSoFar, result: HandEyeCalibration
) -> BasisEntry:
    """What a calibration on a touched board rests on.

    Parameters
    ----------
    task : CalibrationPlan
        What was to be done.
    measured : MeasurementsSoFar
        Touches and lines, all of them.
    result : HandEyeCalibration
        What they gave.

    Raises
    ------
    CalibrationRefused
        As `fit_touched_board` does.
    """
    target, _ = fit_touched_board(task, measured)
    off = 1e3 * float(np.sqrt(np.mean(target.residuals**2)))
    poses = {shot.name: shot.T_b_f for shot in measured.line_profiles}
    return BasisEntry(
        target=f"board touched at {len(target.residuals)} places, {off:.3f} mm RMS off a plane",
        left_out=tuple(f"a pose was passed over: {one.reason}" for one in measured.skipped_poses),
        caveats=result.caveats,
        views=views_of_poses(poses, result.T_f_s),
        shrinking=tuple(_shrinking(task, measured, target)),
    )


def _shrinking(
    task: CalibrationPlan, measured: MeasurementsSoFar, target: PlaneTarget
) -> Iterator[ShrinkingEntry]:
    """Uncertainty after each line, from where the lines gave a result."""
    for count in range(1, len(measured.line_profiles) + 1):
        first = replace(measured, line_profiles=measured.line_profiles[:count])
        result = current_progress(task, first, target).result
        if result is not None:
            sure = result.uncertainty
            yield ShrinkingEntry(
                lines=count,
                sigma_position_mm=1e3 * sure.position,
                sigma_rotation_deg=float(np.degrees(sure.rotation)),
            )


def basis_of_postures(
    measured: MeasurementsSoFar, result: HandEyeCalibration, stated_mm: float
) -> BasisEntry:
    """What a calibration of the arm on a ball rests on.

    Parameters
    ----------
    measured : MeasurementsSoFar
        The postures.
    result : HandEyeCalibration
        What they gave.
    stated_mm : float
        The ball's radius, about, as the job has it.
    """
    shots = [taken.posed_profile for taken in measured.arm_poses.values()]
    seen = {shot.name: shot.T_b_f for shot in shots if len(shot.profile)}
    found = "" if result.radius is None else f"radius found {1e3 * result.radius:.3f} mm, "
    return BasisEntry(
        target=f"ball, {found}about {stated_mm:g} mm stated",
        left_out=tuple(f"{s.name} was not reached" for s in shots if not len(s.profile)),
        caveats=result.caveats,
        views=views_of_poses(seen, result.T_f_s),
    )
