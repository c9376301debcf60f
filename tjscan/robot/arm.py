"""The protocol that every arm, real or simulated, fulfils."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tjscan.core.devices import Device
from tjscan.core.frames import Array, frozen_arrays


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class ArmState:
    """State of an arm: its joint angles, flange pose and time.

    Parameters
    ----------
    q : ndarray, shape (n,)
        Joint angles in radians.
    T_b_f : ndarray, shape (4, 4)
        Flange pose in the base frame.
    time : float
        Seconds on the arm's own clock. A simulated arm's clock runs with its motion, not
        with the wall.
    """

    q: Array
    T_b_f: Array
    time: float


class Arm(Device, Protocol):
    """A robot arm that moves its flange to poses; disconnecting stops it.

    Each event, such as a detour, is reported before it begins.
    """

    def state(self) -> ArmState:
        """Joint angles, flange pose and time, as the arm reads them now."""

    def check_moves(self, *T_b_f: Array) -> None:
        """Check a move in joint space to the first pose and straight lines on to the others.

        Nothing moves.

        Raises
        ------
        PoseUnreachable
            If the path leaves the joint limits or the reach.
        """

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Move the flange on a straight line to a pose, and return the state reached.

        Raises
        ------
        PoseUnreachable
            Before anything moves, if the path leaves the joint limits or the reach.
        ArmFault
            If the arm stopped on the way.
        """

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        """Move to a flange pose along a line in joint space, and return the state reached.

        It ends in the configuration nearest to the joint angles `near`, shape (n,), in radians;
        nearest to those it has where they are left out. An arm that goes round what blocks its
        way does not if the path is to be `direct`.

        Raises
        ------
        PoseUnreachable
            Before anything moves, if no configuration within limits holds that pose.
        ArmFault
            If the arm stopped on the way.
        """

    def stop(self) -> None:
        """Bring the arm to rest now, from any thread, and let it begin no move any more.

        The move under way raises ArmFault in its own thread; so does every later one, until the
        stop is taken back by `accept_moves_again`, or by connecting again.
        """

    def accept_moves_again(self) -> None:
        """Take commands again after a stop, once the move that was stopped has ended.

        Not from within a move's own thread while it moves: this waits for it.
        """
