"""Forward and inverse kinematics of an arm given as URDF.

Nothing but this, `robot/urdf.py` and `robot/collision.py` imports Pinocchio.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Final

import numpy as np
import pinocchio as pin

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError, PoseUnreachable, nearest_word
from tjscan.core.frames import Array, cross, inverse_pose, pose_from_rounded_matrix, readonly_copy
from tjscan.robot.closed_form import ClosedFormInverse
from tjscan.robot.spherical_wrist import find_spherical_wrist
from tjscan.robot.urdf import ARM_MODELS, read_urdf, ur_dh_lengths

IK_CONVERGENCE_TOLERANCE: Final = 1e-13
"""Metres and radians at which a descent ends, unless singular: so close that an arm is in the same
place whichever way it came, and a resumed scan finds what the uninterrupted one would have."""

IK_POSITION_TOLERANCE: Final = 1e-7
"""Metres: a solution puts the flange this close, also at a singularity."""

IK_ROTATION_TOLERANCE: Final = 1e-7
"""Radians."""

MOST_IK_ITERATIONS: Final = 60
"""A descent from a good seed takes four or five."""

LEAST_IK_DAMPING: Final = 1e-12
"""Least damping, in squared metres and radians: keeps a singular arm's equations solvable."""

LARGEST_IK_STEP: Final = 0.5
"""Radians a joint turns in one iteration; further, the linearisation does not hold."""

KEPT_CONFIGURATION_DISTANCE: Final = 0.5
"""Radians: a descent that stays this close to its seed has kept the configuration."""

SINGULARITY_THRESHOLD: Final = 0.05
"""Smallest singular value below which joints have to run to let the flange walk."""

RANDOM_IK_SEED_COUNT: Final = 64
"""Seeds tried if there is no closed form."""

SAME_IK_SOLUTION_TOLERANCE: Final = 1e-3
"""Radians within which two solutions are one."""

JOINT_LIMIT_ROUNDING: Final = 1e-9
"""Radians beyond a limit that are rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class _IkResult:
    """The best of a descent: joint angles and what is left in metres and radians."""

    q: Array
    position: float
    rotation: float

    @property
    def solved(self) -> bool:
        return self.position <= IK_POSITION_TOLERANCE and self.rotation <= IK_ROTATION_TOLERANCE


class _ThreadWorkspace(threading.local):
    """Pinocchio's scratch memory, one for each thread."""

    def __init__(self, model: Any) -> None:
        self.data = model.createData()


class Kinematics:
    """Kinematics of one arm, from its URDF.

    Parameters
    ----------
    urdf : Path
        The URDF of an open chain of six or more revolute joints with limits.

    Attributes
    ----------
    name : str
        Name of the robot in the URDF.
    base_name : str
        Name of frame b in the URDF.
    joint_names, link_names : tuple of str
        From the base to the flange; the last link is frame f.
    lower, upper : ndarray, shape (n,)
        Joint limits in radians.
    velocity : ndarray, shape (n,)
        Joint speed limits in rad/s.
    model : pinocchio.Model
        Pinocchio's model of the arm, on which collision checks are built.
    flange : int
        Number of its frame f.

    Raises
    ------
    ConfigurationError
        If the file is no such URDF.
    """

    def __init__(self, urdf: Path) -> None:
        with add_file_to_errors(urdf):
            model, base, self.flange = read_urdf(urdf)
        self.model = model
        self._workspace = _ThreadWorkspace(model)
        self.urdf = urdf
        self.name = str(model.name)
        self.base_name = str(model.frames[base].name)
        self.joint_names = tuple(model.names)[1:]
        links = [i for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY]
        self._links = [i for i in links if i != self.flange] + [self.flange]
        self.link_names = tuple(str(model.frames[i].name) for i in self._links)
        self.lower = readonly_copy(model.lowerPositionLimit)
        self.upper = readonly_copy(model.upperPositionLimit)
        self.velocity = readonly_copy(model.velocityLimit)
        self._T_b_root = inverse_pose(model.frames[base].placement.homogeneous)
        self._closed_form = self._find_closed_form()

    @property
    def T_root_b(self) -> Array:
        """Frame b in the root of the URDF, shape (4, 4)."""
        return inverse_pose(self._T_b_root)

    @classmethod
    def load(cls, model: str | Path) -> Kinematics:
        """Load the kinematics of an arm by its name in `ARM_MODELS`, or by the path of a URDF.

        Raises
        ------
        ConfigurationError
            If the name is unknown, or the file is missing or no usable URDF.
        """
        if str(model) in ARM_MODELS:
            with as_file(files("tjscan.robot.models") / f"{model}.urdf") as urdf:
                return cls(urdf)
        if Path(model).exists() or Path(model).suffix:
            return cls(Path(model))
        raise ConfigurationError(
            f"there is no arm model {str(model)!r}; did you mean: "
            f"{nearest_word(str(model), ARM_MODELS)}? Any other arm is given by the path of its "
            "URDF."
        )

    @property
    def joint_axes(self) -> Array:
        """Unit vectors along which the joints turn, each in its own frame, shape (n, 3)."""
        data = self.model.createData()
        q = np.zeros(self.model.nq)
        pin.computeJointJacobians(self.model, data, q)
        joints = range(1, self.model.njoints)
        jacobians = [pin.getJointJacobian(self.model, data, i, pin.LOCAL) for i in joints]
        return np.array([J[3:, i] for i, J in enumerate(jacobians)])

    @property
    def joint_placements(self) -> Array:
        """Frame of each joint, at zero, in the frame of the joint before it, shape (n, 4, 4)."""
        return np.array([M.homogeneous for M in list(self.model.jointPlacements)[1:]])

    def with_joint_placements(self, placements: Array) -> Kinematics:
        """Return the same arm with its joints placed as in `placements`, shape (n, 4, 4)."""
        other = copy(self)
        other.model = model = self.model.copy()
        for i, T in enumerate(placements, start=1):
            model.jointPlacements[i] = pin.SE3(np.asarray(T, dtype=float))
        other._workspace = _ThreadWorkspace(model)
        other._closed_form = other._find_closed_form()
        return other

    def placement_jacobian(self, q: Array) -> Array:
        """Motion of the flange for small motions of each joint's placement, shape (6, 6 n).

        Both are translation (metres) and rotation (radians), of the flange in the axes of f, of a
        joint's frame in its own axes; six columns for each joint. See Pinocchio,
        ``computeFrameKinematicRegressor``.
        """
        data, q = self._workspace.data, np.asarray(q, dtype=float)
        pin.computeJointJacobians(self.model, data, q)
        pin.updateFramePlacements(self.model, data)
        J = pin.computeFrameKinematicRegressor(self.model, data, self.flange, pin.LOCAL)
        return np.asarray(J)

    def forward(self, q: Array) -> Array:
        """Flange pose ``T_b_f``, shape (4, 4), for joint angles, shape (n,), in radians."""
        data = self._workspace.data
        pin.framesForwardKinematics(self.model, data, np.asarray(q, dtype=float))
        return np.asarray(self._T_b_root @ data.oMf[self.flange].homogeneous)

    def link_poses(self, q: Array) -> Array:
        """Poses of the links named in `link_names` in frame b, shape (k, 4, 4)."""
        data = self._workspace.data
        pin.framesForwardKinematics(self.model, data, np.asarray(q, dtype=float))
        return np.array([self._T_b_root @ data.oMf[i].homogeneous for i in self._links])

    def jacobian(self, q: Array) -> Array:
        """Geometric Jacobian: velocity of f for unit joint speeds, shape (6, n).

        The first three rows are the velocity of the flange's origin in m/s, the others its
        angular velocity in rad/s, both along the axes of b.
        """
        axes = pin.LOCAL_WORLD_ALIGNED
        q = np.asarray(q, dtype=float)
        J = pin.computeFrameJacobian(self.model, self._workspace.data, q, self.flange, axes)
        R_b_root = self._T_b_root[:3, :3]
        return np.vstack([R_b_root @ J[:3], R_b_root @ J[3:]])

    def momentum(self, q: Array, speeds: Array, payload: float = 0.0) -> Array:
        """Momentum of the moving arm: linear, kg m/s, and angular about b's origin, kg m²/s.

        Parameters
        ----------
        q, speeds : ndarray, shape (n,)
            Joint angles, radians, and their speeds, rad/s.
        payload : float
            Mass at the flange's origin beside what the URDF states of the links, kg.

        Returns
        -------
        ndarray, shape (6,)
            Along the axes of b.
        """
        model, data = self.model, self._workspace.data
        pin.forwardKinematics(model, data, np.asarray(q, dtype=float), speeds)
        of_links = sum(
            data.oMi[i].act(model.inertias[i] * data.v[i]).vector for i in range(1, model.njoints)
        )
        R, origin = self._T_b_root[:3, :3], self._T_b_root[:3, 3]
        linear = R @ of_links[:3]
        total = np.concatenate((linear, R @ of_links[3:] + cross(origin, linear)))
        carried = payload * self.jacobian(q)[:3] @ speeds
        return total + np.concatenate((carried, cross(self.forward(q)[:3, 3], carried)))

    def smallest_singular_value(self, q: Array) -> float:
        """Smallest singular value of the Jacobian: 0 if the flange loses a direction.

        It is the one of `jacobian` in metres and radians: the slowest speed of the flange, in
        m/s or rad/s, that joint speeds of norm 1 rad/s can give.
        """
        return float(np.linalg.svd(self.jacobian(q), compute_uv=False)[-1])

    def joint_limit_excess(self, q: Array) -> Array:
        """How far each joint is beyond its limits, in radians; negative within."""
        return np.maximum(self.lower - q, q - self.upper)

    def inverse(self, T_b_f: Array, near: Array) -> Array:
        """Joint angles that put the flange at a pose.

        A pose close to the one of `near` keeps its configuration. Otherwise the nearest of all
        configurations found, each joint in its nearest turn within limits, is taken: of all
        there are if there is a closed form, else of those found from many seeds about `near`
        (always the same ones).

        Parameters
        ----------
        T_b_f : ndarray, shape (4, 4)
            Flange pose in the base frame.
        near : ndarray, shape (n,)
            Joint angles to stay near, in radians.

        Returns
        -------
        ndarray, shape (n,)
            Radians, within limits.

        Raises
        ------
        PoseUnreachable
            With the reason: the reach, or a joint's limit and by how much.
        """
        near = np.asarray(near, dtype=float)
        warm = self._solve_ik_from_seed(self._target_in_root(T_b_f), near)
        is_near = np.abs(warm.q - near).max() < KEPT_CONFIGURATION_DISTANCE
        if warm.solved and is_near and self.joint_limit_excess(warm.q).max() <= 0:
            return warm.q
        return self.all_inverse_solutions(T_b_f, near)[0]

    def all_inverse_solutions(self, T_b_f: Array, near: Array) -> tuple[Array, ...]:
        """All joint configurations found that put the flange at a pose, nearest first.

        Parameters and errors are as in `inverse`; each joint is in the turn
        nearest to `near` that its limits allow.

        Returns
        -------
        tuple of ndarray, shape (n,)
            Radians, within limits; at least one.
        """
        near = np.asarray(near, dtype=float)
        target = self._target_in_root(T_b_f)
        seeds = (near, *self._ik_seeds(target, near))
        fits = [self._solve_ik_from_seed(target, seed) for seed in seeds]
        solved = [self._choose_nearest_turns(fit.q, near) for fit in fits if fit.solved]
        if not solved:
            raise PoseUnreachable(self._describe_out_of_reach(fits), T_b_f)
        allowed = [q for q in solved if self.joint_limit_excess(q).max() <= JOINT_LIMIT_ROUNDING]
        if not allowed:
            raise PoseUnreachable(self._describe_out_of_limits(solved), T_b_f)
        found: list[Array] = []
        for q in sorted(allowed, key=lambda q: float(np.linalg.norm(q - near))):
            if all(np.abs(q - other).max() > SAME_IK_SOLUTION_TOLERANCE for other in found):
                found.append(np.clip(q, self.lower, self.upper))
        return tuple(found)

    def inverse_branches(self, T_b_f: Array) -> Array:
        """The eight branches of the closed-form inverse at many poses; see `closed_form`.

        Parameters
        ----------
        T_b_f : ndarray, shape (m, 4, 4)
            Flange poses in the base frame.

        Returns
        -------
        ndarray, shape (m, 8, 6)
            Radians, from -pi to pi, whatever the limits; not a number if a branch does not
            reach. Of a calibrated arm it is as close as that differs from its maker's drawing.

        Raises
        ------
        ConfigurationError
            If there is none: the arm has neither parallel axes 2, 3 and 4 nor a spherical wrist.
        """
        if self._closed_form is None:
            raise ConfigurationError(
                f"the reach of a {self.name} can't be searched: there is no closed form of its "
                "inverse kinematics. That takes six joints whose axes 2, 3 and 4 are parallel, as "
                "of Universal Robots arms, or 2 and 3 parallel and 4, 5 and 6 through one point",
                key="arm.model",
            )
        T_0_root = inverse_pose(self.model.jointPlacements[1].homogeneous)
        T_f_6 = inverse_pose(self.model.frames[self.flange].placement.homogeneous)
        T_0_6 = T_0_root @ inverse_pose(self._T_b_root) @ T_b_f @ T_f_6
        q = self._closed_form.inverse_branches(T_0_6)
        q[~np.isfinite(q).all(axis=2)] = np.nan
        return np.asarray(q - 2 * np.pi * np.round(q / (2 * np.pi)))

    def _find_closed_form(self) -> ClosedFormInverse | None:
        if self.model.nq != 6:
            return None
        lengths = ur_dh_lengths(self.model)
        return lengths or find_spherical_wrist(self.joint_axes, self.joint_placements)

    def _target_in_root(self, T_b_f: Array) -> Any:
        """Pose of f in the root of the URDF, its rotation freed from rounding."""
        try:
            return pin.SE3(inverse_pose(self._T_b_root) @ pose_from_rounded_matrix(T_b_f))
        except ValueError as error:
            raise PoseUnreachable(f"it is no pose: {error}", T_b_f) from None

    def _solve_ik_from_seed(self, target: Any, seed: Array) -> _IkResult:
        """Damped Gauss-Newton on SE(3).

        The damping is the squared error (Sugihara 2011, Solvability-unconcerned inverse
        kinematics by the Levenberg-Marquardt method, IEEE Trans. Robotics 27(5)): it vanishes
        at a solution and holds the steps short if there is none.
        """
        model, data, flange = self.model, self._workspace.data, self.flange
        q = np.array(seed, dtype=float)
        best, best_error, least = q, np.full(6, np.inf), np.inf
        eye = np.eye(6)
        for _ in range(MOST_IK_ITERATIONS):
            # In this order: a Jacobian in local axes leaves the placements as they were.
            pin.framesForwardKinematics(model, data, q)
            error = pin.log6(data.oMf[flange].actInv(target)).vector
            squared = float(error @ error)
            if squared < least:
                best, best_error, least = q, error, squared
            if squared < IK_CONVERGENCE_TOLERANCE**2:
                break
            J = pin.computeFrameJacobian(model, data, q, flange, pin.LOCAL)
            step = J.T @ np.linalg.solve(J @ J.T + (0.5 * squared + LEAST_IK_DAMPING) * eye, error)
            longest = np.abs(step).max()
            q = q + (step if longest < LARGEST_IK_STEP else step * (LARGEST_IK_STEP / longest))
        position, rotation = (float(np.linalg.norm(e)) for e in (best_error[:3], best_error[3:]))
        return _IkResult(best, position, rotation)

    def _ik_seeds(self, target: Any, near: Array) -> Iterable[Array]:
        """Where to begin a search for other configurations."""
        if self._closed_form is not None:
            # Frame 6 is the last link's frame here; the flange is anywhere on it.
            T_root_0 = self.model.jointPlacements[1]
            T_6_f = self.model.frames[self.flange].placement
            T_0_6 = T_root_0.actInv(target) * T_6_f.inverse()
            return self._closed_form.all_inverse_solutions(T_0_6.homogeneous, near)
        random = np.random.default_rng(0)
        spread = np.linspace(0.2, np.pi, RANDOM_IK_SEED_COUNT)[:, None]
        seeds = near + spread * random.standard_normal((RANDOM_IK_SEED_COUNT, near.size))
        return np.clip(seeds, self.lower, self.upper)

    def _choose_nearest_turns(self, q: Array, near: Array) -> Array:
        """`q` with each joint in the turn nearest to `near` that its limits allow."""
        turn = 2 * np.pi
        turns = q + turn * (np.round((near - q) / turn) + np.arange(-2, 3)[:, None])
        beyond = np.maximum(self.joint_limit_excess(turns), 0.0)
        beyond[beyond <= JOINT_LIMIT_ROUNDING] = 0.0
        order = np.lexsort((np.abs(turns - near), beyond), axis=0)
        return np.asarray(np.take_along_axis(turns, order[:1], axis=0)[0])

    def _describe_out_of_reach(self, fits: list[_IkResult]) -> str:
        best = min(fits, key=lambda fit: fit.position + fit.rotation)
        stretched = self.smallest_singular_value(best.q)
        return (
            f"it is out of reach; the nearest found is {1e3 * best.position:.1f} mm and "
            f"{np.degrees(best.rotation):.1f} deg off, with the arm "
            f"{'near singular' if stretched < SINGULARITY_THRESHOLD else 'free'} "
            f"(smallest singular value {stretched:.3f}). Move the base or the pose."
        )

    def _describe_out_of_limits(self, solved: list[Array]) -> str:
        q = min(solved, key=lambda q: float(self.joint_limit_excess(q).max()))
        i = int(self.joint_limit_excess(q).argmax())
        limit = self.upper[i] if q[i] > self.upper[i] else self.lower[i]
        return (
            f"{self.joint_names[i]} would have to be at {np.degrees(q[i]):.1f} deg, "
            f"{np.degrees(self.joint_limit_excess(q)[i]):.1f} deg beyond its limit of "
            f"{np.degrees(limit):.1f} deg. Choose another configuration or move the base."
        )
