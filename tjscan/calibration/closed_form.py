"""Hand-eye calibration in closed form: the paper's appendix, eq. (20)-(25)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.calibration.line_fit import LineFit
from tjscan.calibration.plucker import Plane
from tjscan.core.frames import Array, pose, readonly, skew

DECISIVE: Final = 0.3
"""One sign's residual below this share of the other's decides between them."""


@dataclass(frozen=True, slots=True, eq=False)
class LineBundle:
    """Lines and the flange poses they were taken from, n at a time.

    Parameters
    ----------
    R_b_f : ndarray, shape (n, 3, 3)
        Orientations of the flange.
    p_b_f : ndarray, shape (n, 3)
        Positions of the flange, in metres.
    points_s, directions_s : ndarray, shape (n, 3)
        A point and the unit direction of each line in frame s, y = 0.
    """

    R_b_f: Array
    p_b_f: Array
    points_s: Array
    directions_s: Array

    def __post_init__(self) -> None:
        for name in ("R_b_f", "p_b_f", "points_s", "directions_s"):
            object.__setattr__(self, name, readonly(getattr(self, name)))


def bundle(T_b_f: Array, fits: list[LineFit]) -> LineBundle:
    """Stack flange poses, shape (n, 4, 4), and the lines seen from them."""
    return LineBundle(
        T_b_f[:, :3, :3],
        T_b_f[:, :3, 3],
        np.stack([fit.point_s for fit in fits]),
        np.stack([fit.direction_s for fit in fits]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class ClosedForm:
    """What the closed form finds.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange.
    singular_values : ndarray, shape (6,)
        Of A in eq. (21); the last belongs to the solution, the others must be far from zero.
    residual : float
        RMS of what eq. (22) leaves, in metres.
    """

    T_f_s: Array
    singular_values: Array
    residual: float

    @property
    def condition(self) -> float:
        """First over fifth singular value of A: how far lines lie from fixing no rotation."""
        return float(self.singular_values[0] / max(self.singular_values[4], 1e-300))


def rotation_matrix_A(lines: LineBundle, u_b: Array) -> Array:
    """A of eq. (21), shape (..., n, 6), for normals of shape (..., 3)."""
    u_f = np.einsum("nji,...j->...ni", lines.R_b_f, u_b)  # u^T R_b_f, as a row per line
    a = lines.directions_s
    return np.concatenate((u_f * a[:, 0:1], u_f * a[:, 2:3]), axis=-1)


def rotations(A: Array) -> tuple[Array, Array]:
    """Both rotations R_f_s that the null vector of A allows, and A's singular values.

    Parameters
    ----------
    A : ndarray, shape (..., n, 6)
        Of eq. (21), n ≥ 5.

    Returns
    -------
    R_f_s : ndarray, shape (..., 2, 3, 3)
        The null vector is known up to its sign, which turns r1 and r3 round but not r2.
    singular_values : ndarray, shape (..., 6)
        The last is zero for five lines.
    """
    _, singular, Vt = np.linalg.svd(A, full_matrices=True)
    if singular.shape[-1] < 6:
        singular = np.concatenate((singular, np.zeros((*singular.shape[:-1], 1))), axis=-1)
    x = Vt[..., 5, :]
    r1 = x[..., :3] / np.linalg.norm(x[..., :3], axis=-1, keepdims=True)
    r3 = x[..., 3:] / np.linalg.norm(x[..., 3:], axis=-1, keepdims=True)
    r2 = np.cross(r3, r1)
    both = np.stack((np.stack((r1, r2, r3), axis=-1), np.stack((-r1, r2, -r3), axis=-1)), axis=-3)
    # The nearest member of SO(3); r2 = r3 × r1 is right-handed already.
    U, _, Wt = np.linalg.svd(both)
    return U @ Wt, singular


def translation(lines: LineBundle, plane: Plane, R_f_s: Array) -> tuple[Array, float]:
    """p_f_s by eq. (23)-(25), shape (3,), and the RMS of what eq. (22) leaves, in metres."""
    u_cross, a_s = skew(plane.u), lines.directions_s
    m_s = np.cross(lines.points_s, a_s)
    a_f = a_s @ R_f_s.T
    a_b = np.einsum("nij,nj->ni", lines.R_b_f, a_f)
    m_b = np.einsum("nij,nj->ni", lines.R_b_f, m_s @ R_f_s.T)
    A_p = (u_cross @ lines.R_b_f @ skew(a_f)).reshape(-1, 3)  # (24)
    about_flange = np.cross(lines.p_b_f, a_b) + m_b
    b = (-plane.u0 * a_b + about_flange @ u_cross.T).ravel()  # (25)
    p, *_ = np.linalg.lstsq(A_p, b, rcond=None)
    # Three rows per line, of which one says something: the RMS is per line.
    return p, float(np.linalg.norm(A_p @ p - b) / np.sqrt(len(a_s)))


def solve_closed_form(lines: LineBundle, plane: Plane) -> ClosedForm:
    """Hand-eye transform from at least five lines on a known plane, eq. (20)-(25).

    Parameters
    ----------
    lines : LineBundle
        In general position; `ClosedForm.condition` says whether they are.
    plane : Plane
        Frame b.

    Notes
    -----
    Cibicik et al. 2022, appendix. Of the two signs of the null vector in eq. (21) the one is
    taken that leaves the smaller residual in eq. (22). Where the central ray always meets the
    board at the same distance and point, both residuals are alike: the wrong sensor then looks at
    the board from behind, and that it stands on the flange's side decides.
    """
    if len(lines.points_s) < 5:
        raise ValueError("the closed form needs at least five lines")
    both, singular = rotations(rotation_matrix_A(lines, plane.u))
    found = [(*translation(lines, plane, R), R) for R in both]
    p, residual, R = min(found, key=lambda one: one[1])
    if residual > DECISIVE * max(one[1] for one in found):
        p, residual, R = max(found, key=lambda one: in_front(lines, plane, one[0]))
    return ClosedForm(pose(R, p), singular, residual)


def in_front(lines: LineBundle, plane: Plane, p_f_s: Array) -> float:
    """Share of the lines for which sensor and flange stand on the same side of the plane."""
    flange = plane.distance(lines.p_b_f)
    sensor = plane.distance(lines.p_b_f + np.einsum("nij,j->ni", lines.R_b_f, p_f_s))
    return float(np.mean(np.sign(flange) == np.sign(sensor)))
