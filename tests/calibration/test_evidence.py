"""Poses of another convention, or of other profiles, are told apart by evidence."""

import numpy as np
import pytest
from _targets import TargetSimulator
from calibration_stage import NOISE, T_F_S, WINDOW
from scipy.spatial.transform import Rotation

from tjscan.calibration.hand_eye import calibrate_on_targets
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.targets.ball import SeenBall, SphereTarget
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose, pose

HAND = TargetSimulator(T_F_S, WINDOW, NOISE)
RNG = np.random.default_rng(3)
POSES = HAND.poses(RNG, 12, "ball")
ARCS = HAND.arcs(POSES, POSES, RNG)


def handed_in(T_b_f: Array) -> HandEyeCalibration:
    """The arcs with other poses than they were taken from."""
    samples = [PosedFit(arc.name, T, arc.fit) for arc, T in zip(ARCS, T_b_f, strict=True)]
    seen = SeenBall(samples, SphereTarget(), NOISE)
    return calibrate_on_targets([seen], NOISE, check_conventions=True)


def test_poses_as_they_were_meant_are_accepted() -> None:
    result = handed_in(POSES)
    assert result.rejected_sample_names == ()
    assert result.notes == ()


def test_inverse_poses_are_refused_by_name() -> None:
    with pytest.raises(CalibrationRefused, match="inverted: of the base in the flange's frame"):
        handed_in(np.stack([inverse_pose(T) for T in POSES]))


def test_angles_in_the_wrong_order_are_refused_by_name() -> None:
    angles = Rotation.from_matrix(POSES[:, :3, :3]).as_euler("ZYX")[:, ::-1]
    R = Rotation.from_euler("ZYX", angles).as_matrix()
    read = np.stack([pose(one, T[:3, 3]) for one, T in zip(R, POSES, strict=True)])
    with pytest.raises(CalibrationRefused, match="the angles in the opposite order"):
        handed_in(read)


def test_two_swapped_poses_are_named() -> None:
    swapped = POSES.copy()
    swapped[[2, 7]] = POSES[[7, 2]]
    result = handed_in(swapped)
    assert result.rejected_sample_names == ("arc 3", "arc 8")
    assert "arc 3 and arc 8 fit with each other's poses" in result.notes[0]
    assert result.notes[0] in result.caveats


def test_poses_of_other_profiles_are_refused() -> None:
    with pytest.raises(CalibrationRefused):
        handed_in(np.roll(POSES, 1, axis=0))
