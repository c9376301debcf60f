"""A Universal Robots arm over its network interfaces, behind the `Arm` protocol.

The client library ur-rtde runs in a process of its own (`ur_client`); this one asks it, never
longer than a time limit, and keeps the dashboard at hand to stop the arm without it. Every
move is begun and then watched, so that it can be stopped; what the arm says of itself is
watched with it. After a fault the arm takes no more orders: nothing resumes by itself.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from itertools import chain, repeat
from types import NoneType, TracebackType
from typing import Final, Self, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.errors import (
    ArmBusy,
    ArmFault,
    ArmLinkLost,
    ArmNotReached,
    ArmSilent,
    ConfigurationError,
    PoseMissed,
    ProgramStopped,
    RegistersInUse,
    TargetRefused,
)
from tjscan.frames import Array, inverse, pose, rotation_angle
from tjscan.robot.arm import ArmState
from tjscan.robot.dashboard import Dashboard
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.motion import JointPath, MotionLimits
from tjscan.robot.path import joint_path, linear_path
from tjscan.robot.ur_faults import (
    fault_of,
    power_fault,
    program_fault,
    remote_fault,
    safety_fault,
    start_fault,
)
from tjscan.robot.ur_link import ClientFailed, Link
from tjscan.robot.ur_watch import ClockWatch
from tjscan.robot.ur_words import Snapshot

T = TypeVar("T")

POLL: Final = 0.004
"""Seconds between two looks at a move."""

STOP: Final = 2.0
"""rad/s² of the leading axis when a move is stopped."""

STARTS: Final = 2.0
"""Seconds within which a move that was accepted begins, and a value that was set is shown."""

STALLED: Final = 10.0
"""Seconds that a move may stand still: the speed slider may be at zero for a moment."""

SLACK: Final = 1.0
"""Seconds that the client's process may take for itself on a busy machine."""

SETTLED: Final = 1.0
"""Seconds the arm may take to come to rest where it was told to."""

REST: Final = 5e-3
"""rad/s: what encoders show of a joint that stands, an assumption."""

CREEP: Final = 1e-5
"""Radians a joint turns at least between two looks at an arm that moves."""

SAME: Final = 1e-6
"""Metres, radians or kilograms between a value that was set and the same read back."""

OTHER_ARM: Final = 0.005
"""Metres between the flange as the controller and as the model has it, beyond calibration.

Less than the clearance's default margins: what is planned on the model holds for the arm.
"""

SWING: Final = 0.005
"""Metres that the flange may swing aside while it turns on the spot, within any margin."""

OTHER_CONFIGURATION: Final = 0.1
"""Radians between the controller's inverse and ours, beyond calibration."""

FASTEST: Final = 3.0
"""rad/s: the client library refuses more than 3.14."""

QUICKEST: Final = 39.0
"""rad/s²: the client library refuses more than 40."""


@dataclass(frozen=True, slots=True)
class UrSettings:
    """How to reach and to judge an arm.

    Parameters
    ----------
    host : str
        The controller's address.
    payload : float, optional
        What the arm carries, in kilograms; what its pendant says where left out.
    centre_of_gravity : tuple of float, optional
        Of the payload, in frame f, metres.
    position_tolerance, rotation_tolerance : float, optional
        Metres and radians between the pose asked for and the one reached.
    connect_limit : float, optional
        Seconds a connection may take.
    silence_limit : float, optional
        Seconds for which the controller's clock may stand.
    """

    host: str
    payload: float | None = None
    centre_of_gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    position_tolerance: float = 5e-4
    rotation_tolerance: float = 2e-3
    connect_limit: float = 15.0
    silence_limit: float = 1.0


@dataclass(frozen=True, slots=True)
class UrIdentity:
    """Which arm it is, as far as its controller tells.

    Parameters
    ----------
    model, serial, software : str
        Model, serial number and version of the controller's software; empty where not told.
    payload : float or None
        The active payload in kilograms.
    """

    model: str
    serial: str
    software: str
    payload: float | None


class UrArm:
    """A real arm, or the loopback controller.

    Parameters
    ----------
    kinematics : Kinematics
        The arm as its maker draws it; where it differs by its calibration, the controller's
        word holds.
    settings : UrSettings
        Where it is.
    limits : MotionLimits, optional
        How fast it may move.
    """

    def __init__(
        self, kinematics: Kinematics, settings: UrSettings, limits: MotionLimits | None = None
    ) -> None:
        self.kinematics, self.settings = kinematics, settings
        self.limits = MotionLimits() if limits is None else limits
        self._dashboard: Dashboard | None = None
        self._link: Link | None = None
        self._identity: UrIdentity | None = None
        self._fault: ArmFault | None = None
        self._watch = ClockWatch(settings.silence_limit)
        self._T_tcp_f = np.eye(4)
        self._moving = threading.Lock()
        self._halt = threading.Event()

    def __enter__(self) -> Self:
        """Connect, set TCP and payload, and read them back; nothing moves.

        Raises
        ------
        ArmFault
            If the arm can't be reached or is not ready, each cause by its own error.
        ConfigurationError
            If it is another model than it should be.
        """
        self._fault, self._watch = None, ClockWatch(self.settings.silence_limit)
        self._halt.clear()
        try:
            self._connect()
        except BaseException as error:
            if self._link is not None and not isinstance(error, (RegistersInUse, ArmNotReached)):
                self._stop_program()  # ours runs, or may
            self._disconnect()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop, end the program on the controller, and disconnect."""
        self.stop()
        if self._link is not None and self._fault is None:
            try:
                self._link.ask(NoneType, "end")
            except (ArmFault, ClientFailed):
                self._stop_program()
        self._disconnect()

    @property
    def identity(self) -> UrIdentity:
        """Which arm it is; known while connected."""
        if self._identity is None:
            raise ArmFault("the arm is not connected: use it inside a 'with' block")
        return self._identity

    def state(self) -> ArmState:
        """Joint angles, flange pose and time, as the controller tells them."""
        return self._state_of(self._look())

    def check(self, *T_b_f: Array) -> None:
        """Plan a move in joint space and straight lines on, and move nothing. See `Arm.check`."""
        q = np.array(self._look().q)
        plans = chain([self._joint_path], repeat(self._linear_path))
        for plan, T in zip(plans, T_b_f, strict=False):
            q = plan(q, T).q[-1]

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Move the flange on a straight line to a pose. See `Arm.move_linear`.

        Raises
        ------
        TargetRefused
            Before anything moves, if the controller holds the pose for unsafe.
        PoseMissed
            If the arm came to rest somewhere else.
        """
        return self._move(T_b_f, self._linear_path, self._begin_linear)

    def move_joint(self, T_b_f: Array, near: Array | None = None) -> ArmState:
        """Move to the nearest configuration that holds a pose. See `move_linear`."""
        return self._move(T_b_f, partial(self._joint_path, near=near), self._begin_joint)

    def stop(self) -> None:
        """Bring the arm to rest; the move under way raises ArmFault in its own thread."""
        self._halt.set()

    # Connecting

    def _connect(self) -> None:
        host = self.settings.host
        if find_spec("rtde_control") is None:
            raise ConfigurationError(
                "the client library of this driver is missing: pip install 'tjscan[ur]'",
                key="arm.driver",
            )
        self._dashboard = dashboard = Dashboard(host)
        if (fault := _unready(dashboard)) is not None:
            raise fault
        self._await_nobody(dashboard)
        self._link = Link()
        try:
            self._link.ask(NoneType, "connect", host, limit=self.settings.connect_limit)
            self._await_program()
            self._set_up()
        except ClientFailed as failed:
            raise _unready(dashboard) or start_fault(host, str(failed)) from None
        self._identity = UrIdentity(
            model=_told(dashboard.ask("get robot model")),
            serial=_told(dashboard.ask("get serial number")),
            software=_told(dashboard.ask("PolyscopeVersion")),
            payload=self._look().payload,
        )

    def _await_nobody(self, dashboard: Dashboard) -> None:
        """See that no program runs: the client library would end it without asking."""
        limit = time.monotonic() + STARTS  # the dashboard is slow to tell of a program's end
        while dashboard.value("running").lower() == "true":
            if time.monotonic() > limit:
                raise ArmBusy(
                    "another program runs on the arm's controller. End it on the pendant, or end "
                    "the program that sent it, then start again."
                )
            self._halt.wait(POLL)

    def _await_program(self) -> None:
        """Let both links show the program that was started."""
        limit = time.monotonic() + STARTS
        while (fault := fault_of(self._open_link.look(STARTS))) is not None:
            if time.monotonic() > limit or not isinstance(fault, ProgramStopped):
                raise fault
            self._halt.wait(POLL)

    def _set_up(self) -> None:
        settings = self.settings
        self._ask(bool, "watch")
        # The TCP on the flange itself: poses mean the flange, whatever the pendant had set.
        self._ask(bool, "set_tcp", (0.0,) * 6)
        offset = self._ask(list, "tcp")
        if len(offset) != 6 or np.abs(offset).max() > SAME:
            self._look()  # the true reason, if the arm is not well
            raise self._disobeyed("TCP", "zero", offset)
        self._T_tcp_f = inverse(_pose_of(offset))
        if settings.payload is not None:
            self._ask(bool, "set_payload", settings.payload, settings.centre_of_gravity)
            limit = time.monotonic() + STARTS
            while not _carries(now := self._look(), settings):
                if time.monotonic() > limit:
                    raise self._disobeyed("payload", f"{settings.payload:g} kg", now.payload)
                self._halt.wait(POLL)
        state = self.state()
        apart = np.linalg.norm(self.kinematics.forward(state.q)[:3, 3] - state.T_b_f[:3, 3])
        if apart > OTHER_ARM:
            raise ConfigurationError(
                f"the controller has its flange {1e3 * apart:.0f} mm from where a "
                f"{self.kinematics.name} with these joint angles has it: name the arm that "
                "stands there, or see what its installation says of its mounting",
                key="arm.model",
            )

    def _disobeyed(self, what: str, wanted: str, found: object) -> ArmFault:
        return ArmFault(
            f"the controller was told to set its {what} to {wanted} and says {found}. See that "
            "nobody else works with it, then start again."
        )

    def _disconnect(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None
        if self._dashboard is not None:
            self._dashboard.close()
            self._dashboard = None
        self._identity = None

    # Looking

    @property
    def _open_link(self) -> Link:
        if self._fault is not None:
            raise self._fault
        if self._link is None:
            raise ArmFault("the arm is not connected: use it inside a 'with' block")
        return self._link

    def _look(self) -> Snapshot:
        """What the arm says of itself; raises what is wrong with it, and ends with it then."""
        link = self._open_link
        try:
            now = link.look(self.settings.silence_limit + SLACK)
            self._watch.see(now)
            fault = fault_of(now)
        except ArmFault as found:
            fault = found
        except ClientFailed as failed:
            fault = ArmLinkLost(f"the connection to the arm's controller broke ({failed}).")
        if fault is not None:
            raise self._end_with(fault)
        return now

    def _cause(self, fault: ArmFault) -> ArmFault:
        """Why the program stopped or nobody answers, where the dashboard knows."""
        if isinstance(fault, (ProgramStopped, ArmSilent)) and self._dashboard is not None:
            with suppress(ArmFault):
                running = self._dashboard.value("running")
                return _unready(self._dashboard) or program_fault(running) or fault
        return fault

    def _state_of(self, now: Snapshot) -> ArmState:
        return ArmState(np.array(now.q), _pose_of(now.tcp) @ self._T_tcp_f, now.time)

    # Moving

    def _linear_path(self, q: Array, T_b_f: Array) -> JointPath:
        return linear_path(self.kinematics, q, T_b_f, self.limits)

    def _joint_path(self, q: Array, T_b_f: Array, near: Array | None = None) -> JointPath:
        goal = self.kinematics.inverse(T_b_f, near=q if near is None else near)
        return joint_path(self.kinematics, q, goal, self.limits)

    def _move(
        self,
        T_b_f: Array,
        plan: Callable[[Array, Array], JointPath],
        begin: Callable[[JointPath, Array], bool],
    ) -> ArmState:
        if not self._moving.acquire(blocking=False):
            raise ArmFault("the arm is moving already: wait for that move or stop it")
        try:
            # Before the planning, so that a stop given while it plans holds.
            self._halt.clear()
            before = self._look()
            path = plan(np.array(before.q), T_b_f)
            if path.duration == 0:
                return self._arrived(T_b_f)
            if not self._ask(bool, "pose_is_safe", self._tcp(T_b_f)):
                self._look()  # the true reason, if the arm is not well
                raise TargetRefused(
                    "that is outside the safety limits set on its pendant. Look at its safety "
                    "planes and joint limits, or move the base.",
                    T_b_f,
                )
            try:
                if not begin(path, T_b_f):
                    self._look()
                    raise TargetRefused("it did not begin the move. Read its pendant's log.", T_b_f)
                self._follow(before)
            except BaseException:
                self._rest()
                raise
            return self._arrived(T_b_f)
        finally:
            self._moving.release()

    def _begin_linear(self, path: JointPath, T_b_f: Array) -> bool:
        way = self.kinematics.forward(path.q[-1])[:3, 3] - self.kinematics.forward(path.q[0])[:3, 3]
        length = float(np.linalg.norm(way))
        if length < SAME:
            return self._begin_turn(path, T_b_f)
        speed, acceleration = _bounds(path, length)
        return self._ask(bool, "move_linear", self._tcp(T_b_f), speed, acceleration)

    def _begin_turn(self, path: JointPath, T_b_f: Array) -> bool:
        """A line without length: a speed of the flange bounds no turn, speeds of joints do."""
        straight = path.q[0] + np.linspace(0, 1, 9)[:, None] * (path.q[-1] - path.q[0])
        places = np.array([self.kinematics.forward(q)[:3, 3] for q in straight])
        if np.linalg.norm(places - places[0], axis=1).max() > SWING:
            raise TargetRefused(
                "a turn this wide on the spot would swing the flange aside; turn in parts.", T_b_f
            )
        return self._begin_joint(path, T_b_f)

    def _begin_joint(self, path: JointPath, T_b_f: Array) -> bool:
        goal = path.q[-1]
        # The controller knows how its arm differs from the drawing; ours is the configuration.
        q = np.array(self._ask(list, "inverse", self._tcp(T_b_f), tuple(goal.tolist())))
        if q.shape != goal.shape or np.abs(q - goal).max() > OTHER_CONFIGURATION:
            self._look()
            raise TargetRefused("it finds no configuration near the one planned.", T_b_f)
        speed, acceleration = _bounds(path, float(np.abs(goal - path.q[0]).max()))
        return self._ask(
            bool,
            "move_joint",
            tuple(q.tolist()),
            min(speed, FASTEST),
            min(acceleration, QUICKEST),
        )

    def _follow(self, before: Snapshot) -> None:
        """Watch a move until it has ended."""
        began, moved, last = time.monotonic(), time.monotonic(), np.array(before.q)
        while True:
            stopping = self._halt.wait(POLL)
            now, moment = self._look(), time.monotonic()
            if stopping:
                raise ArmFault(
                    "the arm was stopped on its way. See that the way is clear, then move again "
                    "from where it stands."
                )
            if now.operation == before.operation:
                if moment > began + STARTS:
                    raise self._end_with(
                        ProgramStopped("the controller accepted a move and does not begin it.")
                    )
            elif not now.moving:
                return
            q = np.array(now.q)
            if np.abs(q - last).max() > CREEP:
                moved, last = moment, q
            if moment > moved + STALLED:
                raise self._end_with(
                    ArmSilent(
                        f"the arm stands still for {STALLED:g} s in the middle of a move. See "
                        "that the speed slider on its pendant is not at zero, then start again."
                    )
                )

    def _arrived(self, T_b_f: Array) -> ArmState:
        """Wait until the arm rests, and check where."""
        limit, first = time.monotonic() + SETTLED, self._look().time
        while True:
            now = self._look()
            # A look later than the one that saw the end: both links have the end by then.
            newer, state = now.time > first, self._state_of(now)
            rests = newer and np.abs(now.speed).max() < REST
            distance = float(np.linalg.norm(state.T_b_f[:3, 3] - T_b_f[:3, 3]))
            angle = rotation_angle(state.T_b_f, T_b_f)
            near = (
                distance <= self.settings.position_tolerance
                and angle <= self.settings.rotation_tolerance
            )
            if rests and near:
                return state
            if newer and time.monotonic() > limit:
                raise PoseMissed(
                    f"it stands {1e3 * distance:.2f} mm and {np.degrees(angle):.2f} deg from "
                    "there. See that the payload is right and nothing holds the arm.",
                    T_b_f,
                    state.T_b_f,
                )
            self._halt.wait(POLL)

    def _tcp(self, T_b_f: Array) -> tuple[float, ...]:
        """A flange pose as the controller takes it: of the active TCP, with a rotation vector."""
        T_b_tcp = T_b_f @ inverse(self._T_tcp_f)
        turn = Rotation.from_matrix(T_b_tcp[:3, :3]).as_rotvec()
        return (*T_b_tcp[:3, 3].tolist(), *turn.tolist())

    def _ask(self, kind: type[T], name: str, *arguments: object) -> T:
        """Ask the client; what it raises becomes the arm's fault."""
        try:
            return self._open_link.ask(kind, name, *arguments)
        except ClientFailed as failed:
            self._look()  # the true reason, if the arm is not well
            raise self._end_with(
                ArmFault(f"the client library failed at {name}: {failed}. Start again.")
            ) from None
        except ArmFault as fault:
            raise self._end_with(fault) from None

    # Ending

    def _rest(self) -> None:
        """Stop the move under way; the arm stays at hand if it is well."""
        if self._fault is None and self._link is not None:
            try:
                self._link.ask(NoneType, "stop", STOP)
            except (ArmFault, ClientFailed) as fault:
                self._end_with(fault if isinstance(fault, ArmFault) else ArmFault(str(fault)))

    def _end_with(self, fault: ArmFault) -> ArmFault:
        """Stop the arm by whatever still works, and take no more orders; returns the fault."""
        if self._fault is None:
            self._fault = self._cause(fault)
            self._stop_program()
            if self._link is not None:
                self._link.close()
        return self._fault

    def _stop_program(self) -> None:
        """Tell the controller without the client to end our program, and all motion with it."""
        if self._dashboard is not None:
            with suppress(ArmFault):
                self._dashboard.ask("stop")


def _unready(dashboard: Dashboard) -> ArmFault | None:
    """What keeps the arm from moving, as the dashboard tells, the cause before its consequences."""
    return (
        safety_fault(dashboard.value("safetystatus"))
        or power_fault(dashboard.value("robotmode"))
        or remote_fault(dashboard.ask("is in remote control"))
    )


def _bounds(path: JointPath, length: float) -> tuple[float, float]:
    """Speed and acceleration along a path of this length that take as long as it does."""
    speed = length / (path.duration - path.ramp)
    return speed, speed / path.ramp


def _pose_of(values: tuple[float, ...] | list[float]) -> Array:
    """Pose from metres and a rotation vector."""
    return pose(Rotation.from_rotvec(values[3:]).as_matrix(), values[:3])


def _carries(now: Snapshot, settings: UrSettings) -> bool:
    """Whether the payload is the one asked for, or is not told at all."""
    if now.payload is None or now.centre_of_gravity is None or settings.payload is None:
        return True
    found = np.array([now.payload, *now.centre_of_gravity])
    wanted = np.array([settings.payload, *settings.centre_of_gravity])
    return bool(np.abs(found - wanted).max() < SAME)


def _told(answer: str) -> str:
    """An answer of the dashboard, or nothing where it does not know the question."""
    return "" if "understand" in answer.lower() or "not supported" in answer.lower() else answer
