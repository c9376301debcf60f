"""Starts for the refinement where no closed form leads there: unknown plane, sphere."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.fits.line_bundle import LineBundle
from tjscan.calibration.models.sphere import SphereModel
from tjscan.calibration.plucker import PluckerPlane
from tjscan.calibration.solve.closed_form import (
    rotation_candidates,
    rotation_equations,
    sensor_on_flange_side_share,
)
from tjscan.core.frames import Array, pose

NORMALS_TRIED: Final = 300
"""Directions tried for an unknown normal: one in every 8°."""
OFFSET_SCALE: Final = 1e-3
TILT_SCALE: Final = float(np.radians(0.5))
"""Metres and radians: how misfits in distance and in tilt are compared among starts."""


def plane_calibration_starts(lines: LineBundle, count: int) -> list[tuple[Array, PluckerPlane]]:
    """Starting values of T_f_s and plane for lines on an unknown plane, the best first.

    For each of many normals over a half sphere, eq. (21) gives the rotation; position and the
    plane's distance then follow linearly from the lines' centroids.

    Parameters
    ----------
    lines : LineBundle
        Lines on one plane.
    count : int
        How many starts to return.
    """
    u = half_sphere_directions(NORMALS_TRIED)
    both, _ = rotation_candidates(rotation_equations(lines, u))  # (g, 2, 3, 3)
    u_f = np.einsum("nji,gj->gni", lines.R_b_f, u)
    centroid_f = np.einsum("gkij,nj->gkni", both, lines.points_s)
    a_f = np.einsum("gkij,nj->gkni", both, lines.directions_s)
    tilt = np.einsum("gni,gkni->gkn", u_f, a_f)
    known = np.einsum("gni,gkni->gkn", u_f, centroid_f) + (lines.p_b_f @ u.T).T[:, None]
    A = np.concatenate((u_f, np.ones((*u_f.shape[:2], 1))), axis=2)
    solution = -np.einsum("gij,gkj->gki", np.linalg.pinv(A), known)  # p_f_s and u0
    offset = known + np.einsum("gnj,gkj->gkn", A, solution)
    cost = (offset / OFFSET_SCALE) ** 2 + (tilt / TILT_SCALE) ** 2
    order = np.argsort(cost.sum(axis=2), axis=None)
    found = []
    for g, k in zip(*np.unravel_index(order, cost.shape[:2]), strict=True):
        plane = PluckerPlane(u[g], solution[g, k, 3])
        # A sensor and a flange on different sides of the board are a mirror image.
        if sensor_on_flange_side_share(lines, plane, solution[g, k, :3]) > 0.5:
            found.append((pose(both[g, k], solution[g, k, :3]), plane))
        if len(found) == count:
            break
    return found


def half_sphere_directions(count: int) -> Array:
    """Unit vectors with z ≥ 0, evenly spread (Fibonacci lattice), shape (count, 3)."""
    k = np.arange(count)
    z = (k + 0.5) / count
    turn = k * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z**2)
    return np.column_stack((r * np.cos(turn), r * np.sin(turn), z))


def sphere_calibration_starts(model: SphereModel) -> list[tuple[Array, Array]]:
    """Starting values of T_f_s and ball: one for each way to turn a cube.

    With the rotation given, the sensor's position and the ball's centre follow linearly from
    the arcs' centres.
    """
    R_b_f, p_b_f = model.T_b_f[:, :3, :3], model.T_b_f[:, :3, 3]
    n = len(R_b_f)
    found = []
    for R in Rotation.create_group("O").as_matrix():
        axes_f = R[:, [0, 2]]  # x_s and z_s in f
        # axis · (R_b_f^T (C - p_b_f) - p_f_s) = centre of the arc along that axis
        by_centre = np.einsum("ia,nji->naj", axes_f, R_b_f)
        by_sensor = -np.broadcast_to(axes_f.T, (n, 2, 3))
        A = np.concatenate((by_centre, by_sensor), axis=2).reshape(-1, 6)
        known = np.einsum("naj,nj->na", by_centre, p_b_f) + model.centres_s[:, [0, 2]]
        x, *_ = np.linalg.lstsq(A, known.ravel(), rcond=None)
        T_f_s = pose(R, x[3:])
        found.append((T_f_s, sphere_start_parameters(model, x[:3])))
    return found


def sphere_start_parameters(model: SphereModel, centre_b: Array) -> Array:
    """Starting values of a ball's parameters; the largest arc starts its radius.

    Parameters
    ----------
    model : SphereModel
        The arcs.
    centre_b : ndarray, shape (3,)
        About where the ball is, frame b, metres.
    """
    if model.sphere.radius is not None:
        return np.append(centre_b, 0.0)
    return np.append(centre_b, 1.05 * model.radii.max())
