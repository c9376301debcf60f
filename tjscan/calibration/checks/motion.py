"""Whether the arm moved enough to find the sensor's pose, and which motion is missing."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, unit_vector
from tjscan.core.pose_vector import rotation_to_vector

MIN_ROTATION: Final = float(np.radians(2.0))
"""Radians RMS; smaller turns are as good as none."""
MIN_TILT_SPREAD: Final = 5e-3
"""RMS by which the cosines of the tilts must differ: about 0° beside 10°."""
ADVISED_TILT_DEG: Final = 20
"""Degrees to tilt by, in the advice: they bring the condition number well below its limit."""
MAX_CONDITION: Final = 100.0
"""Of eq. (21); beyond it, errors of a line grow into millimetres."""
ARBITRARY_CONDITION: Final = 1e4
"""Condition beyond which the rotation found is arbitrary and names no axes."""


def check_motion(T_b_f: Array, u_b: Array | None, R_f_s: Array | None = None) -> None:
    """Refuse poses that can't fix a hand-eye transform, for any lines.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.
    u_b : ndarray, shape (3,), optional
        Normal of the board, if it is known.
    R_f_s : ndarray, shape (3, 3), optional
        About how the sensor sits on the flange: lets the advice name the sensor's axes
        instead of the flange's.

    Raises
    ------
    CalibrationRefused
        With the motion that is missing.
    """
    R = T_b_f[:, :3, :3]
    turns = rotation_to_vector(R[0].T @ R)
    _, singular, axes = np.linalg.svd(turns, full_matrices=True)
    spread = singular / np.sqrt(len(turns))
    if spread[0] < MIN_ROTATION:
        advised = "the flange's axes that lie along the board"
        if R_f_s is not None:
            advised = "the sensor's x and y axes"
        raise CalibrationRefused(
            "only translations",
            f"the poses differ in orientation by {np.degrees(spread[0]):.1f}°; tilt by "
            f"{ADVISED_TILT_DEG}° or more, both ways, about {advised}",
        )
    if spread[1] < MIN_ROTATION:
        _refuse_one_axis(axes[0], None if u_b is None else R[0].T @ u_b, R_f_s)
    if u_b is not None:
        _check_normals(u_b @ R, R_f_s)


def _refuse_one_axis(axis_f: Array, u_f: Array | None, R_f_s: Array | None) -> None:
    """Name the axis turned about, and the one to tilt about: square to it, along the board."""
    if u_f is None and R_f_s is not None:
        u_f = -R_f_s[:, 2]  # the sensor looks at the board
    turned = describe_axis(axis_f, R_f_s)
    if u_f is None:
        advice = f"turn about an axis square to it by {ADVISED_TILT_DEG}° or more, both ways"
    elif abs(axis_f @ u_f) > 0.9:
        across = np.linalg.svd(u_f[None])[2][1:] if R_f_s is None else R_f_s[:, :2].T
        tilts = advise_tilts(list(across), R_f_s)
        advice = f"that is about the board's normal, which shows nothing new; {tilts}"
    else:
        advice = advise_tilts([np.cross(u_f, axis_f)], R_f_s)
    raise CalibrationRefused(
        "turns about one axis only", f"all poses differ by turns about {turned}; {advice}"
    )


def _check_normals(u_f: Array, R_f_s: Array | None) -> None:
    """The normals seen from the flange, shape (n, 3), must lean two ways."""
    spread, axes = tilt_spread(u_f)
    missing = [axis for axis, s in zip(axes, spread, strict=True) if s < MIN_ROTATION]
    if missing:
        singular = np.linalg.svd(u_f, compute_uv=False) / np.sqrt(len(u_f))
        shown = ", ".join(f"{s:.4f}" for s in singular)
        raise CalibrationRefused(
            "plane normals do not span space",
            "seen from the flange, the board's normals lean one way only (singular values "
            f"{shown}); {advise_tilts(missing, R_f_s)}",
        )


def check_tilts_vary(u_f: Array, R_f_s: Array | None = None) -> None:
    """Refuse normals on one cone: with the plane unknown, its height is then free.

    From poses tilted alike, a board farther away and a sensor further out look the same.

    Parameters
    ----------
    u_f : ndarray, shape (n, 3)
        The board's normal as each flange sees it.
    R_f_s : ndarray, shape (3, 3), optional
        Rotation of the sensor on the flange, to name the axes of the sensor.

    Raises
    ------
    CalibrationRefused
        With the motion that is missing.
    """
    _, singular, axes = np.linalg.svd(u_f - u_f.mean(axis=0))
    spread = singular[2] / np.sqrt(len(u_f))
    if spread < MIN_TILT_SPREAD:
        raise CalibrationRefused(
            "all tilts alike",
            f"the board is unknown, and every pose is tilted alike about "
            f"{describe_axis(axes[2], R_f_s)} (the cosines differ by {spread:.4f} RMS, "
            f"{MIN_TILT_SPREAD:g} is needed); missing: tilts of other sizes, some of them with the "
            "sensor square to the board",
        )


def check_rotation_condition(
    A: Array, u_f: Array, R_f_s: Array, R_f_s_guess: Array | None
) -> float:
    """Condition number of eq. (21); refuses lines that fix no rotation.

    Parameters
    ----------
    A : ndarray, shape (n, 6)
        Of eq. (21).
    u_f : ndarray, shape (n, 3)
        The board's normal as each flange sees it.
    R_f_s, R_f_s_guess : ndarray, shape (3, 3)
        Rotation of the sensor as found, and approximately, if that is known: one of them names
        the axes to tilt about.

    Returns
    -------
    float
        First over fifth singular value; the last belongs to the solution.

    Raises
    ------
    CalibrationRefused
        With how far the poses tilt, and about which axis they must tilt further.
    """
    singular = np.linalg.svd(A, compute_uv=False)
    condition = float(singular[0] / max(singular[4], 1e-300))
    if condition <= MAX_CONDITION:
        return condition
    # A rotation from an ill-conditioned set still names the axes, unless it is arbitrary.
    R = R_f_s_guess if R_f_s_guess is not None or condition > ARBITRARY_CONDITION else R_f_s
    spread, axes = tilt_spread(u_f)
    shown = " and ".join(
        f"{np.degrees(s):.1f}° about {describe_axis(axis, R)}"
        for s, axis in zip(spread, axes, strict=True)
    )
    # About equally little both ways: both are missing.
    weak = axes if spread[1] > 0.5 * spread[0] else axes[1:]
    raise CalibrationRefused(
        "ill-conditioned",
        f"the condition number is {condition:.0f}, the limit {MAX_CONDITION:.0f}; the tilts have "
        f"an RMS of {shown}; {advise_tilts(list(weak), R)}",
    )


def tilt_spread(u_f: Array) -> tuple[Array, Array]:
    """How far the normals lean about two axes of the flange, the larger first.

    Returns
    -------
    spread : ndarray, shape (2,)
        RMS tilts in radians.
    axes : ndarray, shape (2, 3)
        Unit vectors in frame f to tilt about.
    """
    mean = unit_vector(u_f.sum(axis=0))
    across = u_f - np.outer(u_f @ mean, mean)
    _, singular, lean = np.linalg.svd(across, full_matrices=True)
    # Turning about w moves the normal along w × mean.
    return singular[:2] / np.sqrt(len(u_f)), np.cross(mean, lean[:2])


def advise_tilts(axes_f: list[Array], R_f_s: Array | None) -> str:
    """Text that asks the operator for tilts about axes.

    Parameters
    ----------
    axes_f : list of ndarray, shape (3,)
        Axes in frame f.
    R_f_s : ndarray, shape (3, 3), or None
        Rotation of the sensor on the flange, if it is known.

    Returns
    -------
    str
        In the sensor's axes if its rotation is known, else in the flange's.
    """
    names = " and ".join(sorted({describe_axis(axis, R_f_s) for axis in axes_f}))
    return f"missing: tilt about {names}, by {ADVISED_TILT_DEG}° or more, both ways"


def describe_axis(axis_f: Array, R_f_s: Array | None) -> str:
    """Name of a direction for messages, by the sensor's axes if known, else by the flange's.

    Parameters
    ----------
    axis_f : ndarray, shape (3,)
        Frame f, of any length but zero.
    R_f_s : ndarray, shape (3, 3), or None
        Rotation of the sensor on the flange, if it is known.
    """
    whose, axis = ("flange", axis_f) if R_f_s is None else ("sensor", R_f_s.T @ axis_f)
    axis = unit_vector(axis)
    k = int(np.argmax(np.abs(axis)))
    if abs(axis[k]) > 0.85:
        return f"the {whose}'s {'xyz'[k]} axis"
    x, y, z = axis * np.sign(axis[k])
    return f"the {whose}'s direction ({x:.2f}, {y:.2f}, {z:.2f})"
