"""The functions of ``import tjscan``: metres and radians, poses as 4 x 4 arrays, read-only results.

What they need is imported when they are called.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from tjscan.api.results import File, Recording, Scan

if TYPE_CHECKING:
    from tjscan.calibration.result import HandEyeCalibration
    from tjscan.comparison.compare import Comparison
    from tjscan.groove.section import GrooveSection
    from tjscan.laser.profile import Profile

__all__ = ["Recording", "Scan", "calibrate", "compare", "read_groove", "scan"]

LengthUnit = Literal["mm", "um", "m"]

OFF_PLANE_TOLERANCE: Final = 1e-6
"""Metres that a point of a profile may be off the laser plane."""


def scan(
    job: File,
    directory: File | None = None,
    *,
    station: str | None = None,
    keys: Mapping[str, Any] | None = None,
) -> Scan:
    """Scan a groove as a job file states, from one station.

    Parameters
    ----------
    job : path
        The job file (TOML).
    directory : path, optional
        The run directory to make; ``runs/JOB-DATE`` if left out.
    station : str, optional
        The station to scan from, of a job with several.
    keys : mapping, optional
        Dotted keys of the job file and values to replace theirs: ``{"scan.sections": 4}``.

    Raises
    ------
    TjscanError
        If the job is wrong or a device fails; the recording in the run directory holds what was
        measured until then.
    """
    from tjscan.core.config import add_file_to_errors
    from tjscan.job.files import read_scan_job
    from tjscan.result.directory import default_run_directory
    from tjscan.runs.scan.run import ScanContext, run_scan

    file = Path(job)
    with add_file_to_errors(file):
        parsed = read_scan_job(file, dict(keys or {})).job_at_station(station)
    folder = default_run_directory(file, station) if directory is None else Path(directory)
    run_scan(ScanContext(parsed, file), folder)
    return Scan.read(folder)


def read_groove(
    points: ArrayLike | Profile, *, model: str = "tee", **settings: Any
) -> GrooveSection:
    """Read the groove's section in one profile.

    Parameters
    ----------
    points : array_like, shape (n, 2) or (n, 3), or Profile
        x and z, or x, y and z with y = 0, in the sensor's frame s, metres, in the order of the
        sensor's columns; NaN if it has no point.
    model : str
        Shape of the groove, of four sides: ``tee`` or ``butt-v-sharp``.
    **settings : float
        What differs from the defaults of `tjscan.groove.settings.GrooveSettings`: ``noise``,
        ``minimum_points``, ``largest_sigma``, ``largest_rms`` and ``inlier_share``, in metres.

    Raises
    ------
    GrooveNotFound
        If there is no groove, or more than one reading, or one that is too uncertain.
    ValueError
        If the points are not of that shape or off the laser plane, or a setting can't be.
    """
    from tjscan.groove.read import read_groove as read_groove_in_profile
    from tjscan.groove.settings import GROOVE_MODELS, GrooveSettings

    _check_word("model", model, tuple(GROOVE_MODELS))
    chosen = GrooveSettings(GROOVE_MODELS[model], **settings)
    return read_groove_in_profile(_profile_from_points(points), chosen)


def calibrate(
    profiles: Sequence[ArrayLike | Profile],
    T_b_f: ArrayLike,
    *,
    touched: ArrayLike | None = None,
    radius: float | None = None,
    target: Literal["plane", "sphere", "roof"] = "plane",
    noise: Mapping[str, float] | None = None,
) -> HandEyeCalibration:
    """Find the pose of the sensor on the flange from profiles of a plane board or of a sphere.

    Parameters
    ----------
    profiles : sequence of array_like, shape (n, 2) or (n, 3)
        One profile for each pose, as `read_groove` takes it.
    T_b_f : array_like, shape (k, 4, 4)
        Poses of the flange in the robot's base frame, metres.
    touched : array_like, shape (m, 3), optional
        Points of the board that were touched with a probe, in the base frame, metres; without
        them the board's place is estimated with the sensor's.
    radius : float, optional
        Radius of the sphere, metres; estimated if left out.
    target : str
        What the profiles are of.
    noise : mapping, optional
        Standard deviations that differ from the defaults of
        `tjscan.calibration.noise.NoiseModel`: ``{"range": 20e-6}``.

    Returns
    -------
    HandEyeCalibration
        With ``T_f_s``, its covariance, and what speaks against each profile.

    Raises
    ------
    CalibrationRefused
        If the result could not be trusted.
    ValueError
        If the arguments do not fit together.
    """
    from tjscan.calibration.hand_eye import calibrate_on_targets
    from tjscan.calibration.noise import NoiseModel
    from tjscan.calibration.recorded import TARGET_KINDS, see_target
    from tjscan.calibration.targets.target import PosedProfile, TargetStatement

    poses = np.asarray(T_b_f, dtype=float)
    if poses.shape != (len(profiles), 4, 4):
        raise ValueError(f"{len(profiles)} profiles need poses (k, 4, 4), not {poses.shape}")
    if (touched is not None and target != "plane") or (radius is not None and target != "sphere"):
        raise ValueError("touched points are of a plane, a radius is of a sphere")
    _check_word("target", target, ("plane", "sphere", "roof"))
    for name in noise or {}:
        _check_word("noise", name, [field.name for field in fields(NoiseModel)])
    model = NoiseModel(**(noise or {}))
    kind = "ball" if target == "sphere" else target
    stated = TargetStatement(poses[:, :3, 3].mean(0), radius, touched)
    found = TARGET_KINDS[kind].target(stated, model)
    posed = [
        PosedProfile(f"profile {k}", T, _profile_from_points(points))
        for k, (points, T) in enumerate(zip(profiles, poses, strict=True), start=1)
    ]
    seen = see_target(kind, posed, found, model, _log_rejected_profiles)
    return calibrate_on_targets([seen], model, check_conventions=True)


def compare(
    measured: File | Scan,
    reference: File | Scan,
    *,
    align: Literal["none", "joint", "icp"] = "none",
    tolerance: float | None = None,
    units: LengthUnit | None = None,
    reference_units: LengthUnit | None = None,
    frame: str | None = None,
) -> Comparison:
    """Compare a scan or a cloud with a joint, a mesh or a cloud.

    Parameters
    ----------
    measured : Scan or path
        A scan, a run directory, or a cloud: PLY, PCD, XYZ, CSV, E57.
    reference : Scan or path
        A joint's definition (TOML), a mesh (STL, PLY, OBJ, 3MF, STEP), a cloud or a scan.
    align : str
        ``none``: both are given in one frame. ``joint``: leg and brace are found in both and
        aligned. ``icp``: both are nearly aligned already, iterative closest points does the rest.
    tolerance : float, optional
        Metres; `Comparison.passed` states whether the 95th percentile is within it.
    units, reference_units : str, optional
        Unit of files that state none.
    frame : str, optional
        Frame of files that state none.

    Raises
    ------
    ConfigurationError
        If a file can't be read, or the two can't be compared.
    ComparisonRefused
        If the points do not determine an alignment.
    ValueError
        If there is no such alignment.
    """
    from tjscan.comparison.compare import compare_shapes
    from tjscan.comparison.shapes import UserUnitAndFrame
    from tjscan.result.shapes import read_shape

    _check_word("align", align, ("none", "joint", "icp"))
    first, second = (Path(x.directory if isinstance(x, Scan) else x) for x in (measured, reference))
    return compare_shapes(
        read_shape(first, UserUnitAndFrame(units, frame)),
        read_shape(second, UserUnitAndFrame(reference_units or units, frame)),
        align,
        tolerance,
    )


def _check_word(name: str, word: str, known: Sequence[str]) -> None:
    """Refuse a word that means nothing here."""
    if word not in known:
        raise ValueError(f"unknown {name} {word!r}; one of {', '.join(known)}")


def _profile_from_points(points: ArrayLike | Profile) -> Profile:
    """A profile of points (n, 2) or (n, 3) in the laser plane."""
    from tjscan.laser.profile import Profile

    if isinstance(points, Profile):
        return points
    array = np.asarray(points, dtype=float)
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise ValueError(f"a profile is of shape (n, 2) or (n, 3), not {array.shape}")
    if array.shape[1] == 3 and np.nanmax(np.abs(array[:, 1]), initial=0.0) > OFF_PLANE_TOLERANCE:
        raise ValueError("the points are off the laser plane: y must be 0")
    return Profile(array[:, 0], array[:, -1])


def _log_rejected_profiles(message: str) -> None:
    """Log what was left out of a calibration."""
    import logging

    logging.getLogger("tjscan").warning(message)
