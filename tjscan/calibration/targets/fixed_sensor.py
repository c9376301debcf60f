"""A sensor that is fixed in the room while the arm carries the target: poses are inverted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tjscan.calibration.targets.target import LinearisedModel, TargetModel
from tjscan.core.frames import Array, inverse_pose, skew_matrix


@dataclass(frozen=True, slots=True, eq=False)
class FixedSensorModel:
    """A target's model with the roles of base and flange swapped.

    Seen from the flange the sensor moves, on the base as if that were its flange. T_b_f of the
    inner model is the base in the flange's frame, T_f_s is the sensor in the base's, and the
    target's parameters count in the flange's.

    Parameters
    ----------
    model : TargetModel
        Made with inverse poses.
    by_true_pose : ndarray, shape (n, 6, 6)
        From an error of each flange pose, about the flange's origin in the axes of b, to that of
        the inverse pose; see `inverse_pose_errors`.
    """

    model: TargetModel
    by_true_pose: Array

    @property
    def prior_information(self) -> Array:
        """Prior of the inner model."""
        return self.model.prior_information

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """As the inner model does, its errors being those of the true poses."""
        found = self.model.linearise(T_f_s, target)
        return replace(found, by_arm=found.by_arm @ self.by_true_pose)


def inverse_poses(T: Array) -> Array:
    """Inverse of each pose, shape (n, 4, 4)."""
    return np.stack([inverse_pose(one) for one in T])


def inverse_pose_errors(T_b_f: Array) -> Array:
    """Effect of a small error of each pose on its inverse.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.

    Returns
    -------
    ndarray, shape (n, 6, 6)
        From translation and rotation about the flange's origin in the axes of b, to translation
        and rotation of T_f_b about the base's origin in the axes of f.
    """
    R_f_b = T_b_f[:, :3, :3].transpose(0, 2, 1)
    errors = np.zeros((len(T_b_f), 6, 6))
    errors[:, :3, :3] = errors[:, 3:, 3:] = -R_f_b
    errors[:, :3, 3:] = -R_f_b @ skew_matrix(T_b_f[:, :3, 3])
    return errors
