"""The local dihedral angle between two tubes."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.joint.tubes.cylinder import Cylinder
from tjscan.joint.tubes.fit import FittedTubes


def dihedral_angles(brace: Cylinder, leg: Cylinder, points: Array) -> Array:
    """Angle between the outer walls of brace and leg where they meet, in the plane square to both.

    180° less the angle between the outward normals: 90° at the crown of a T-joint, more towards
    its saddle.

    Parameters
    ----------
    brace, leg : Cylinder
        In one frame.
    points : ndarray, shape (n, 3)
        At or beside the line where they meet, metres.

    Returns
    -------
    ndarray, shape (n,)
        Radians.
    """
    cosines = np.sum(brace.normals(points) * leg.normals(points), axis=1)
    return np.asarray(np.pi - np.arccos(np.clip(cosines, -1, 1)))


def dihedral_sigmas(tubes: FittedTubes, points: Array, step: float = 1e-6) -> Array:
    """Standard deviations of `dihedral_angles` by the tubes' covariance, shape (n,), radians.

    Parameters
    ----------
    tubes : FittedTubes
        Brace and leg.
    points : ndarray, shape (n, 3)
        Metres.
    step : float
        By which each number of a tube is changed for the derivatives: metres or radians.
    """
    columns = []
    for change in step * np.eye(10):
        up, down = (
            dihedral_angles(
                tubes.brace.boxplus(sign * change[:5]), tubes.leg.boxplus(sign * change[5:]), points
            )
            for sign in (1, -1)
        )
        columns.append((up - down) / (2 * step))
    jacobian = np.column_stack(columns)
    return np.asarray(np.sqrt(np.sum((jacobian @ tubes.covariance) * jacobian, axis=1)))
