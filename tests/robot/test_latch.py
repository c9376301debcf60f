"""A stop holds: what was ordered before it and has not started never does."""

import threading

import pytest

from tjscan.core.errors import ArmFault
from tjscan.robot.arm import MotionLock

PATIENCE = 10.0
"""Seconds after which a thread that should have gone on has not."""


def test_after_a_stop_nothing_starts_until_it_is_taken_back() -> None:
    latch = MotionLock()
    latch.check_not_stopped()
    assert not latch.wait_for_stop(0.0)
    latch.stop()
    assert latch.wait_for_stop(0.0)
    latch.stop()  # twice is once
    for way in (latch.hold_for_move, latch.begin_move_unless_stopped):
        with pytest.raises(ArmFault, match="taken back"), way():
            pytest.fail("it began")
    latch.clear_stop()
    with latch.hold_for_move(), latch.begin_move_unless_stopped():
        pass


def test_a_move_that_was_ordered_before_a_stop_never_starts_after_it() -> None:
    latch = MotionLock()
    with latch.hold_for_move():
        latch.stop()
        with pytest.raises(ArmFault, match="taken back"), latch.begin_move_unless_stopped():
            pytest.fail("it began")


def test_one_moves_at_a_time() -> None:
    latch = MotionLock()
    with (
        latch.hold_for_move(),
        pytest.raises(ArmFault, match="moving already"),
        latch.hold_for_move(),
    ):
        pytest.fail("two moved")
    with latch.hold_for_move():
        pass


def test_a_stop_returns_when_what_starts_has_started() -> None:
    latch, done = MotionLock(), threading.Event()

    def stop() -> None:
        latch.stop()
        done.set()

    stopper = threading.Thread(target=stop)
    with latch.hold_for_move():
        with latch.begin_move_unless_stopped():
            stopper.start()
            assert latch.wait_for_stop(PATIENCE)  # it is known at once
            assert not done.is_set()
        assert done.wait(PATIENCE)
    stopper.join()


def test_a_stop_can_be_given_by_what_interrupts_a_start() -> None:
    latch = MotionLock()
    with latch.hold_for_move(), latch.begin_move_unless_stopped():
        latch.stop()
    assert latch.wait_for_stop(0.0)


def test_a_stop_is_taken_back_once_the_move_it_stopped_has_ended() -> None:
    latch, clearing, done = MotionLock(), threading.Event(), threading.Event()

    def clear() -> None:
        clearing.set()
        latch.clear_stop()
        done.set()

    clearer = threading.Thread(target=clear)
    with latch.hold_for_move():
        latch.stop()
        clearer.start()
        assert clearing.wait(PATIENCE)
        assert not done.is_set()
        with pytest.raises(ArmFault), latch.begin_move_unless_stopped():
            pytest.fail("it began")
    assert done.wait(PATIENCE)
    clearer.join()
    latch.check_not_stopped()


def test_nothing_starts_between_a_stop_and_its_end() -> None:
    latch, started, ended = MotionLock(), [0], threading.Event()

    def move() -> None:
        while not ended.is_set():
            try:
                with latch.hold_for_move(), latch.begin_move_unless_stopped():
                    started[0] += 1
            except ArmFault:
                continue

    mover = threading.Thread(target=move)
    mover.start()
    for _ in range(200):
        latch.stop()
        count = started[0]
        threading.Event().wait(0.0)  # let the mover try
        assert started[0] == count
        latch.clear_stop()
    ended.set()
    mover.join()
