"""All stations placed together, so that the way round the brace closes.

Nodes are the joint and the stations. Edges are frame j as every station found it by itself, and
the pose between two stations as their overlap gives it; each with its covariance. With a carrier,
its frame is another node, and each station's place in it another edge. SciPy solves it
and not Open3D's pose graph: that gives no covariance, and its nodes are poses alone, while here
the tubes' radii, angle and offset belong to the joint, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from tjscan.core import pose_vector
from tjscan.core.frames import Array, inverse_pose, skew_matrix, transform_points
from tjscan.joint.tubes.fit import JointFrame, TubeDimensions
from tjscan.stitching.registration import Registrations, StationRegistration


@dataclass(frozen=True, slots=True, eq=False)
class StationErrorDraws:
    """How k stations' own fits and e overlaps err with m draws that all views share.

    Parameters
    ----------
    frames : ndarray, shape (k, 10, m)
        Frame j as each station found it, in its own j, and the tubes' shape.
    overlaps : ndarray, shape (e, 6, m)
        Pose of the second station on the first.
    """

    frames: Array
    overlaps: Array

    def residuals(self, registrations: Registrations) -> Array:
        """What `StationPoses` would be left with at the truth, shape (10 k + 6 e, m).

        Each station has taken its own frame for j: at the truth, it is put right by its error.
        """
        between = [
            self.frames[edge.overlap.second, :6] - self.frames[edge.overlap.first, :6] - found
            for edge, found in zip(registrations, self.overlaps, strict=True)
        ]
        return np.concatenate([*(-self.frames), *between])


EXACT_CARRIER_SIGMA: Final = 1e-6
"""Metres and radians that are left of a carrier which is as exact as its encoders."""


@dataclass(frozen=True, slots=True, eq=False)
class CarriedFrames:
    """Where a carrier says that the frames j of k stations are, all in that of the first.

    Parameters
    ----------
    T : ndarray, shape (k, 4, 4)
        Maps each station's own frame j into the first one's.
    covariances : ndarray, shape (k, 6, 6)
        Of translation and rotation vector, about the origin of j.
    """

    T: Array
    covariances: Array

    @classmethod
    def of_bases(
        cls, T_w_b: Sequence[Array], T_b_j: Sequence[Array], sigmas: Sequence[tuple[float, float]]
    ) -> CarriedFrames:
        """Frames of stations whose bases a carrier brought to T_w_b, and that found j at T_b_j.

        Parameters
        ----------
        T_w_b, T_b_j : sequence of ndarray, shape (4, 4)
        sigmas : sequence of tuple of float
            Of the base's position and orientation, all directions together.
        """
        T_w_j = np.array(T_w_b) @ np.array(T_b_j)
        T, covariances = inverse_pose(T_w_j[0]) @ T_w_j, []
        for base, own, sigma in zip(T_w_b, T_w_j, sigmas, strict=True):
            # Turned about the base, the far groove moves.
            lever = T_w_j[0][:3, :3].T @ (own[:3, 3] - base[:3, 3])
            by_base = np.block([[np.eye(3), -skew_matrix(lever)], [np.zeros((3, 3)), np.eye(3)]])
            variances = np.repeat(np.square(sigma) / 3 + EXACT_CARRIER_SIGMA**2, 3)
            covariances.append(by_base @ np.diag(variances) @ by_base.T)
        return cls(T, np.array(covariances))

    def disagreements(self, placement: StationPoses, shared: StationErrorDraws | None) -> Array:
        """Squared Mahalanobis distances, per degree of freedom, of stations placed without it.

        Shape (k,): each station's place on the first one as overlaps and tubes give it, against
        what the carrier says.
        """
        k = len(self.T)
        noise = placement.noise_covariance[: 6 * k, : 6 * k]
        if shared is not None:
            found = (placement.by_residuals @ shared.residuals(placement.registrations))[: 6 * k]
            noise = noise + found @ found.T
        found_T = inverse_pose(placement.T[0]) @ placement.T
        apart = [0.0]
        for i in range(1, k):
            between = np.zeros((6, 6 * k))
            between[:, :6], between[:, 6 * i : 6 * i + 6] = -np.eye(6), np.eye(6)
            off = pose_vector.pose_to_vector(found_T[i]) - pose_vector.pose_to_vector(self.T[i])
            covariance = between @ noise @ between.T + self.covariances[0] + self.covariances[i]
            apart.append(float(off @ np.linalg.solve(covariance, off)) / 6)
        return np.array(apart)


class StationPoses:
    """Poses of all stations in the joint's frame, solved by least squares from fits and overlaps.

    Parameters
    ----------
    frames : sequence of JointFrame
        As each of k stations found it.
    registrations : sequence of StationRegistration
        Of all e overlaps, in the stations' own frames j.
    shared : StationErrors, optional
        Errors that the observations have in common, to weigh them by; without a carrier.
    carried : CarriedFrames, optional
        Where a carrier says that they are. Then each observation is weighed by what is its own: an
        assumed error that all share would be looked for in what carrier and overlaps differ by.

    Attributes
    ----------
    T : ndarray, shape (k, 4, 4)
        Maps each station's own frame j into the common one.
    shape : TubeDimensions
        Of the joint.
    by_residuals : ndarray, shape (6 k + 4, 10 k + 6 e)
        How poses (translation and rotation vector in the common j) and shape err with the errors
        of what was observed but for the carrier, see `StationErrorDraws`.
    noise_covariance : ndarray, shape (6 k + 4, 6 k + 4)
        Of poses and shape, without what stations share.
    reduced_chi2 : float
        Chi-squared per degree of freedom of all stations and overlaps.
    registrations : sequence of StationRegistration
        As given.
    """

    def __init__(
        self,
        frames: Sequence[JointFrame],
        registrations: Registrations,
        shared: StationErrorDraws | None = None,
        carried: CarriedFrames | None = None,
    ) -> None:
        k, self.registrations = len(frames), registrations
        covariances = [frame.covariance for frame in frames] + [e.covariance for e in registrations]
        seen, stated = sum(map(len, covariances)), 6 * k + 4
        said = () if carried is None else carried.T
        if carried is not None:
            covariances += list(carried.covariances)
        noise = np.asarray(block_diag(*covariances), dtype=float)
        common = np.zeros((len(noise), 0)) if shared is None else shared.residuals(registrations)
        whole = np.linalg.cholesky(noise + common @ common.T)
        whitener = np.asarray(np.linalg.inv(whole), dtype=float)
        origin = np.mean([frame.shape.as_array for frame in frames], axis=0)

        def residuals(x: Array) -> Array:
            T = [pose_vector.pose_from_vector(v) for v in x[: 6 * k].reshape(k, 6)]
            shape = x[6 * k : stated] + origin
            off = list[Array]()
            for T_own, frame in zip(T, frames, strict=True):
                # The station takes its own frame for j: it finds j at the identity.
                off += [pose_vector.pose_to_vector(inverse_pose(T_own))]
                off += [shape - frame.shape.as_array]
            for edge in registrations:
                between = inverse_pose(T[edge.overlap.first]) @ T[edge.overlap.second]
                off.append(pose_vector.pose_to_vector(between) - pose_vector.pose_to_vector(edge.T))
            for T_own, T_said in zip(T, said, strict=bool(len(said))):
                by_carrier = inverse_pose(pose_vector.pose_from_vector(x[stated:])) @ T_own
                off.append(
                    pose_vector.pose_to_vector(by_carrier) - pose_vector.pose_to_vector(T_said)
                )
            return np.asarray(whitener @ np.concatenate(off))

        start, least = np.zeros(stated + 6 * bool(len(said))), 1e-15
        found = least_squares(residuals, start, jac="3-point", x_scale=1e-4, xtol=least, ftol=least)
        jacobian: Array = np.array(found.jac)
        information, moves = jacobian.T @ jacobian, found.x[: 6 * k].reshape(k, 6)
        by_all: Array = -np.linalg.solve(information, jacobian.T @ whitener)[:stated]
        self.by_residuals: Array = by_all[:, :seen]
        self.noise_covariance: Array = by_all @ noise @ by_all.T
        self.T = np.array([pose_vector.pose_from_vector(v) for v in moves])
        self.shape = TubeDimensions(*(found.x[6 * k : stated] + origin).tolist())
        self.reduced_chi2 = 2 * float(found.cost) / (len(found.fun) - found.x.size)

    @property
    def covariance(self) -> Array:
        """Covariance of each pose without what stations share, shape (k, 6, 6)."""
        n = 6 * len(self.T)
        return np.array([self.noise_covariance[i : i + 6, i : i + 6] for i in range(0, n, 6)])


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
    count: int, registrations: Registrations
) -> tuple[Array, list[StationRegistration]]:
    """Poses of stations from overlaps alone, along the spanning tree of the surest ones.

    Parameters
    ----------
    count : int
        Of the stations, which overlaps all connect.
    registrations : sequence of StationRegistration
        Of all overlaps.

    Returns
    -------
    T : ndarray, shape (count, 4, 4)
        Maps each station's own frame j into the first one's.
    closing : list of StationRegistration
        Those that close a loop, the surest first; how far they are from `T` is the gap before
        closing.
    """
    by_sigma = sorted(registrations, key=lambda edge: edge.position_sigma)
    surest = {(e.overlap.first, e.overlap.second): e for e in reversed(by_sigma)}
    sigmas = [edge.position_sigma for edge in surest.values()]
    links = coo_array((sigmas, np.transpose(list(surest))), (count, count))
    tree = minimum_spanning_tree(links)
    order, predecessors = breadth_first_order(tree, 0, directed=False)
    T, used = np.tile(np.eye(4), (count, 1, 1)), set()
    for b in order[1:].tolist():
        a = int(predecessors[b])
        edge = surest[min(a, b), max(a, b)]
        used.add(id(edge))
        T[b] = T[a] @ (edge.T if edge.overlap.first == a else inverse_pose(edge.T))
    return T, [edge for edge in by_sigma if id(edge) not in used]
