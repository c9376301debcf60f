"""An arm whose paths are checked for collisions before it moves, and go round what blocks them.

If no detour is clear, a way is searched by RRT-Connect after J. Kuffner and S. LaValle,
*RRT-Connect: an efficient approach to single-query path planning*, ICRA 2000: a tree of clear lines
grows from either end, towards postures drawn by lot, and each towards what the other has just
reached.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from typing import Any, Final, Self

import numpy as np

from tjscan.core.devices import DeviceIdentity, EventListener
from tjscan.core.errors import ArmFault, PathBlocked, PoseUnreachable
from tjscan.core.frames import Array, readonly_copy
from tjscan.robot.arm import Arm, ArmState, MotionLock
from tjscan.robot.clearance import ClearPathPlanner
from tjscan.robot.following import Following, FollowingThrough, check_can_follow

POSTURE_TREE_STEP: Final = 0.5
"""Radians of joint space, summed in squares over the joints, by which a tree grows at once."""

MOST_RANDOM_POSTURES: Final = 1000
"""Postures that are drawn before it is given up."""

POSTURE_DRAW_MARGIN: Final = np.pi
"""Radians beyond both ends within which a joint's angle is drawn: no way winds an arm up."""

IsClear = Callable[[Array, Array], bool]
"""Whether a straight line in joint space keeps clear, ends included."""


class _PostureTree:
    """Postures that are reached from a root by clear lines."""

    def __init__(self, root: Array) -> None:
        self.postures, self._before = [root], [-1]

    def grow_towards(self, towards: Array, is_clear: IsClear) -> Array | None:
        """Grow a step towards a posture from the nearest one; the posture reached, if any."""
        away = towards - np.array(self.postures)
        nearest = int(np.einsum("ij,ij->i", away, away).argmin())
        length = float(np.linalg.norm(away[nearest]))
        reached = towards
        if length > POSTURE_TREE_STEP:
            reached = self.postures[nearest] + POSTURE_TREE_STEP / length * away[nearest]
        if length == 0 or not is_clear(self.postures[nearest], reached):
            return None
        self.postures.append(reached)
        self._before.append(nearest)
        return reached

    def way_to_root(self) -> list[Array]:
        """From the posture that was reached last back to the root."""
        way, at = [], len(self.postures) - 1
        while at >= 0:
            way.append(self.postures[at])
            at = self._before[at]
        return way


def find_clear_postures(
    start: Array, goal: Array, limits: tuple[Array, Array], is_clear: IsClear
) -> list[Array] | None:
    """Find postures between which straight lines in joint space keep clear.

    Parameters
    ----------
    start, goal : ndarray, shape (n,)
        Joint angles, radians.
    limits : (ndarray, ndarray), each of shape (n,)
        Least and greatest of them.
    is_clear : callable
        See `IsClear`.

    Returns
    -------
    list of ndarray of shape (n,), or None
        From start to goal, both included; the same each time. None if `MOST_RANDOM_POSTURES`
        lead to none.
    """
    dice = np.random.default_rng(0)
    least = np.maximum(limits[0], np.minimum(start, goal) - POSTURE_DRAW_MARGIN)
    most = np.minimum(limits[1], np.maximum(start, goal) + POSTURE_DRAW_MARGIN)
    first = _PostureTree(readonly_copy(start))
    one, other = first, _PostureTree(readonly_copy(goal))
    for _ in range(MOST_RANDOM_POSTURES):
        reached = one.grow_towards(dice.uniform(least, most), is_clear)
        if reached is not None and _grow_until_connected(other, reached, is_clear):
            ways = one.way_to_root()[::-1], other.way_to_root()[1:]
            way = [*ways[0], *ways[1]]
            return _skip_needless_postures(way if one is first else way[::-1], is_clear)
        one, other = other, one
    return None


def _grow_until_connected(tree: _PostureTree, to: Array, is_clear: IsClear) -> bool:
    """Grow a tree towards a posture as far as it goes; whether it arrived."""
    while (reached := tree.grow_towards(to, is_clear)) is not None:
        if np.array_equal(reached, to):
            return True
    return False


def _skip_needless_postures(way: list[Array], is_clear: IsClear) -> list[Array]:
    """Leave out postures between which the straight line keeps clear, until none is left to."""
    short = list(way)
    for span in range(len(way) - 1, 1, -1):
        at = 0
        while at + span < len(short):
            if is_clear(short[at], short[at + span]):
                del short[at + 1 : at + span]
            at += 1
    return short


DETOUR_LIFTS: Final = (0.05, 0.1, 0.2, 0.3)
"""Metres that a detour draws the sensor back from where it looks, tried in this order."""

CONFIGURATION_TOLERANCE: Final = 0.1
"""Radians a joint may end from where it was planned: far more than a calibrated arm differs from
its nominal model, far less than another configuration does."""

Way = Sequence[tuple[bool, Array, Array | None]]
"""Segments of a way: each straight or in joint space, its end, joint angles near its end."""

LARGEST_TURN_FROM_NEAR_JOINTS: Final = np.pi / 2
"""Radians a joint may turn on a move that has to end near given joint angles: where
one runs into its limit, the same pose a whole turn away is not near."""


@dataclass(frozen=True, slots=True, eq=False)
class PathSegment:
    """One segment of a collision-free path: a straight line of the flange, or of the joints.

    Parameters
    ----------
    straight : bool
        Whether the flange goes on a straight line, or the joints do.
    T_b_f : ndarray, shape (4, 4)
        Where the flange ends.
    q : ndarray, shape (n,)
        Where the joints end, in radians.
    """

    straight: bool
    T_b_f: Array
    q: Array


@dataclass(frozen=True, slots=True, eq=False)
class ClearPath:
    """A collision-free path: one direct segment, or a detour of two or three.

    Parameters
    ----------
    segments : tuple of PathSegment
        Its parts: the direct way is one, a detour two or three.
    blocked : PathBlocked, optional
        What blocks the direct way, if another one had to be found.
    """

    segments: tuple[PathSegment, ...]
    blocked: PathBlocked | None = None

    def __str__(self) -> str:
        blocked = self.blocked
        if blocked is None:
            return "on the direct way"
        near = f"come within {1e3 * blocked.distance:.1f} mm of it"
        touches = near if blocked.distance > 0 else "run into it"
        return (
            f"round {blocked.other}, {self._describe()}: {blocked.share:.0%} of the direct way "
            f"{blocked.moving} would {touches}"
        )

    def _describe(self) -> str:
        if len(self.segments) == 1:
            return "into another configuration"
        if not self.segments[0].straight:
            return f"through {len(self.segments) - 1} postures"
        _, across, forward = self.segments
        lift = float(np.linalg.norm(across.T_b_f[:3, 3] - forward.T_b_f[:3, 3]))
        how = "on a line" if across.straight else "in joint space"
        return f"{1e3 * lift:.0f} mm back, across {how} and forward"


class CollisionCheckedArm:
    """Any arm whose paths are checked for collisions, as a whole, before anything moves.

    If the direct path is blocked, the arm goes round: it draws the sensor back from where it
    looks, moves, and comes forward again. If a move in joint space is blocked even so, it ends
    in the nearest other configuration that is reached on a clear path.

    Parameters
    ----------
    arm : Arm
        The arm that moves.
    clearance : ClearPathPlanner
        What its paths must keep.
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange: detours draw it back along its z axis.
    lifts : iterable of float, optional
        How far, in metres, one after the other; none if detours are not wanted.

    Notes
    -----
    It reports an event, ``detour``, for every path that is not the direct one, before it begins.
    """

    def __init__(
        self,
        arm: Arm,
        clearance: ClearPathPlanner,
        T_f_s: Array,
        *,
        lifts: Iterable[float] = DETOUR_LIFTS,
    ) -> None:
        self._arm, self.clearance, self._lifts = arm, clearance, tuple(lifts)
        self._back_f = -np.asarray(T_f_s)[:3, 2]
        self._report: EventListener = lambda name, detail: None
        self._latch = MotionLock()

    def __enter__(self) -> Self:
        """Connect the arm."""
        self._latch.clear_stop()
        self._arm.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        """Stop and disconnect the arm."""
        self._latch.stop()
        self._arm.__exit__(*error)

    def state(self) -> ArmState:
        """State of the arm. See `Arm.state`."""
        return self._arm.state()

    @property
    def identity(self) -> DeviceIdentity:
        """Which arm it is; known while connected."""
        return self._arm.identity

    def report_events_to(self, listener: EventListener) -> None:
        """Report detours, and the arm's own events, to a listener from now on."""
        self._report = listener
        self._arm.report_events_to(listener)

    def check_moves(self, *T_b_f: Array) -> None:
        """Check a move in joint space and straight lines on, detours included; move nothing.

        Raises
        ------
        PathBlocked
            If arm or tool come too near to something and no detour keeps clear.
        PoseUnreachable
            If a path leaves reach or limits or comes too near to a singularity.
        """
        q, direct = self._arm.state().q, True
        for i, T in enumerate(T_b_f):
            path = self.plan_clear_path(q, T, straight=i > 0)
            last = path.segments[-1]
            direct = (
                direct and path.blocked is None and (i > 0 or self._is_nearest_solution(q, last))
            )
            q = last.q
        if direct:
            # The driver may know more of its arm; of other ways it can't be asked beforehand.
            self._arm.check_moves(*T_b_f)

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Move on a straight line, or round what blocks it. See `Arm.move_linear`.

        Raises
        ------
        PathBlocked
            Before anything moves, if arm or tool come too near to something, detours included.
        """
        return self._move_on_clear_path(T_b_f, straight=True)

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        """Move along a line in joint space, or round what blocks it. See `move_linear`.

        With `near` it ends in that configuration and no other.
        """
        return self._move_on_clear_path(T_b_f, straight=False, near=near, direct=direct)

    @property
    def moving_arm(self) -> Arm:
        """The arm that moves."""
        return self._arm

    @contextmanager
    def follow(self) -> Iterator[Following]:
        """Follow paths that grow, each checked before it is followed. See `FollowingArm.follow`."""
        with self._latch.hold_for_move(), check_can_follow(self._arm).follow() as following:
            yield FollowingThrough(following, check=self.clearance.check_motion_is_clear)

    def stop(self) -> None:
        """Bring the arm to rest now, and begin no further segment. See `Arm.stop`."""
        self._latch.stop()
        self._arm.stop()

    def accept_moves_again(self) -> None:
        """Take commands again after a stop, once all segments of the move have ended."""
        self._latch.clear_stop()
        self._arm.accept_moves_again()

    def plan_clear_path(
        self,
        q: Array,
        T_b_f: Array,
        *,
        straight: bool,
        near: Array | None = None,
        direct: bool = False,
    ) -> ClearPath:
        """Plan a collision-free path: the direct one, else a detour: back, across and forward.

        A move in joint space has one choice more: another configuration at its end; or, if it
        has to end near given joint angles, a way that is searched; see `find_clear_postures`.

        Parameters
        ----------
        q : ndarray, shape (n,)
            Where it starts, in radians.
        T_b_f : ndarray, shape (4, 4)
            Where the flange ends, in the base frame.
        straight : bool
            Whether the direct path is a line of the flange, or of the joints.
        near : ndarray, shape (n,), optional
            Joint angles near which a move in joint space has to end.
        direct : bool, optional
            Whether it takes the direct path or none.

        Raises
        ------
        PathBlocked, PoseUnreachable
            Of the direct path, if no other way keeps clear either.
        """
        try:
            return ClearPath(self._check_way_is_clear(q, [(straight, T_b_f, near)]))
        except PathBlocked as blocked:
            if direct or blocked.share == 0:  # where it is now: no way begins elsewhere
                raise
            for way in self._detours_round_obstacle(q, T_b_f, near, straight=straight):
                try:
                    segments = self._check_way_is_clear(q, way)
                    if near is not None:
                        _check_joints_stay_near(segments[-1].q, T_b_f, near)
                    return ClearPath(segments, blocked)
                except PoseUnreachable:
                    continue
            reason = blocked.reason
            if self._lifts:
                reason += f" No detour up to {1e3 * max(self._lifts):g} mm back keeps clear either."
            contact = {
                key: getattr(blocked, key) for key in ("moving", "other", "share", "distance")
            }
            raise PathBlocked(reason, blocked.T_b_f, **contact) from None

    def _detours_round_obstacle(
        self, q: Array, T_b_f: Array, near: Array | None, *, straight: bool
    ) -> Iterator[Way]:
        """Ways back, across and forward, the nearer ones first.

        After these, a move in joint space has one that is searched, if it has to end near given
        joint angles, else the direct ways into the other configurations, the nearer ones first.
        """
        kinematics = self.clearance.kinematics
        T_start = kinematics.forward(q)
        for lift, across in product(self._lifts, (straight, not straight)):
            back, ahead = (self._retract_sensor(T, lift) for T in (T_start, T_b_f))
            yield [(True, back, None), (across, ahead, near), (True, T_b_f, None)]
        if near is not None:
            yield from self._detour_through_postures(q, T_b_f, near)
        elif not straight:
            for other in kinematics.all_inverse_solutions(T_b_f, near=q)[1:]:
                yield [(False, T_b_f, other)]

    def _detour_through_postures(self, q: Array, T_b_f: Array, near: Array) -> Iterator[Way]:
        """A way through postures to a pose drawn back from the end, and forward from there.

        Straight to the end if no line leads forward.
        """
        clearance, kinematics = self.clearance, self.clearance.kinematics
        for lift in (*self._lifts, 0.0):
            ahead = self._retract_sensor(T_b_f, lift)
            forward: Way = [(True, T_b_f, None)] if lift else []
            try:
                goal = kinematics.inverse(ahead, near=near)
                for end in self._check_way_is_clear(goal, forward):
                    _check_joints_stay_near(end.q, T_b_f, near)
            except PoseUnreachable:
                continue
            limits = kinematics.lower, kinematics.upper
            found = find_clear_postures(q, goal, limits, clearance.line_is_clear)
            if found is not None:
                between = [(False, kinematics.forward(one), one) for one in found[1:-1]]
                yield [*between, (False, ahead, goal), *forward]
            return

    def _is_nearest_solution(self, q: Array, segment: PathSegment) -> bool:
        """Whether a move in joint space ends where an arm at `q` would go of itself."""
        nearest = self.clearance.kinematics.inverse(segment.T_b_f, near=q)
        return bool(np.abs(nearest - segment.q).max() < CONFIGURATION_TOLERANCE)

    def _retract_sensor(self, T_b_f: Array, lift: float) -> Array:
        T = np.array(T_b_f)
        T[:3, 3] += lift * T[:3, :3] @ self._back_f
        return T

    def _check_way_is_clear(self, q: Array, way: Way) -> tuple[PathSegment, ...]:
        clearance, segments = self.clearance, []
        for straight, T, near in way:
            if straight:
                q = clearance.joint_angles_after_linear_move(q, T)
            else:
                q = clearance.joint_angles_after_joint_move(q, T, near)
                if near is not None:
                    _check_joints_stay_near(q, T, near)
            segments.append(PathSegment(straight, T, q))
        return tuple(segments)

    def _move_on_clear_path(
        self, T_b_f: Array, *, straight: bool, near: Array | None = None, direct: bool = False
    ) -> ArmState:
        with self._latch.hold_for_move():
            state = self._arm.state()
            path = self.plan_clear_path(state.q, T_b_f, straight=straight, near=near, direct=direct)
            if path.blocked is not None:
                self._report("detour", str(path))
            for segment in path.segments:
                self._latch.check_not_stopped()
                if segment.straight:
                    state = self._arm.move_linear(segment.T_b_f)
                else:
                    state = self._arm.move_joint_to_pose(segment.T_b_f, near=segment.q)
                _check_planned_configuration(state, segment)
            return state


def _check_joints_stay_near(q: Array, T_b_f: Array, near: Array) -> None:
    """Refuse a move that is short for the flange and long for a joint."""
    away = np.abs(q - near)
    if away.max() > LARGEST_TURN_FROM_NEAR_JOINTS:
        i = int(away.argmax())
        raise PoseUnreachable(
            f"joint {i + 1} would turn by {np.degrees(away[i]):.0f} deg to hold it: the joints "
            "can't stay as they are. Start from another configuration or move the base.",
            T_b_f,
        )


def _check_planned_configuration(state: ArmState, segment: PathSegment) -> None:
    """Refuse to go on if the arm took joint angles that were not checked."""
    off = np.abs(state.q - segment.q)
    if off.max() > CONFIGURATION_TOLERANCE:
        raise ArmFault(
            f"the arm holds the pose in another configuration than was checked: joint "
            f"{int(off.argmax()) + 1} is {np.degrees(off.max()):.0f} deg off. Jog it back by hand "
            "before anything else moves."
        )
