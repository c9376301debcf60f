"""All stations placed together, so that the way round the brace closes.

Nodes are the joint and the stations. Edges are frame j as every station found it by itself, and
the pose between two stations as their overlap gives it; each with its covariance. SciPy solves it
and not Open3D's pose graph: that gives no covariance, and its nodes are poses alone, while here
the tubes' radii, angle and offset belong to the joint, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from tjscan.core import pose_vector
from tjscan.core.frames import Array, inverse_pose, readonly_copy, transform_points
from tjscan.joint.tubes.frame import JointFrame, TubeDimensions
from tjscan.stitching.registration import StationRegistration


@dataclass(frozen=True, slots=True, eq=False)
class StationPoses:
    """Solved poses of all stations in the joint's frame, with covariances and the tubes' shape.

    Parameters
    ----------
    T : ndarray, shape (k, 4, 4)
        Maps each station's own frame j into the common one.
    whole_covariance : ndarray, shape (6 k, 6 k)
        Of all of them together: translation and rotation vector of each in the common j.
    by_shapes, by_overlaps : ndarray, shape (6 k + 4, 4 k) and (6 k + 4, 6 e)
        How the poses and the shape change with the shape that each station found, and with the
        poses of the e overlaps.
    shape : TubeDimensions
        Of the joint.
    shape_covariance : ndarray, shape (4, 4)
        Of its numbers.
    reduced_chi2 : float
        Chi-squared per degree of freedom of all stations and overlaps.
    """

    T: Array
    whole_covariance: Array
    by_shapes: Array
    by_overlaps: Array
    shape: TubeDimensions
    shape_covariance: Array
    reduced_chi2: float

    def __post_init__(self) -> None:
        for name in ("T", "whole_covariance", "by_shapes", "by_overlaps", "shape_covariance"):
            object.__setattr__(self, name, readonly_copy(getattr(self, name)))

    @property
    def covariance(self) -> Array:
        """Covariance of each pose, shape (k, 6, 6): translation and rotation vector in j."""
        k = len(self.T)
        parts = self.whole_covariance.reshape(k, 6, k, 6)
        return np.array([parts[i, :, i] for i in range(k)])


def solve_station_poses(
    frames: Sequence[JointFrame], registrations: Sequence[StationRegistration]
) -> StationPoses:
    """Solve the poses of all stations by least squares, from tube fits and overlaps.

    Parameters
    ----------
    frames : sequence of JointFrame
        As each of k stations found it.
    registrations : sequence of StationRegistration
        Of all overlaps, in the stations' own frames j.
    """
    k = len(frames)
    by_frame = [_whitener(frame.covariance) for frame in frames]
    by_overlap = [_whitener(edge.covariance) for edge in registrations]
    origin = np.mean([frame.shape.as_array for frame in frames], axis=0)

    def residuals(x: Array) -> Array:
        T, shape = (
            [pose_vector.pose_from_vector(v) for v in x[: 6 * k].reshape(k, 6)],
            x[6 * k :] + origin,
        )
        white = [
            # The station takes its own frame for j: it finds j at the identity.
            W
            @ np.concatenate(
                (pose_vector.pose_to_vector(inverse_pose(T_own)), shape - frame.shape.as_array)
            )
            for W, T_own, frame in zip(by_frame, T, frames, strict=True)
        ]
        for W, edge in zip(by_overlap, registrations, strict=True):
            between = inverse_pose(T[edge.overlap.first]) @ T[edge.overlap.second]
            white.append(
                W @ (pose_vector.pose_to_vector(between) - pose_vector.pose_to_vector(edge.T))
            )
        return np.concatenate(white)

    found = least_squares(
        residuals, np.zeros(6 * k + 4), jac="3-point", x_scale=1e-4, xtol=1e-15, ftol=1e-15
    )
    jacobian: Array = np.array(found.jac)
    covariance: Array = np.linalg.inv(jacobian.T @ jacobian).astype(np.float64)
    # Residuals are whitened: what was observed enters with the whitener, and a minus.
    rows = jacobian[: 10 * k].reshape(k, 10, -1)
    by_shapes = [covariance @ r.T @ W[:, 6:] for r, W in zip(rows, by_frame, strict=True)]
    rows = jacobian[10 * k :].reshape(len(by_overlap), 6, -1)
    by_overlaps = [covariance @ r.T @ W for r, W in zip(rows, by_overlap, strict=True)]
    return StationPoses(
        np.array([pose_vector.pose_from_vector(v) for v in found.x[: 6 * k].reshape(k, 6)]),
        covariance[: 6 * k, : 6 * k],
        np.concatenate(by_shapes, axis=1),
        np.concatenate(by_overlaps, axis=1) if by_overlaps else np.zeros((6 * k + 4, 0)),
        TubeDimensions(*(found.x[6 * k :] + origin).tolist()),
        covariance[6 * k :, 6 * k :],
        2 * float(found.cost) / (len(found.fun) - found.x.size),
    )


def overlap_gap(edge: StationRegistration, T: Sequence[Array] | Array) -> float:
    """Gap in metres between two placed stations' grooves in the middle of an overlap.

    Across the groove: along it there is nothing to see a step by.

    Parameters
    ----------
    edge : StationRegistration
        The overlap.
    T : sequence of ndarray, shape (4, 4)
        Maps each station's own frame j into the common one.
    """
    first, second = T[edge.overlap.first], T[edge.overlap.second]
    # By the overlap, edge.T @ p of the second is what the first sees.
    expected = transform_points(edge.T @ inverse_pose(second) @ first, edge.centre)
    return float(np.linalg.norm(np.cross(expected - edge.centre, edge.along)))


def spanning_tree_poses(
    count: int, registrations: Sequence[StationRegistration]
) -> tuple[Array, list[StationRegistration]]:
    """Poses of stations from overlaps alone, along the spanning tree of the surest ones.

    Parameters
    ----------
    count : int
        Of the stations, all of which overlaps connect.
    registrations : sequence of StationRegistration
        Of all overlaps.

    Returns
    -------
    T : ndarray, shape (count, 4, 4)
        Maps each station's own frame j into that of the first.
    closing : list of StationRegistration
        Those that close a loop, the surest first; how far they are from `T` is the gap before
        closing.
    """
    by_sigma = sorted(registrations, key=lambda edge: edge.position_sigma)
    surest = {(e.overlap.first, e.overlap.second): e for e in reversed(by_sigma)}
    links = coo_array(
        ([edge.position_sigma for edge in surest.values()], np.transpose(list(surest))),
        (count, count),
    )
    tree = minimum_spanning_tree(links)
    order, predecessors = breadth_first_order(tree, 0, directed=False)
    T, used = np.tile(np.eye(4), (count, 1, 1)), set()
    for b in order[1:].tolist():
        a = int(predecessors[b])
        edge = surest[min(a, b), max(a, b)]
        used.add(id(edge))
        T[b] = T[a] @ (edge.T if edge.overlap.first == a else inverse_pose(edge.T))
    return T, [edge for edge in by_sigma if id(edge) not in used]


def _whitener(covariance: Array) -> Array:
    """What makes errors of a covariance independent and of unit variance."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
