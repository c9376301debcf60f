"""Poses as the controller has them: metres and a rotation vector."""

from __future__ import annotations

from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, pose


def pose_of(values: tuple[float, ...] | list[float]) -> Array:
    """Pose, shape (4, 4), from metres and a rotation vector."""
    return pose(Rotation.from_rotvec(values[3:]).as_matrix(), values[:3])


def values_of(T: Array) -> tuple[float, ...]:
    """Metres and the rotation vector of a pose, six numbers."""
    return (*T[:3, 3].tolist(), *Rotation.from_matrix(T[:3, :3]).as_rotvec().tolist())
