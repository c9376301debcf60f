"""Tests draw the same examples every time: a red test is red for everybody.

A file run by itself draws the first 25 examples of each law, so that it answers within a second;
``make test`` and CI draw 60, by ``--hypothesis-profile thorough``.
"""

import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

settings.register_profile("thorough", derandomize=True, deadline=None, max_examples=60)
settings.register_profile("quick", parent=settings.get_profile("thorough"), max_examples=25)
settings.load_profile("quick")


@pytest.fixture
def ctrl_c_is_heard() -> Iterator[None]:
    """Let SIGINT interrupt also where a shell started the tests in the background, without it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
