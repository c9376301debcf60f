"""Whether a whole path keeps clear: of everything around, of the arm itself, of singularities."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.errors import PathBlocked, PoseUnreachable
from tjscan.core.frames import Array
from tjscan.robot.collision import BodyPair, CollisionModel
from tjscan.robot.following import JointMotion
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import describe_place_on_path, interpolate_joints, linear_waypoints
from tjscan.robot.settings import ClearanceMargins

PATH_CHECK_RESOLUTION: Final = 1e-3
"""Metres that bodies may come nearer between two looks at a path: by half of it, at most, they
come nearer than their margin unseen."""

ALLOWED_APPROACH: Final = 1e-4
"""Metres by which a path that begins within a margin may come nearer still."""


class ClearPathPlanner:
    """Plans paths of an arm and refuses those that do not keep clear.

    A path that begins within a margin is allowed as long as it comes no nearer, so that an arm
    which was led by hand close to something can leave it.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    model : CollisionModel
        What must keep apart.
    margins : ClearanceMargins, optional
        How far apart.
    """

    def __init__(
        self, kinematics: Kinematics, model: CollisionModel, margins: ClearanceMargins | None = None
    ) -> None:
        self.kinematics, self._model = kinematics, model
        self.margins = ClearanceMargins() if margins is None else margins

    def set_measured_surface(self, vertices_b: Array, triangles: NDArray[np.int64]) -> None:
        """Keep clear of a surface that was measured; see `CollisionModel.set_measured_surface`."""
        self._model.set_measured_surface(vertices_b, triangles)

    def nearest_bodies(self, q: Array) -> tuple[BodyPair, float] | None:
        """The two bodies nearest to each other, and their distance in metres; None without bodies.

        Parameters
        ----------
        q : ndarray, shape (n,)
            Joint angles in radians.
        """
        distances = self._model.distances(q)
        if distances.size == 0:
            return None
        i = int(distances.argmin())
        return self._model.pairs[i], float(distances[i])

    def joint_angles_after_linear_move(self, q: Array, T_b_f: Array) -> Array:
        """Joint angles after a straight line of the flange, which must keep clear.

        Parameters
        ----------
        q : ndarray, shape (n,)
            Where it starts, in radians.
        T_b_f : ndarray, shape (4, 4)
            Where the flange ends, in the base frame.

        Raises
        ------
        PathBlocked
            If arm or tool come too near to something.
        PoseUnreachable
            If the line leaves the reach or the joint limits, or comes too near to a singularity.
        """
        path, _ = linear_waypoints(self.kinematics, q, T_b_f)
        self._check_clear_of_singularities(path, T_b_f)
        self._check_clear_of_bodies(path, T_b_f)
        return np.asarray(path[-1])

    def joint_angles_after_joint_move(
        self, q: Array, T_b_f: Array, near: Array | None = None
    ) -> Array:
        """Joint angles after a move in joint space, which must keep clear.

        Near a singularity such a move is harmless; only its end is kept from one. It ends in
        the configuration nearest to `near`, shape (n,), or to `q` if that is left out.
        Other parameters and errors are as in `joint_angles_after_linear_move`.
        """
        goal = self.kinematics.inverse(T_b_f, near=q if near is None else near)
        path = interpolate_joints(q, goal)
        self._check_clear_of_singularities(path[[0, -1]], T_b_f)
        self._check_clear_of_bodies(path, T_b_f)
        return np.asarray(path[-1])

    def check_motion_is_clear(self, motion: JointMotion) -> None:
        """Check the path that a motion takes; see `PathBlocked`.

        Raises
        ------
        PathBlocked
            If arm or tool come too near to something.
        PoseUnreachable
            If it comes too near to a singularity.
        """
        T_b_f = self.kinematics.forward(motion.q[-1])
        self._check_clear_of_singularities(motion.q, T_b_f)
        self._check_clear_of_bodies(motion.q, T_b_f)

    def clearance_check(self, spare: float = 0.0) -> Callable[[Array], bool]:
        """Make a check whether bodies are no nearer to each other than their margins.

        Parameters
        ----------
        spare : float, optional
            Metres more to what is around the arm.

        Returns
        -------
        callable
            For joint angles, shape (n,), in radians. It knows nothing of a surface that is
            measured later.
        """
        around = np.array([not pair.own for pair in self._model.pairs], dtype=bool)
        nearer = self._model.make_nearness_check(self._margins_of_pairs + spare * around)
        return lambda q: nearer(q) is None

    def line_is_clear(self, q: Array, goal: Array) -> bool:
        """Whether a line in joint space keeps clear, and ends in no singularity.

        Parameters
        ----------
        q, goal : ndarray, shape (n,)
            Where it starts and ends, radians.
        """
        if self.kinematics.smallest_singular_value(goal) < self.margins.singular:
            return False
        walk = _DistancesOnPath(self._model, np.array([q, goal]))
        return self._find_first_contact(walk)[1] is None

    def _check_clear_of_singularities(self, path: Array, T_b_f: Array) -> None:
        smallest = np.array([self.kinematics.smallest_singular_value(q) for q in path])
        # As with distances: an arm near a singularity may leave it.
        short = smallest < min(self.margins.singular, float(smallest[0]))
        if short.any():
            i = int(short.argmax())
            raise PoseUnreachable(
                f"{describe_place_on_path(i / (len(path) - 1))}the arm is too near to a "
                f"singularity (smallest singular value {smallest.min():.3f}, at least "
                f"{self.margins.singular:g} is asked for). Move the base, or start from another "
                "configuration.",
                T_b_f,
            )

    def _check_clear_of_bodies(self, path: Array, T_b_f: Array) -> None:
        walk = _DistancesOnPath(self._model, path)
        least, touched = self._find_first_contact(walk)
        if touched is None:
            return
        short = least - walk.distances(touched)
        i = int(short.argmax())
        later = np.arange(np.ceil(touched), walk.end + 1)
        distance = min(float(walk.distances(s)[i]) for s in (touched, *later))
        pair, share = self._model.pairs[i], touched / walk.end
        raise PathBlocked(
            _describe_approach(pair, share, distance, float(self._margins_of_pairs[i])),
            T_b_f,
            moving=pair.moving,
            other=pair.other,
            share=share,
            distance=distance,
        )

    @property
    def _margins_of_pairs(self) -> Array:
        own = np.array([pair.own for pair in self._model.pairs], dtype=bool)
        return np.where(own, self.margins.own, self.margins.solids)

    def _find_first_contact(self, walk: _DistancesOnPath) -> tuple[Array, float | None]:
        """Least distances of a walk, and the first s at which one is less, or None."""
        start, margins = walk.distances(0.0), self._margins_of_pairs
        least = np.where(start < margins, np.maximum(start - ALLOWED_APPROACH, 0.0), margins)
        if (start < least).any():
            return least, 0.0
        return least, walk.first_place_nearer_than(
            least, (0.0, start), (walk.end, walk.distances(walk.end))
        )


class _DistancesOnPath:
    """Distances along a path, at s from 0 to the number of its pieces."""

    def __init__(self, model: CollisionModel, path: Array) -> None:
        self._model, self._path = model, path
        turned = np.abs(np.diff(path, axis=0))
        self._turned = np.vstack([np.zeros(path.shape[1]), turned.cumsum(axis=0)])
        self.end = float(len(path) - 1)

    def distances(self, s: float) -> Array:
        return self._model.distances(_interpolate_rows(self._path, s))

    def first_place_nearer_than(
        self, least: Array, from_: tuple[float, Array], to: tuple[float, Array]
    ) -> float | None:
        """First s at which a distance falls below `least`, looking no closer than needed.

        Where two bodies are `a` apart at one s and `b` at another, and come nearer by at most
        `m` between them, they are never nearer than (a + b - m) / 2.
        """
        (s_0, d_0), (s_1, d_1) = from_, to
        nearer = self._model.reach @ (
            _interpolate_rows(self._turned, s_1) - _interpolate_rows(self._turned, s_0)
        )
        if (d_0 + d_1 - nearer >= 2 * least).all():
            return None
        if nearer.max() <= PATH_CHECK_RESOLUTION:
            return s_1 if (d_1 < least).any() else None
        s = (s_0 + s_1) / 2
        middle = (s, self.distances(s))
        found = self.first_place_nearer_than(least, from_, middle)
        return self.first_place_nearer_than(least, middle, to) if found is None else found


def _interpolate_rows(values: Array, s: float) -> Array:
    """Rows at `s`, interpolated."""
    i = min(int(s), len(values) - 2)
    return np.asarray(values[i] + (s - i) * (values[i + 1] - values[i]))


def _describe_approach(pair: BodyPair, share: float, distance: float, margin: float) -> str:
    if share == 0 and distance <= 0:
        return (
            f"where the arm is now, {pair.moving} already overlaps {pair.other} by "
            f"{-1e3 * distance:.1f} mm. Jog it free by hand, or correct the job's [clearance]."
        )
    how = (
        f"would run into {pair.other}, up to {-1e3 * distance:.1f} mm deep"
        if distance < 0
        else f"would come within {1e3 * distance:.1f} mm of {pair.other}, where "
        f"{1e3 * margin:g} mm are asked for"
    )
    return (
        f"{describe_place_on_path(share)}{pair.moving} {how}. Teach a pose with more room, "
        "clear the way, or correct the job's [clearance]."
    )
