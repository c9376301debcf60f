"""An arm rests when no joint has turned for a while; whoever waits for it waits no longer."""

from __future__ import annotations

import threading
from typing import Self

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.errors import ArmFault
from tjscan.core.frames import Array
from tjscan.robot.arm import (
    LARGEST_TURN_AT_REST,
    LEAST_REST_DURATION,
    REST_TIMEOUT,
    STATE_READING_PAUSE,
    ArmState,
    await_rest,
    check_arm_has_not_moved,
)
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan.robot.simulated import SimulatedArm

FLICKER = 5e-5
"""Radians: encoders at rest."""

CREEP = 2 * LARGEST_TURN_AT_REST / LEAST_REST_DURATION
"""rad/s: slower than this is not told from rest for sure."""


class LedArm(SimulatedArm):
    """An arm that a hand leads for a while, at a speed of its sixth joint, on a clock of its own.

    Its encoders flicker.
    """

    def __init__(self, speed: float, seconds: float) -> None:
        super().__init__(Kinematics.load("ur10e"), np.radians([0, -80, 100, -60, -80, 20]))
        self.speed, self.seconds, self.clock = speed, seconds, 0.0
        self.random = np.random.default_rng(0)

    def state(self) -> ArmState:
        at: Array = super().state().q.copy()
        at[5] += self.speed * min(self.clock, self.seconds)
        at += self.random.uniform(-FLICKER, FLICKER, 6)
        return ArmState(at, self.kinematics.forward(at), self.clock)

    def pause(self, seconds: float) -> None:
        self.clock += seconds

    def rest(self) -> ArmState:
        return await_rest(self, now=lambda: self.clock, pause=self.pause)

    def __enter__(self) -> Self:
        super().__enter__()
        return self


@settings(max_examples=50, deadline=None)
@given(speed=st.floats(CREEP, 1.0), seconds=st.floats(0.0, REST_TIMEOUT - 2 * LEAST_REST_DURATION))
def test_a_state_at_rest_is_one_after_the_motion(speed: float, seconds: float) -> None:
    with LedArm(speed, seconds) as arm:
        state = arm.rest()
        assert state.time >= min(seconds, REST_TIMEOUT)
        # Flickering encoders may hold a slow motion on for another window.
        assert state.time <= seconds + 2 * LEAST_REST_DURATION + 3 * STATE_READING_PAUSE
        check_arm_has_not_moved(state, arm.state())


@settings(max_examples=20, deadline=None)
@given(speed=st.floats(CREEP, 1.0))
def test_an_arm_that_never_rests_is_not_waited_for_for_ever(speed: float) -> None:
    with LedArm(speed, np.inf) as arm:
        with pytest.raises(ArmFault, match="does not come to rest"):
            arm.rest()
        assert REST_TIMEOUT < arm.clock <= REST_TIMEOUT + 2 * STATE_READING_PAUSE


def test_an_arm_that_moved_meanwhile_is_told() -> None:
    with LedArm(1.0, 1.0) as arm:
        before = arm.state()
        check_arm_has_not_moved(before, arm.state())
        arm.pause(0.5)
        with pytest.raises(ArmFault, match=r"moved while the laser looked.*28\.6\d deg"):
            check_arm_has_not_moved(before, arm.state())


def test_the_end_of_a_move_is_waited_for() -> None:
    kinematics = Kinematics.load("ur10e")
    home = np.radians([0, -80, 100, -60, -80, 20])
    goal = np.array(kinematics.forward(home))
    goal[1, 3] += 0.05
    with SimulatedArm(kinematics, home, limits=MotionLimits(tcp_speed=0.2), realtime=True) as arm:
        mover = threading.Thread(target=arm.move_linear, args=[goal])
        mover.start()
        while arm.state().time == 0:
            pass
        found = await_rest(arm)
        mover.join()
        np.testing.assert_array_equal(found.q, arm.state().q)
        np.testing.assert_allclose(found.T_b_f[:3, 3], goal[:3, 3], atol=1e-6)
