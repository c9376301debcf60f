"""An arm that is where it was in a recording, and moves nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from tjscan.core.devices import LocalDevice
from tjscan.core.errors import ArmFault
from tjscan.core.frames import Array
from tjscan.laser.replay import RecordedPoses
from tjscan.robot.arm import ArmState


class ReplayedArm(LocalDevice):
    """An arm that replays a recording, behind the `Arm` protocol.

    It answers a move with the state that was recorded, so the scan goes on from where the arm
    truly was.

    Parameters
    ----------
    poses : RecordedPoses
        Where it was at each view; the same object that a replayed laser takes its profiles by.
    states : sequence of ArmState
        Its states at these views.
    """

    not_connected = (ArmFault, "the recording is not open: use it inside a 'with' block")

    def __init__(self, poses: RecordedPoses, states: Sequence[ArmState]) -> None:
        self._poses, self._states = poses, tuple(states)

    def __enter__(self) -> Self:
        """Make ready; there is nothing to replay in a recording without a view.

        Raises
        ------
        ArmFault
            If the recording is empty.
        """
        if not self._states:
            raise ArmFault("the recording holds no view, so there is nothing to replay")
        return super().__enter__()

    def state(self) -> ArmState:
        """Recorded state at the view that was last asked for; at first, at the first one."""
        self.check_connected()
        return self._states[self._poses.current_view_number]

    def check_moves(self, *T_b_f: Array) -> None:
        """Check that the recording holds these views. See `RecordedPoses.check_views`."""
        self._poses.check_views(*T_b_f)

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Go on to the recorded view with this pose.

        Raises
        ------
        ViewNotRecorded
            If none of those ahead was recorded from there.
        """
        self.state()  # open?
        self._poses.go_to_view(T_b_f)
        return self.state()

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        """Go on to the recorded view with this pose; see `move_linear`."""
        return self.move_linear(T_b_f)

    def stop(self) -> None:
        """Do nothing: a replayed arm does not move."""

    def accept_moves_again(self) -> None:
        """Do nothing: a replayed arm was not stopped."""
