"""The arm's calibration from recorded profiles with joint angles: nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from tjscan.calibration.arm.entry import ArmKinematicsEntry
from tjscan.calibration.arm.kept import as_hand_eye_calibration, kinematics_entry
from tjscan.calibration.arm.model import ArmModel, SeenTarget
from tjscan.calibration.arm.result import calibrate_arm, list_undetermined
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.offline import TargetRecording, seen_in_recording
from tjscan.calibration.result import HandEyeCalibration
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

HELD_OUT_EVERY: Final = 5
"""One profile of so many only checks the result."""

OTHER_ARM: Final = 0.005
"""Metres between the flange as recorded and as the model has it, beyond any calibration."""


def calibrate_recorded_arm(
    recordings: Sequence[TargetRecording],
    kinematics: Kinematics,
    noise: NoiseModel,
    T_f_s: Array,
    report: Callable[[str], None],
) -> tuple[HandEyeCalibration, ArmKinematicsEntry]:
    """Calibrate an arm and the sensor on it from recorded profiles, every fifth held out.

    Parameters
    ----------
    recordings : sequence of TargetRecording
        Of boards, balls or roof edges that stay where they are, with joint angles.
    kinematics : Kinematics
        The arm as its maker draws it.
    noise : NoiseModel
        What profiles and poses err by; of poses, what the arm does not repeat.
    T_f_s : ndarray, shape (4, 4)
        How the sensor sits, as the arm's model has it.
    report : callable
        Receives what checks the result, and what can't be told.

    Raises
    ------
    CalibrationRefused
        As `calibrate_arm` does.
    ConfigurationError
        If joint angles are missing, or don't belong to the poses.
    """
    q = joint_angles_by_name(recordings, kinematics)
    seen = [seen_in_recording(one, noise, _ignore) for one in recordings]
    names = [name for one in seen for name in one.names]
    held_out = np.arange(len(names)) % HELD_OUT_EVERY == HELD_OUT_EVERY // 2
    targets = []
    for one in seen:
        begun = one.start_at(T_f_s)
        angles = np.array([q[name] for name in one.names])
        targets.append(SeenTarget(begun.model, angles, one.T_b_f, begun.target))
    found = calibrate_arm(
        ArmModel(kinematics, tuple(targets)), held_out, PlacementTolerance(), T_f_s
    )
    check = found.cross_check
    report(
        f"{check.count} profiles that took no part: the targets are {1e3 * check.before:.3f} mm "
        f"off (RMS) as the arm's model has it, {1e3 * check.after:.3f} mm with what was found"
    )
    for line in list_undetermined(found.undetermined):
        report(line)
    return as_hand_eye_calibration(found, names), kinematics_entry(found, kinematics.name)


def joint_angles_by_name(
    recordings: Sequence[TargetRecording], kinematics: Kinematics
) -> dict[str, Array]:
    """Joint angles of every profile, by its name, once they are found to fit its pose.

    Raises
    ------
    ConfigurationError
        If joint angles are missing, or don't belong to the poses.
    """
    found = {}
    for shot in (shot for one in recordings for shot in one.profiles):
        if shot.q is None or shot.q.shape != kinematics.lower.shape:
            raise ConfigurationError(
                f"{shot.name}: {kinematics.name} has {kinematics.lower.size} joints, and the poses "
                f"have {0 if shot.q is None else shot.q.size} joint angles beside them: columns "
                "q1_deg, q2_deg and so on"
            )
        apart = np.linalg.norm(kinematics.forward(shot.q)[:3, 3] - shot.T_b_f[:3, 3])
        if apart > OTHER_ARM:
            raise ConfigurationError(
                f"{shot.name}: with these joint angles the flange of a {kinematics.name} is "
                f"{1e3 * apart:.0f} mm from the pose beside them; they belong to another pose, "
                "another arm, or count in another unit or from another base"
            )
        found[shot.name] = shot.q
    return found


def _ignore(message: str) -> None:
    """Say nothing: what holds no target was reported before."""
