"""The program that follows a path on a Universal Robots controller, packet by packet."""

from __future__ import annotations

import numpy as np
import pytest
from followed import START, FollowingController, wandering_path
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.robot.following import JointMotion
from tjscan.robot.ur.following import extended_path
from tjscan_loopback.faults import ScheduledFault
from tjscan_loopback.ur.faults import InjectedFault

ROUNDING = 1e-7
"""Radians: angles are sent in steps of 6e-8."""

PACKET_FAULTS = (
    InjectedFault.LOSE_PACKETS,
    InjectedFault.LATE_PACKETS,
    InjectedFault.DOUBLE_PACKETS,
    InjectedFault.REORDER_PACKETS,
    InjectedFault.FREEZE_REGISTERS,
)


class Led:
    """A controller that is led along paths which change again and again."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.controller = FollowingController(seed)
        self.path = self.sent = JointMotion.at_rest(START, 0.0)
        self.epoch = 0

    def fault(self, fault: InjectedFault) -> None:
        self.controller.controller.schedule_fault(ScheduledFault(fault))

    def replan(self, ticks: int = 100, ahead: float = 0.2) -> bool:
        """Send another path, and let ticks pass; whether it was taken over."""
        now = self.controller.now
        later = wandering_path(self.random, self.path, now + ahead)
        path, first = extended_path(self.path, later, now)
        self.epoch += 1
        self.sent = path
        self.controller.send(self.epoch, path, first)
        for _ in range(ticks):
            self.advance()
        return self.controller.verdict == self.epoch

    def advance(self, *, connected: bool = True) -> None:
        """Let a tick pass: the set-point is on the path that was taken over last."""
        self.controller.advance(connected=connected)
        now, target = self.controller.now, self.controller.targets[-1]
        if self.controller.verdict == self.epoch:
            self.path = self.sent
        if self.controller.runs and not np.array_equal(target, self.controller.actual[-1]):
            np.testing.assert_allclose(target, self.path.at(now)[0], atol=ROUNDING)

    def run_out(self, *, connected: bool = False) -> None:
        """Go on until the program has ended, or for ten seconds."""
        for _ in range(5000):
            if not self.controller.runs:
                break
            self.advance(connected=connected)

    def check_never_beside_path(self) -> None:
        """No set-point jumps, no joint acceleration is more than the paths have, no stop."""
        assert not any("protective" in line for line in self.controller.told)
        times = np.array(self.controller.times)
        went = np.flatnonzero(np.diff(times, prepend=-1.0))
        steps = np.diff(np.array(self.controller.targets)[went], axis=0)
        assert np.abs(np.diff(steps, axis=0)).max() < 1e-4  # 25 rad/s²


@settings(max_examples=6)
@given(st.integers(0, 10_000))
def test_set_points_are_those_of_the_path_at_each_tick(seed: int) -> None:
    led = Led(seed)
    for _ in range(4):
        assert led.replan()
    led.check_never_beside_path()
    led.run_out()
    assert not led.controller.runs
    np.testing.assert_allclose(led.controller.actual[-1], led.path.q[-1], atol=1e-5)


@pytest.mark.parametrize("fault", PACKET_FAULTS)
@settings(max_examples=6)
@given(seed=st.integers(0, 10_000))
def test_whatever_happens_to_packets_the_arm_stays_on_its_path_and_rests_at_its_end(
    fault: InjectedFault, seed: int
) -> None:
    led = Led(seed)
    assert led.replan()
    led.fault(fault)
    for _ in range(4):
        led.replan(int(led.random.integers(20, 150)))
    led.check_never_beside_path()
    led.run_out()
    assert not led.controller.runs
    np.testing.assert_allclose(led.controller.actual[-1], led.path.q[-1], atol=1e-5)


@settings(max_examples=6)
@given(st.integers(0, 10_000))
def test_a_path_that_comes_too_late_is_refused(seed: int) -> None:
    led = Led(seed)
    assert led.replan()
    led.fault(InjectedFault.FREEZE_REGISTERS)
    assert not led.replan(100, ahead=0.15)
    led.controller.controller.packets.faults.clear()
    assert led.replan()
    led.check_never_beside_path()


@settings(max_examples=6)
@given(st.integers(0, 10_000))
def test_a_link_that_is_cut_at_any_moment_leaves_the_arm_at_rest_on_its_path(seed: int) -> None:
    led = Led(seed)
    for _ in range(3):
        led.replan(int(led.random.integers(1, 120)))
    for _ in range(int(led.path.end / 0.002) + 5):
        led.advance(connected=False)
    led.check_never_beside_path()
    assert led.controller.now >= led.path.end
    np.testing.assert_allclose(led.controller.targets[-1], led.path.q[-1], atol=ROUNDING)


@settings(max_examples=6)
@given(st.integers(0, 10_000))
def test_at_half_speed_the_path_is_the_same_and_takes_twice_as_long(seed: int) -> None:
    led = Led(seed)
    led.fault(InjectedFault.SLIDER_HALF)
    ticks = len(led.controller.times)
    assert led.replan(400)
    assert led.controller.now == pytest.approx(
        (len(led.controller.times) - ticks) * 0.001, abs=0.005
    )
    led.fault(InjectedFault.SLIDER_ZERO)
    before = led.controller.now
    for _ in range(100):
        led.advance()
    assert led.controller.now <= before + 0.002
    led.fault(InjectedFault.SLIDER_FULL)
    for _ in range(100):
        led.advance()
    led.check_never_beside_path()


@settings(max_examples=6)
@given(st.integers(0, 10_000))
def test_a_stop_brings_the_arm_to_rest_on_its_path_at_once(seed: int) -> None:
    led = Led(seed)
    assert led.replan(200)
    led.controller.stopping = 1.0
    for _ in range(205):
        led.advance()
    assert led.controller.now == led.controller.times[-2]
    led.run_out(connected=True)
    assert not led.controller.runs
    assert np.abs(np.diff(led.controller.actual[-2:], axis=0)).max() < 1e-6
    led.check_never_beside_path()


@settings(max_examples=6)
@given(st.integers(0, 10_000))
def test_the_arm_lags_behind_its_set_points(seed: int) -> None:
    led = Led(seed)
    assert led.replan(300)
    behind = np.array(led.controller.targets[:-20]) - led.controller.actual[20:]
    assert np.abs(np.array(led.controller.targets) - led.controller.actual).max() > 1e-3
    assert np.abs(behind).max() < 3e-3


def test_an_epoch_before_the_last_counts_for_nothing() -> None:
    led = Led(1)
    assert led.replan()
    led.epoch = -1  # the next has the number 0
    assert not led.replan()


def test_a_path_that_jumps_or_does_not_end_at_rest_is_refused() -> None:
    led = Led(2)
    assert led.replan()
    now = led.controller.now
    path, first = extended_path(led.path, wandering_path(led.random, led.path, now + 0.2), now)
    beside = JointMotion(path.times, path.q + 0.01, path.speed)
    led.controller.send(5, beside, first)
    for _ in range(60):
        led.advance()
    assert led.controller.verdict == -5
    led.controller.send(6, path, first)
    last = max(led.controller.waiting)
    cut = led.controller.waiting[last].copy()
    cut[3:] += 2.0**20  # of the speeds
    led.controller.waiting[last] = cut
    for _ in range(60):
        led.advance()
    assert led.controller.verdict == -6
