"""Content of ``calibration.toml`` from the result of a calibration."""

from __future__ import annotations

from datetime import datetime
from typing import Any, TypeVar

import numpy as np

from tjscan.calibration.checks import FreshLineVerification
from tjscan.calibration.file import (
    BallEntry,
    BasisEntry,
    CalibrationFile,
    LaserResponseEntry,
    ResidualEntry,
    VerificationEntry,
    rows_in_file_units,
)
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeCalibration
from tjscan.core.config import validate_table
from tjscan.core.units import pose_to_rows_mm

Entry = TypeVar("Entry", ResidualEntry, VerificationEntry, BallEntry)


def to_calibration_file(
    result: HandEyeCalibration,
    noise: NoiseModel,
    *,
    arm: str,
    laser: str,
    date: datetime,
    verification: FreshLineVerification | None = None,
    linearity: float = 0.0,
    basis: BasisEntry | None = None,
) -> CalibrationFile:
    """Convert a calibration to the content of its file.

    Parameters
    ----------
    result : HandEyeCalibration
        The calibration.
    noise : NoiseModel
        The noise it was found under.
    arm, laser : str
        Which devices it holds for; `read_calibration` refuses it for others.
    date : datetime
        When the lines were taken.
    verification : Verification, optional
        Result of a fresh line.
    linearity : float
        Assumed largest deviation of the laser, metres.
    basis : BasisEntry, optional
        Target, poses and profiles that it rests on.
    """
    sure, ball, laser_response = result.uncertainty, result.measured_radius, None
    if result.by_laser is not None and linearity > 0:
        # Of T_f_s alone, and of the arm's deviations if the file holds these.
        rows = 6 if result.kinematics is None else len(result.by_laser)
        by_draws = rows_in_file_units(result.by_laser[:rows])
        laser_response = LaserResponseEntry(linearity_mm=1e3 * linearity, by_draws=by_draws)
    data = {
        "arm": arm,
        "laser": laser,
        "date": date,
        "method": result.method,
        "lines": sum(residual.used for residual in result.residuals),
        "T_b_s_mm" if result.sensor_is_fixed else "T_f_s_mm": pose_to_rows_mm(result.T_f_s),
        "covariance": rows_in_file_units(result.covariance, axes=2),
        "sigma_position_mm": 1e3 * sure.position,
        "sigma_rotation_deg": float(np.degrees(sure.rotation)),
        "condition": result.condition,
        "excess": result.sigma_scale,
        "geometry_mm": 1e3 * result.geometry,
        "ball": ball
        and BallEntry(
            stated_radius_mm=None if ball.stated is None else 1e3 * ball.stated,
            measured_radius_mm=1e3 * ball.radius,
            sigma_radius_mm=1e3 * ball.sigma,
        ),
        "noise": noise,
        "verification": verification and _entry_from_si(VerificationEntry, verification),
        "kinematics": result.kinematics,
        "laser_response": laser_response,
        "basis": basis,
        "residuals": [_entry_from_si(ResidualEntry, residual) for residual in result.residuals],
    }
    return validate_table(CalibrationFile, data)


def _entry_from_si(model: type[Entry], found: object) -> Entry:
    """A table of the file from an object with the same fields in metres and radians."""
    values: dict[str, Any] = {}
    for key in model.model_fields:
        name, _, unit = key.rpartition("_")
        value = getattr(found, name if unit in ("mm", "deg") else key)
        if value is not None and unit in ("mm", "deg"):
            value = 1e3 * value if unit == "mm" else float(np.degrees(value))
        values[key] = value
    return model(**values)
