"""Tests draw the same examples every time: a red test is red for everybody.

A file run by itself draws the first 25 examples of each law, so that it answers within a second;
``make test`` and CI draw 60, by ``--hypothesis-profile thorough``.
"""

import os

# Workers share the processor already: threads of their own only wait for each other there.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import signal
from collections.abc import Generator, Iterator

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


LONGEST_FIRST = ("towing", "study", "live", "runs", "cli", "robot", "calibration")
"""Rooms whose files take longest: begun first, none of them is left for one worker at the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests of rooms that take longest first."""
    order = {room: place for place, room in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: order.get(item.path.parent.name, len(order)))


MISSING_DATA = "the recorded "
"""Beginning of the reason of a skip for recorded data that is missing: no part of the project."""


def fail_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip into a failure on CI, which installs everything that tests need.

    Tests of recorded data that is missing, and tests that are expected to fail, stay as they are.
    """
    if not (os.environ.get("CI") and report.skipped) or hasattr(report, "wasxfail"):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if not reason.removeprefix("Skipped: ").startswith(MISSING_DATA):
        report.outcome = "failed"
        report.longrepr = f"skipped on CI, where nothing may be missing: {reason}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Fail a test that is skipped on CI."""
    report = yield
    fail_skip(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Fail a file of tests that is skipped on CI."""
    report = yield
    fail_skip(report)
    return report
