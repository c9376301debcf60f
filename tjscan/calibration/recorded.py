"""Calibration from recorded profiles of one or several targets: nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.special import chdtri

from tjscan.calibration import pose_files
from tjscan.calibration.arm.calibrate import (
    ArmModel,
    TargetInPostures,
    as_hand_eye_calibration,
    calibrate_arm,
)
from tjscan.calibration.checks import check_result_certainty
from tjscan.calibration.file import BasisEntry, views_of_poses
from tjscan.calibration.hand_eye import calibrate_on_targets
from tjscan.calibration.noise import NoiseModel, geometry_error_correlation
from tjscan.calibration.recorded_settings import RecordedSettings
from tjscan.calibration.result import HandEyeCalibration, HandEyeUncertainty
from tjscan.calibration.solve.refine import (
    FALSE_ALARM_PROBABILITY,
    CombinedModel,
    refine_by_least_squares,
)
from tjscan.calibration.solve.solution import CalibrationProblem
from tjscan.calibration.targets.ball import SeenBall, SphereTarget, fit_circle
from tjscan.calibration.targets.line import fit_line
from tjscan.calibration.targets.plane import SeenBoard, plane_of_statement
from tjscan.calibration.targets.point import PointModel, start_of_points
from tjscan.calibration.targets.roof import SeenRoof, fit_roof
from tjscan.calibration.targets.target import (
    PosedProfile,
    SeenTarget,
    TargetStatement,
    fit_profiles,
)
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.pose_vector import boxminus
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.laser.profile import Profile
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

HELD_OUT_PROFILE_INTERVAL: Final = 5
"""One profile of so many only checks the result of a calibration of the arm."""
MAX_RECORDED_POSE_ERROR: Final = 0.005
"""Metres between the flange as recorded and by the arm's model, beyond any calibration."""

Report = Callable[[str], None]
"""Receives a message."""


class TargetKind(NamedTuple):
    """A kind of target.

    Parameters
    ----------
    fit : callable
        Fits the target's curve to a profile; raises CalibrationRefused if it holds none.
    see : callable
        Makes the `SeenTarget` of fits, the target as stated, and the noise.
    target : callable
        Makes the target of what is stated of it, and the noise; None if it is all unknown.
    """

    fit: Callable[[Profile, NoiseModel], Any]
    see: Callable[[Sequence[Any], Any, NoiseModel], SeenTarget[Any]]
    target: Callable[[TargetStatement, NoiseModel], Any]


TARGET_KINDS: Final[Mapping[str, TargetKind]] = {
    "plane": TargetKind(fit_line, SeenBoard, plane_of_statement),
    "ball": TargetKind(fit_circle, SeenBall, lambda stated, noise: SphereTarget(stated.radius)),
    "roof": TargetKind(fit_roof, lambda fits, _, noise: SeenRoof(fits, noise), lambda *_: None),
}
"""Each kind of target by its name in a job."""


def calibrate_recorded_sets(
    tables: Sequence[RecordedSettings],
    noise: NoiseModel,
    folder: Path,
    report: Report,
    *,
    sensor_is_fixed: bool = False,
    kinematics: Kinematics | None = None,
) -> tuple[HandEyeCalibration, BasisEntry]:
    """Calibrate from the files of recorded sets, all solved together.

    Parameters
    ----------
    tables : sequence of RecordedSettings
        The sets.
    noise : NoiseModel
        Errors of profiles and poses.
    folder : Path
        Folder that the files' paths start from.
    report : callable
        Receives messages about files, left-out profiles and results.
    sensor_is_fixed : bool
        The sensor is fixed in the room, and the arm carries the target.
    kinematics : Kinematics, optional
        Calibrate this arm with the sensor; the poses have joint angles.

    Raises
    ------
    ConfigurationError
        If a file is missing or wrong, or joint angles don't belong to the poses.
    CalibrationRefused
        If the result could not be trusted.
    """
    profiles = [table for table in tables if table.target != "points"]
    point_files = [folder / table.profiles for table in tables if table.target == "points"]
    recorded = _see_recorded_sets(profiles, noise, folder, report)
    if kinematics is not None:  # checked before anything is solved
        _check_joint_angles(recorded.shots, kinematics)
    elif point_files:
        raise ConfigurationError("points calibrate the arm: --arm, with its model", key="arm.model")
    seen = {shot.name: shot.T_b_f for shot in recorded.shots}
    if profiles:
        result = calibrate_on_targets(
            recorded.targets,
            noise,
            sensor_is_fixed=sensor_is_fixed,
            check_conventions=True,
            readings=recorded.readings,
        )
    if kinematics is not None:
        points = {file.name: _points_on_arm(file, kinematics, noise) for file in point_files}
        T_f_s = result.T_f_s if profiles else np.eye(4)
        result = _calibrate_arm(recorded.targets, points, kinematics, T_f_s, report)
        for name, one in points.items():
            seen |= dict(zip(_names_of_points(name, one), one.T_b_f, strict=True))
    return result, BasisEntry(
        target="; ".join(map(str, tables)),
        poses_read_as=tuple(recorded.read_as),
        left_out=tuple(recorded.left_out),
        caveats=result.caveats,
        views=views_of_poses(seen, result.T_f_s, sensor_is_fixed=result.sensor_is_fixed),
    )


class _RecordedSets(NamedTuple):
    """What recorded sets hold, and what was said of them."""

    targets: list[SeenTarget[Any]]
    shots: list[PosedProfile]
    read_as: list[str]
    readings: dict[str, dict[str, Array]]
    left_out: list[str]


def _see_recorded_sets(
    tables: Sequence[RecordedSettings], noise: NoiseModel, folder: Path, report: Report
) -> _RecordedSets:
    """Read the files of recorded sets, and fit their targets' curves."""
    left_out: list[str] = []

    def leave_out(message: str) -> None:
        report(message)
        left_out.append(message)

    kinds = [table.kind for table in tables]
    sets: list[tuple[str, list[PosedProfile], Any]] = []
    read_as: list[str] = []
    readings: dict[str, dict[str, Array]] = {}
    for k, table in enumerate(tables):
        shots, convention, others = _read_profile_set(table, folder, report, leave_out)
        read_as.append(f"{Path(table.poses).name}: {convention}")
        if len(tables) > 1:
            several = kinds.count(kinds[k]) > 1
            prefix = f"{kinds[k]} {kinds[: k + 1].count(kinds[k])}," if several else kinds[k]
            shots = [replace(shot, name=f"{prefix} {shot.name}") for shot in shots]
        for words, poses in others.items():
            names = (shot.name for shot in shots)
            readings[f"{words} in {table.poses}"] = dict(zip(names, poses, strict=True))
        flange_b = np.mean([shot.T_b_f[:3, 3] for shot in shots], axis=0)
        touched = table.touched and pose_files.read_points(folder / table.touched)[0]
        stated = TargetStatement(flange_b, table.radius, touched, table.plane)
        sets.append((table.target, shots, TARGET_KINDS[table.target].target(stated, noise)))
    shots = [shot for _, profiles, _ in sets for shot in profiles]
    targets = [see_target(*one, noise, leave_out) for one in sets]
    return _RecordedSets(targets, shots, read_as, readings, left_out)


class CalibrationCheck(NamedTuple):
    """How a calibration agrees with profiles that had no part in it.

    Parameters
    ----------
    moved : ndarray, shape (6,)
        From the sensor's pose as calibrated to that by the profiles: translation (metres) and
        rotation (radians) in the axes of f.
    sigma : HandEyeUncertainty
        Of `moved`, by the errors of both.
    misfit, limit : float
        `moved` in standard deviations (RMS of six), and the largest that chance explains.
    """

    moved: Array
    sigma: HandEyeUncertainty
    misfit: float
    limit: float

    @property
    def holds(self) -> bool:
        """Whether the profiles are as the calibration predicts, within chance."""
        return self.misfit <= self.limit


def check_on_recorded_sets(
    T_f_s: Array,
    covariance: Array,
    tables: Sequence[RecordedSettings],
    noise: NoiseModel,
    folder: Path,
    report: Report,
) -> CalibrationCheck:
    """Check a sensor's pose, with its covariance, shape (6, 6), on profiles of known targets.

    Raises
    ------
    ConfigurationError
        If a file is missing or wrong.
    CalibrationRefused
        If there are too few profiles, or they would hardly show a change of the sensor's pose.
    """
    seen = [one for one in _see_recorded_sets(tables, noise, folder, report).targets if one.names]
    T_b_f = CalibrationProblem(seen, noise).T_b_f
    models, starts = zip(*(one.model_at_sensor_pose(T_f_s) for one in seen), strict=True)
    model = CombinedModel(models, geometry_error_correlation(T_b_f), noise.geometry)
    every = np.ones(len(T_b_f), dtype=bool)
    found = refine_by_least_squares(model, T_f_s, np.concatenate(starts), every)
    alone = found.variance_scale * found.covariance[:6, :6]
    check_result_certainty(alone, "take more profiles, tilted further, to check a calibration")
    moved = boxminus(found.T_f_s, T_f_s)
    both = alone + covariance
    misfit = float(np.sqrt(moved @ np.linalg.solve(both, moved) / 6))
    limit = float(np.sqrt(chdtri(6, FALSE_ALARM_PROBABILITY) / 6))
    return CalibrationCheck(moved, HandEyeUncertainty(both), misfit, limit)


def _read_profile_set(
    table: RecordedSettings, folder: Path, report: Report, leave_out: Report
) -> tuple[list[PosedProfile], str, dict[str, list[Array]]]:
    """Profiles with their poses, how the poses were read, and how they might have been meant."""
    # Heights count as they are: the origin of the sensor is calibrated.
    profiles, poses = folder / table.profiles, folder / table.poses
    others = tuple(Path(name).name for name in (table.poses, table.touched or ""))
    form = ProfileFormat(
        table.units, table.pitch, table.invalid, table.z_scale, z_offset=0.0, other_files=others
    )
    read = read_profiles(profiles, form)
    for note in read.notes:
        report(f"{profiles}: {note}")
    for bad in read.bad:
        leave_out(f"{profiles}: {bad}; left out")
    found = pose_files.read_flange_poses(poses)
    report(f"{poses}: {len(found.T_b_f)} poses, read as {found.convention}")
    shots, *alike = (
        pose_files.pair_profiles_with_poses(read.profiles, replace(found, T_b_f=T), poses)
        for T in (found.T_b_f, *found.others.values())
    )
    other_poses = [[shot.T_b_f for shot in other] for other in alike]
    return shots, found.convention, dict(zip(found.others, other_poses, strict=True))


def see_target(
    kind: str,
    shots: Sequence[PosedProfile],
    target: Any,
    noise: NoiseModel,
    report: Report,
) -> SeenTarget[Any]:
    """Fit the line, arc or edge of every profile of a target.

    Parameters
    ----------
    kind : str
        A key of `TARGET_KINDS`.
    shots : sequence of PosedProfile
        Profiles of the same sensor on the same arm.
    target : object
        As the kind's `target` made it.
    noise : NoiseModel
        Errors of profiles and poses.
    report : callable
        Receives a message about each profile that holds no line, arc or edge.
    """
    fits, unread = fit_profiles(shots, TARGET_KINDS[kind].fit, noise)
    for name, refusal in unread.items():
        report(f"{name} is left out: {refusal.reason}, {refusal.evidence}")
    z_s = {shot.name: shot.profile.z_s for shot in shots}
    behind = [
        one.fit.centre_s[2] - z_s[one.name][one.fit.inlier].mean() for one in fits if kind == "ball"
    ]
    if np.median(behind or [0.0]) < 0:
        report(
            "heights grow towards the sensor, as the ball shows: the pose is that of a frame whose "
            "z points back to the sensor; for one as of this program state --z-scale -1 (z_scale)"
        )
    return TARGET_KINDS[kind].see(fits, target, noise)


def _points_on_arm(file: Path, kinematics: Kinematics, noise: NoiseModel) -> TargetInPostures:
    """Points of a file, with the flange poses that the arm's model has at their joint angles."""
    points, q = pose_files.read_points(file, len(kinematics.lower))
    T_b_f = np.array([kinematics.forward(angles) for angles in q])
    model, start = start_of_points(points, T_b_f, noise)
    return TargetInPostures(model, q, T_b_f, start)


def _names_of_points(file: str, points: TargetInPostures) -> list[str]:
    return [f"{file} {number}" for number in range(1, len(points.q) + 1)]


def _calibrate_arm(
    seen: Sequence[SeenTarget[Any]],
    points: Mapping[str, TargetInPostures],
    kinematics: Kinematics,
    T_f_s: Array,
    report: Report,
) -> HandEyeCalibration:
    """Calibrate an arm and the sensor on it, if there is one; every fifth profile is held out."""
    names = [name for one in seen for name in one.names]
    names += [name for file, one in points.items() for name in _names_of_points(file, one)]
    held_out = np.arange(len(names)) % HELD_OUT_PROFILE_INTERVAL == HELD_OUT_PROFILE_INTERVAL // 2
    targets = []
    for one in seen:
        model, start = one.model_at_sensor_pose(T_f_s)
        q = np.array([sample.q for sample in one.samples])
        targets.append(TargetInPostures(model, q, one.T_b_f, start))
    arm = ArmModel(kinematics, (*targets, *points.values()))
    found = calibrate_arm(arm, held_out, PlacementTolerance(), T_f_s)
    for line in found.summary_sentences("profiles" if seen else "points", "targets are"):
        report(line)
    first = arm.targets[0].model
    T_b_t = first.T_b_t if isinstance(first, PointModel) else None
    return as_hand_eye_calibration(found, names, kinematics.name, T_b_t)


def _check_joint_angles(shots: Sequence[PosedProfile], kinematics: Kinematics) -> None:
    """Refuse profiles without joint angles, or with angles that do not fit their poses."""
    for shot in shots:
        if shot.q is None or shot.q.shape != kinematics.lower.shape:
            raise ConfigurationError(
                f"{shot.name}: {kinematics.name} has {kinematics.lower.size} joints, and the poses "
                f"have {0 if shot.q is None else shot.q.size} joint angles beside them: columns "
                "q1_deg, q2_deg and so on"
            )
        apart = np.linalg.norm(kinematics.forward(shot.q)[:3, 3] - shot.T_b_f[:3, 3])
        if apart > MAX_RECORDED_POSE_ERROR:
            raise ConfigurationError(
                f"{shot.name}: with these joint angles the flange of a {kinematics.name} is "
                f"{1e3 * apart:.0f} mm from the pose beside them; they belong to another pose, "
                "another arm, or count in another unit or from another base"
            )
