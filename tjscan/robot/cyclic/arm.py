"""An arm behind the `Arm` protocol that is sent its joint angles in every cycle.

A process of its own answers the controller in every cycle (`client`); this one plans each move,
hands it the joint angles of every cycle, and watches it. After a fault the arm takes no more
commands: nothing resumes by itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from math import ceil
from typing import Any, Final, Self

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.core.process import ClientProcess
from tjscan.robot.arm import STATE_READING_PAUSE, ArmState
from tjscan.robot.cyclic.client import LEAVE_LIMIT
from tjscan.robot.cyclic.settings import CyclicSettings
from tjscan.robot.cyclic.stream import StreamState
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import JointTrajectory, MotionLimits
from tjscan.robot.planned import PathPlan, PlannedArm

CLIENT_START_LIMIT: Final = 30.0
"""Seconds within which the client starts; a busy machine takes its time."""

CLIENT_ANSWER_LIMIT: Final = 3.0
"""Seconds within which the client answers."""

WRONG_ARM_MODEL_DISTANCE: Final = 0.005
"""Metres between the flange as the controller and as the model has it, beyond calibration."""

UNCLEAR_J3_DISTANCE: Final = 4 * WRONG_ARM_MODEL_DISTANCE
"""Metres between the flanges of both counts of J3, below which the pose does not show which."""

J2_AT_J3: Final = np.outer(np.eye(6)[1], np.eye(6)[2])
"""Joint angles times this have J2 in the place of J3, and else 0."""

ARRIVAL_SETTLE_TIMEOUT: Final = 1.0
"""Seconds on the controller's clock that the arm may lag behind what was sent."""

REST_TURN: Final = 2e-5
"""Radians a joint turns at most while the arm rests, an assumption about its encoders."""

REST_DURATION: Final = 0.05
"""Seconds on the controller's clock for which it does, then."""


def rows_of_cycles(path: JointTrajectory, cycle: float) -> Array:
    """Joint angles of a path in each cycle, shape (m, n): from its start, rest to rest."""
    count = ceil(path.duration / cycle)
    return path.joint_angles_at(np.linspace(0.0, count * cycle, count + 1))


class CyclicArm(PlannedArm):
    """An arm whose controller asks for joint angles in every cycle, or a loopback in its place.

    Its poses are computed from its joint angles by the model, which counts J3 from the upper arm.
    The pose that a controller reports shows whether it counts J3 from the horizontal, if it may.

    Parameters
    ----------
    kinematics : Kinematics
        The arm as its maker draws it, six joints.
    settings : CyclicSettings
        Where its controller is.
    limits : MotionLimits, optional
        How fast it may move.
    """

    def __init__(
        self, kinematics: Kinematics, settings: CyclicSettings, limits: MotionLimits | None = None
    ) -> None:
        if len(kinematics.lower) != 6:
            message = f"{settings.session} moves six joints, {kinematics.name} has "
            message += f"{len(kinematics.lower)}"
            raise errors.ConfigurationError(message, key="arm.model")
        super().__init__(kinematics, limits)
        self.settings = settings
        self._link: ClientProcess | None = None
        self._fault: errors.ArmFault | None = None
        self._noted: set[str] = set()
        self._j3_from_horizontal = False

    def __enter__(self) -> Self:
        """Wait until the controller sends, and hold the arm where it is; nothing moves.

        Raises
        ------
        ArmFault
            If it does not send, or its program ran already.
        ConfigurationError
            If it is another model than it should be.
        """
        self._latch.clear_stop()
        self._fault, self._noted = None, set()
        self._link = ClientProcess(
            "tjscan.robot.cyclic.client",
            "the client of the arm's controller",
            errors.ArmConnectionLost,
            errors.ArmNotResponding,
        )
        try:
            self._ask_client("connect", self.settings, limit=CLIENT_START_LIMIT)
            self._await_first_packet()
            if self.settings.j3_count_varies:
                self._find_j3_count()
            self._check_flange()
        except BaseException:
            self._disconnect()
            raise
        return self

    def __exit__(self, *error: Any) -> None:
        """Bring the arm to rest, let the controller end its program, and disconnect."""
        self.stop()
        self._disconnect()

    def state(self) -> ArmState:
        """Joint angles, flange pose and time, as the controller reports them."""
        return self._arm_state(self._read_state())

    def _move(self, plan: PathPlan, T_b_f: Array, *, linear: bool) -> ArmState:
        with self._latch.hold_for_move():
            path = plan(self._model_angles(self._read_state().command))
            if path.duration > 0:
                rows = self._controller_angles(rows_of_cycles(path, self.settings.cycle))
                try:
                    with self._latch.begin_move_unless_stopped():
                        self._ask_client("begin_move", rows, path.ramp)
                    self._follow_move_to_its_end()
                except BaseException:
                    with suppress(errors.ArmFault):
                        self._ask_client("stop_move")
                        self._await_rest()
                    raise
            return self._await_arrival(T_b_f)

    def _follow_move_to_its_end(self) -> None:
        while self._read_state().moving:
            if self._latch.wait_for_stop(STATE_READING_PAUSE):
                raise errors.ArmFault(
                    "the arm was stopped on its way. See that the way is clear, then move again "
                    "from where it is."
                )

    def _await_arrival(self, T_b_f: Array) -> ArmState:
        """Wait until the arm rests where it was sent; else it takes no more commands."""

        def compare(now: StreamState) -> tuple[float, float, bool]:
            return self.settings.compare_with_wanted_pose(self._arm_state(now).T_b_f, T_b_f)

        now = self._await_rest(lambda now: compare(now)[2])
        (distance, angle, near), reached = compare(now), self._arm_state(now)
        if not near:
            self._fault = errors.PoseNotReached(
                f"it is {1e3 * distance:.2f} mm and {np.degrees(angle):.2f} deg from there. See "
                "that nothing holds the arm, and that no limit of its controller does, then start "
                "again.",
                T_b_f,
                reached.T_b_f,
            )
            raise self._fault
        try:
            self._check_flange()
        except errors.ConfigurationError as error:  # a joint that was at 0 turns the other way
            self._fault = errors.ArmFault(f"{error.message}; a joint may turn the other way")
            raise self._fault from None
        return reached

    def _await_rest(self, arrived: Callable[[StreamState], bool] = lambda now: True) -> StreamState:
        """Wait until the arm rests after a path, and has arrived, but not for ever."""
        ended = still = self._read_state()
        while True:
            now = self._read_state()
            ended = now if now.moving else ended
            still = now if np.abs(now.q - still.q).max() > REST_TURN else still
            rests = now.time >= max(still.time, ended.time) + REST_DURATION
            if (rests and arrived(now)) or now.time > ended.time + ARRIVAL_SETTLE_TIMEOUT:
                return now
            time.sleep(STATE_READING_PAUSE)

    def _await_first_packet(self) -> None:
        settings, until = self.settings, time.monotonic() + self.settings.connect_limit
        place = f"the controller at {settings.host}, {settings.listening}"
        program = f"its {settings.session} program on the pendant"
        self._listener("connecting", f"waits for {place}: start {program}")
        while self._ask_client("read_state") is None:
            if time.monotonic() > until:
                ignored = self._ask_client("read_ignored").items()
                raise errors.ArmNotConnected(
                    f"no packet came from {place}, that could be answered, for "
                    f"{settings.connect_limit:g} s"
                    f"{''.join(f'; {count} {what} were ignored' for what, count in ignored)}. "
                    f"Start {program} while this one waits; see that its configuration names this "
                    "address and port, and that no firewall is between."
                )
            self._latch.wait_for_stop(STATE_READING_PAUSE)

    def _find_j3_count(self) -> None:
        state = self._read_state()
        counts = (state.q, state.q + state.q @ J2_AT_J3)
        flanges_b = np.array([self.kinematics.forward(q)[:3, 3] for q in counts])
        if np.linalg.norm(flanges_b[0] - flanges_b[1]) < UNCLEAR_J3_DISTANCE:
            raise errors.ConfigurationError(
                "with J2 near 0 the arm does not show whether its controller counts J3 from the "
                "horizontal or from the upper arm: jog J2 by 5 deg, then start again",
                key="arm.model",
            )
        apart = np.linalg.norm(flanges_b - state.tool_b, axis=1)
        self._j3_from_horizontal = bool(apart[1] < apart[0])

    def _check_flange(self) -> None:
        """Refuse an arm whose controller has its flange elsewhere than the model has it."""
        state = self._read_state()
        apart = self._flange_distance(self._model_angles(state.q), state)
        if apart > WRONG_ARM_MODEL_DISTANCE:
            raise errors.ConfigurationError(
                f"the controller has its flange {1e3 * apart:.0f} mm from where a "
                f"{self.kinematics.name} with these joint angles has it: name the right arm, or "
                f"{self.settings.frames_advice}",
                key="arm.model",
            )

    def _flange_distance(self, q: Array, state: StreamState) -> float:
        """Metres between the flange as the model has it, and as the controller reports it."""
        return float(np.linalg.norm(self.kinematics.forward(q)[:3, 3] - state.tool_b))

    def _model_angles(self, q: Array) -> Array:
        """Joint angles of the model from those of the controller, shape (..., 6)."""
        return np.asarray(q + self._j3_from_horizontal * q @ J2_AT_J3)

    def _controller_angles(self, q: Array) -> Array:
        """Joint angles of the controller from those of the model, shape (..., 6)."""
        return np.asarray(q - self._j3_from_horizontal * q @ J2_AT_J3)

    def _read_state(self) -> StreamState:
        state: StreamState = self._ask_client("read_state")
        for what in state.ignored.keys() - self._noted:
            self._noted.add(what)
            self._listener("packets", f"there were packets of the controller {what}")
        return state

    def _arm_state(self, state: StreamState) -> ArmState:
        q = self._model_angles(state.q)
        return ArmState(q, self.kinematics.forward(q), state.time)

    def _ask_client(self, name: str, *arguments: object, limit: float = CLIENT_ANSWER_LIMIT) -> Any:
        """Call a method of the client; raises the arm's fault if there is one."""
        if self._fault is not None:
            raise self._fault
        if self._link is None:
            raise errors.ArmFault("the arm is not connected: use it inside a 'with' block")
        answer = self._link.call_method(name, *arguments, limit=limit)
        if isinstance(answer.failure, errors.ArmFault):
            self._fault = answer.failure
            raise self._fault
        return answer.value

    def _disconnect(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close(patience=LEAVE_LIMIT)
