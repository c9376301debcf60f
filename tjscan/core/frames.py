"""Poses and points: ``T_b_s`` is the pose of s in b and maps s-coordinates into b.

Inner letters cancel: ``T_b_s = T_b_f @ T_f_s``. Poses are 4 x 4 arrays; lengths are metres,
angles radians. The table of frames is in ``docs/frames.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Final, TypeVar, dataclass_transform

import numpy as np
import scipy  # its parts are loaded at first use
from numpy.typing import ArrayLike, NDArray
from pytransform3d.rotations import active_matrix_from_angle
from pytransform3d.transformations import invert_transform

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ARRAY_DTYPES: Final[dict[str, type[np.generic]]] = {
    "Array": np.float64,
    **dict.fromkeys(("PoseMatrix", "PlanarPoints", "PlanarPoses"), np.float64),
    "Mask": np.bool_,
    "NDArray[np.bool_]": np.bool_,
    "NDArray[np.int8]": np.int8,
    "NDArray[np.int32]": np.int32,
    "NDArray[np.intp]": np.intp,
}
"""The annotations that `frozen_arrays` takes for arrays, each with the type of its copy."""

T = TypeVar("T")

_IN_YZX, _IN_ZXY = np.array((1, 2, 0)), np.array((2, 0, 1))

ROTATION_ROUNDING: Final = 1e-3
"""How far from orthonormal a rotation printed with four decimals may be."""


def readonly_copy(values: ArrayLike) -> Array:
    """Return a float64 copy that can't be written to."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def stretches_of_true_values(values: Mask) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First index of each stretch of true values, and the index after its last."""
    padded = np.concatenate(([False], values, [False]))
    starts, stops = (padded[1:] != padded[:-1]).nonzero()[0].reshape(-1, 2).T
    return starts, stops


def frozen_arrays(cls: type[T]) -> type[T]:
    """Let a frozen dataclass hold its arrays as read-only copies.

    It belongs under ``@dataclass``, and acts before a ``__post_init__`` of the class itself.
    Every argument annotated as an array (`ARRAY_DTYPES`) becomes a copy of that type; a value
    None stays.
    """
    dtypes = {
        name: ARRAY_DTYPES[kind]
        for name, annotation in cls.__annotations__.items()
        if (kind := _array_kind(annotation)) in ARRAY_DTYPES
        and getattr(getattr(cls, name, None), "init", True)
    }
    check: Callable[[T], None] | None = getattr(cls, "__post_init__", None)

    def freeze(self: T) -> None:
        for name, dtype in dtypes.items():
            value = getattr(self, name)
            if value is not None:
                array = np.array(value, dtype=dtype)
                array.flags.writeable = False
                object.__setattr__(self, name, array)
        if check is not None:
            check(self)

    cls.__post_init__ = freeze  # type: ignore[attr-defined]
    return cls


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
def array_dataclass(cls: type[T]) -> type[T]:
    """Make a frozen dataclass with slots that holds its arrays as `frozen_arrays` does."""
    return dataclass(frozen=True, slots=True, eq=False)(frozen_arrays(cls))


def _array_kind(annotation: str) -> str:
    """``Array`` of ``Annotated[Array, ...]`` and of ``Array | None``."""
    return annotation.removesuffix(" | None").removeprefix("Annotated[").partition(", ")[0]


def unit_vector(v: Array) -> Array:
    """Return `v`, shape (3,), scaled to length one."""
    return np.asarray(v / np.linalg.norm(v))


def unit_vectors(v: ArrayLike) -> Array:
    """Vectors, shape (..., k), each scaled to length one."""
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def cross(a: Array, b: Array) -> Array:
    """Cross product of vectors.

    Parameters
    ----------
    a, b : ndarray, shape (..., 3)
        Any shapes that broadcast.

    Notes
    -----
    `numpy.cross` allows for so much else that it takes ten times as long for a few vectors.
    """
    return np.asarray(a[..., _IN_YZX] * b[..., _IN_ZXY] - a[..., _IN_ZXY] * b[..., _IN_YZX])


def skew_matrix(v: ArrayLike) -> Array:
    """Matrices, shape (..., 3, 3), whose product with w is v × w, for v of shape (..., 3)."""
    v = np.asarray(v, dtype=float)
    out = np.zeros((*v.shape, 3))
    out[..., 2, 1] = v[..., 0]
    out[..., 0, 2] = v[..., 1]
    out[..., 1, 0] = v[..., 2]
    return out - np.swapaxes(out, -1, -2)


def rot_x(angle: float) -> Array:
    """Rotation by `angle` about the x axis, shape (3, 3)."""
    return np.asarray(active_matrix_from_angle(0, angle))


def rot_y(angle: float) -> Array:
    """Rotation by `angle` about the y axis, shape (3, 3)."""
    return np.asarray(active_matrix_from_angle(1, angle))


def rot_z(angle: float) -> Array:
    """Rotation by `angle` about the z axis, shape (3, 3)."""
    return np.asarray(active_matrix_from_angle(2, angle))


def pose(R: ArrayLike | None = None, p: ArrayLike | None = None) -> Array:
    """Pose from a rotation and a position; identity if left out.

    Parameters
    ----------
    R : array_like, shape (3, 3), optional
        Axes of the inner frame, as columns, in the outer one.
    p : array_like, shape (3,), optional
        Origin of the inner frame in the outer one, metres.

    Returns
    -------
    ndarray, shape (4, 4)
    """
    T = np.eye(4)
    if R is not None:
        T[:3, :3] = R
    if p is not None:
        T[:3, 3] = np.reshape(p, 3)  # a single number is no position
    return T


def inverse_pose(T: Array) -> Array:
    """Pose of the outer frame in the inner one: ``inverse(T_b_s)`` is ``T_s_b``."""
    return np.asarray(invert_transform(T, check=False))


def transform_points(T: Array, points: ArrayLike) -> Array:
    """Map points from the inner frame of a pose to its outer frame.

    Parameters
    ----------
    T : ndarray, shape (4, 4)
        Pose of the inner frame in the outer one.
    points : array_like, shape (..., 3)
        In the inner frame, metres.
    """
    return np.asarray(points, dtype=float) @ T[:3, :3].T + T[:3, 3]


def rotation_angle_between(T_1: Array, T_2: Array) -> float:
    """Angle in radians by which the rotations of two poses differ.

    Parameters
    ----------
    T_1, T_2 : ndarray, shape (4, 4) or (3, 3)
        Poses or rotations.
    """
    turn = scipy.spatial.transform.Rotation.from_matrix(T_1[:3, :3].T @ T_2[:3, :3])
    return float(turn.magnitude())


def pose_from_euler_zyx(position: ArrayLike, angles: ArrayLike) -> Array:
    """Pose with ``R = Rz(a) Ry(b) Rx(c)``.

    This is what controllers show as A, B, C (KUKA) or, in reverse order, as roll, pitch,
    yaw (Universal Robots).

    Parameters
    ----------
    position : array_like, shape (3,)
        Metres.
    angles : array_like, shape (3,)
        a, b, c in radians, about the moving z, y, x axes in turn.
    """
    turn = scipy.spatial.transform.Rotation.from_euler("ZYX", np.asarray(angles, dtype=float))
    return pose(turn.as_matrix(), position)


def pose_to_euler_zyx(T: Array) -> tuple[Array, Array]:
    """Position in metres and Z-Y-X Euler angles in radians of a pose, each of shape (3,)."""
    turn = scipy.spatial.transform.Rotation.from_matrix(T[:3, :3])
    return T[:3, 3].copy(), np.asarray(turn.as_euler("ZYX"))


def pose_from_rounded_matrix(T: ArrayLike) -> Array:
    """Pose whose rotation is the one nearest to a matrix printed with few decimals.

    Raises
    ------
    ValueError
        If `T` is not 4 x 4 with last row 0 0 0 1, or its rotation is further from
        orthonormal (or from right-handed) than rounding to four decimals explains.
    """
    T = np.asarray(T, dtype=float)
    if T.shape != (4, 4) or not np.allclose(T[3], (0, 0, 0, 1)):
        raise ValueError("a pose is a 4 x 4 matrix whose last row is 0 0 0 1")
    R = T[:3, :3]
    if not np.isfinite(T).all() or not np.allclose(R @ R.T, np.eye(3), atol=ROTATION_ROUNDING):
        raise ValueError("its first three rows and columns are not a rotation (not orthonormal)")
    if np.linalg.det(R) < 0:
        raise ValueError("its rotation is left-handed: an axis has the wrong sign")
    U, _, Vt = np.linalg.svd(R)
    return pose(U @ Vt, T[:3, 3])


@dataclass(frozen=True, slots=True, eq=False)
class JointOrBaseFrame:
    """Frame of the results: the joint's if the job states its place, else the base frame.

    Parameters
    ----------
    T_b_j : ndarray, shape (4, 4), optional
        Pose of the joint in the base frame.
    """

    T_b_j: Array | None = None

    @property
    def letter(self) -> str:
        """Letter of the frame: j for the joint's, b for the base's."""
        return "b" if self.T_b_j is None else "j"

    @property
    def T_r_b(self) -> Array:
        """Pose of the base frame in it, shape (4, 4)."""
        return np.eye(4) if self.T_b_j is None else inverse_pose(self.T_b_j)


@dataclass(frozen=True, slots=True)
class ArrayForm:
    """Form of the numbers in a field.

    Parameters
    ----------
    shape : tuple of int
        Of the array, -1 for a length that varies; empty for a single number.
    may_be_unknown : bool
        Whether numbers may be NaN.
    is_pose : bool
        Whether it is the pose of a frame.
    """

    shape: tuple[int, ...] = (-1,)
    may_be_unknown: bool = False
    is_pose: bool = False


PoseMatrix = Annotated[Array, ArrayForm((4, 4), is_pose=True)]
FloatOrNan = Annotated[float, ArrayForm((), may_be_unknown=True)]
PlanarPoints = Annotated[Array, ArrayForm((-1, 2))]
PlanarPoses = Annotated[Array, ArrayForm((-1, 3))]
"""Rows of two numbers, such as x and y; and of three, such as x, y and heading."""
