"""Any arm whose poses are corrected by what a calibration found of its kinematics."""

from __future__ import annotations

from typing import Any, Self

from tjscan.core.devices import DeviceIdentity, EventListener
from tjscan.core.frames import Array, inverse_pose
from tjscan.robot.arm import Arm, ArmState
from tjscan.robot.kinematics import Kinematics


class CorrectedArm:
    """An arm that takes and reports true poses of its flange, as far as a calibration knows.

    The arm itself goes on planning with its own kinematics. Its poses are corrected by the motion
    from where the model has the flange at its joint angles to where the calibrated model has it,
    as they were when it was calibrated. Between the ends of a line the flange is where the arm
    leads it: micrometres off.

    Parameters
    ----------
    arm : Arm
        The arm.
    model, calibrated : Kinematics
        Its model, and the same with the deviations found.
    """

    def __init__(self, arm: Arm, model: Kinematics, calibrated: Kinematics) -> None:
        self._arm, self._model, self._calibrated = arm, model, calibrated

    def __enter__(self) -> Self:
        """Connect the arm."""
        self._arm.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        """Stop and disconnect the arm."""
        self._arm.__exit__(*error)

    @property
    def identity(self) -> DeviceIdentity:
        """Which arm it is; known while connected."""
        return self._arm.identity

    def report_events_to(self, listener: EventListener) -> None:
        """Report the arm's events to a listener from now on."""
        self._arm.report_events_to(listener)

    def state(self) -> ArmState:
        """Joint angles, flange pose and time. See `Arm.state`."""
        return self._corrected(self._arm.state())

    def check_moves(self, *T_b_f: Array) -> None:
        """Check that moves are possible, without moving. See `Arm.check_moves`."""
        q, commanded = self._arm.state().q, []
        for T in T_b_f:
            q = self._calibrated.inverse(T, near=q)
            commanded.append(self._commanded(T, q))
        self._arm.check_moves(*commanded)

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Move the flange on a straight line to a pose. See `Arm.move_linear`."""
        q = self._calibrated.inverse(T_b_f, near=self._arm.state().q)
        return self._corrected(self._arm.move_linear(self._commanded(T_b_f, q)))

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        """Move to the nearest configuration that holds a pose. See `Arm.move_joint_to_pose`."""
        q = self._calibrated.inverse(T_b_f, near=self._arm.state().q if near is None else near)
        return self._corrected(
            self._arm.move_joint_to_pose(self._commanded(T_b_f, q), near, direct=direct)
        )

    def stop(self) -> None:
        """Bring the arm to rest now. See `Arm.stop`."""
        self._arm.stop()

    def accept_moves_again(self) -> None:
        """Take commands again after a stop. See `Arm.accept_moves_again`."""
        self._arm.accept_moves_again()

    def _corrected(self, state: ArmState) -> ArmState:
        further = inverse_pose(self._model.forward(state.q)) @ self._calibrated.forward(state.q)
        return ArmState(state.q, state.T_b_f @ further, state.time)

    def _commanded(self, T_b_f: Array, q: Array) -> Array:
        """Pose to command so that the flange truly gets to a pose."""
        back = inverse_pose(self._calibrated.forward(q)) @ self._model.forward(q)
        return T_b_f @ back
