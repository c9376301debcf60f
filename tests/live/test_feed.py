"""A run hands over what the page shows, and never waits for it."""

from collections.abc import Sequence
from threading import Event

import pytest

from tjscan.live.listening import FEED_CAPACITY, LiveFeed


def test_entries_come_in_their_order() -> None:
    shown: list[int] = []
    feed = LiveFeed(shown.extend, pytest.fail)
    for k in range(100):
        feed.post_entry(k)
    feed.close()
    assert shown == list(range(100))


def test_a_page_that_hangs_holds_nobody_up() -> None:
    going, seen = Event(), Event()
    said: list[str] = []

    def hang(_: Sequence[int]) -> None:
        seen.set()
        going.wait()

    feed = LiveFeed(hang, said.append)
    feed.post_entry(0)
    assert seen.wait(10)
    for k in range(3 * FEED_CAPACITY):
        feed.post_entry(k)
    assert feed.dropped == 2 * FEED_CAPACITY
    going.set()
    feed.close()
    assert said == [f"the page did not keep up: {2 * FEED_CAPACITY} entries are missing from it"]


def test_a_page_that_dies_is_reported_once_and_left_alone() -> None:
    said: list[str] = []
    dead = Event()

    def die(_: Sequence[int]) -> None:
        raise OSError("gone")

    def say(text: str) -> None:
        said.append(text)
        dead.set()

    feed = LiveFeed(die, say)
    feed.post_entry(1)
    assert dead.wait(10)
    feed.post_entry(2)
    feed.close()
    assert len(said) == 1
    assert "the run goes on" in said[0]
    assert "gone" in said[0]
