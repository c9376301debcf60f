"""Boxes of every page and report: text that overlaps or is cut off, buttons out of reach.

Makes a small run of every task, and looks in Chromium at its report, its plan and its page, in
windows of 1500, 1000 and 390 pixels and as printed on A4, and at the texts of every picture; of
scan, crawl and tow also at the page of the run itself: before it moves, amid it and after its end.
Each fault is named on stderr. ``--quick`` leaves out what takes longest: crawl, tow and weld.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from _boxes import faults_of_buttons, faults_of_page, watched_figures
from _browser import open_file, started_browser, why_no_browser
from _crawls import SHORT_CRAWL
from _live_browser import COMMAND, OpenedPage, ServedPage, opened_page, served_page
from _table import Row, main

from tjscan.report.plan_page import PLAN_FILE, write_plan_page
from tjscan.report.write import write_run_report

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, ViewportSize

EXAMPLES: Final = Path(__file__).parents[1] / "examples"

WIDTHS: Final = (1500, 1000, 390)
"""Pixels of the windows."""

PHONE: Final[ViewportSize] = {"width": 390, "height": 780}

Words = tuple[str | Path, ...]

RUNS: Final[dict[str, Words]] = {
    "scan": ("scan", EXAMPLES / "paper.toml"),
    "continuous": (
        *("scan", EXAMPLES / "paper.toml", "--scan.mode", "continuous"),
        *("--scan.length-mm", "120"),
    ),
    "calibrate": ("calibrate", EXAMPLES / "calibrate.toml", "--unattended"),
    "whole": ("scan", EXAMPLES / "whole-joint.toml"),
}
"""A run of each kind, and the command that makes it."""

LONG_RUNS: Final[dict[str, Words]] = {
    "crawl": ("crawl", "run", Path("crawl.toml")),
    "tow": (
        *("tow", "run", EXAMPLES / "tow-simulation.toml"),
        *("--seam.points-mm", "[[2600, -4800], [2600, -4700]]"),
    ),
    "weld": ("weld", EXAMPLES / "weld.toml"),
}
"""The same of what takes longer."""

LIVE_RUNS: Final[dict[str, tuple[Words, str]]] = {
    "scan": (("scan", EXAMPLES / "paper.toml", "--wait"), "doing.*section"),
    "crawl": (("crawl", "run", Path("longer-crawl.toml"), "--wait"), "weld|return"),
    "tow": (LONG_RUNS["tow"], "welding|waits"),
}
"""Commands that show a run while it goes on, and what its state is then, a regular expression."""

PAGES_OF_A_RUN: Final = ("scan", "calibrate", *LONG_RUNS)
"""Runs that are shown again on the live page."""


PLAN_HAS_FINDINGS: Final = 3
"""Exit code of a plan that is written, and has something to say."""


def measure(runs: dict[str, Words]) -> Iterator[Row]:
    """All rows; none without a browser."""
    if why_no_browser():
        print(f"no browser: {why_no_browser()}", file=sys.stderr)
        return
    with TemporaryDirectory() as name, started_browser() as browser:
        folder = Path(name)
        (folder / "crawl.toml").write_text(SHORT_CRAWL, encoding="utf-8")
        longer = SHORT_CRAWL.replace("length_m = 0.03", "length_m = 0.1")
        (folder / "longer-crawl.toml").write_text(longer, encoding="utf-8")
        for run, words in runs.items():
            call(folder, *words, "--out", run)
        call(folder, "plan", "scan", "--wps", EXAMPLES / "wps.toml", "--gravity", "0", "0", "-1")
        for run in runs:
            yield counted(f"faults of the report of {run}", report_faults(browser, folder / run))
        for run in runs:
            if run in PAGES_OF_A_RUN:
                faults = view_faults(browser, folder / run)
                yield counted(f"faults of the page that shows {run} again", faults)
        for run in LIVE_RUNS:
            if run in runs:
                yield counted(f"faults of the page of a {run}", live_faults(browser, folder, run))


def call(folder: Path, *words: object) -> None:
    """Run a command in a folder."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    options = {"cwd": folder, "env": environment, "capture_output": True, "text": True}
    done = subprocess.run([*COMMAND, *map(str, words)], check=False, **options)  # type: ignore[call-overload]
    if done.returncode not in (0, PLAN_HAS_FINDINGS):
        raise RuntimeError(f"{' '.join(map(str, words))}: {done.stderr[-2000:]}")


def counted(name: str, faults: Iterable[str]) -> Row:
    """A row of the number of faults, which are named on stderr."""
    found = list(dict.fromkeys(faults))
    for fault in found:
        print(f"    {name}: {fault}", file=sys.stderr)
    return Row(name, len(found), 0)


def report_faults(browser: Browser, run: Path) -> Iterator[str]:
    """Faults of what a run's directory has to show, written again with its pictures watched."""
    with watched_figures() as pictures:
        files = [write_run_report(run).name]
        if (run / PLAN_FILE).is_file():
            files.append(write_plan_page(run).name)
    yield from (fault for faults in pictures.values() for fault in faults)
    for name in files:
        for width in WIDTHS:
            watched = open_file(browser, run / name, width=width)
            yield from (f"{name}, {width}: {one}" for one in faults_of_page(watched.page))
            yield from (f"{name}, {width}: asks for {one}" for one in watched.requests)
            yield from (f"{name}, {width}: console: {one}" for one in watched.faults)
            if width == WIDTHS[0]:
                printed = faults_of_page(watched.page, paper=True)
                yield from (f"{name} on A4: {one}" for one in printed)
            watched.page.close()


def view_faults(browser: Browser, directory: Path) -> Iterator[str]:
    """Faults of the page that shows a run again."""
    with (
        served_page("view", directory) as served,
        opened_page(browser, served.url, PHONE) as shown,
    ):
        yield from faults_in_all_widths(shown)
        yield from (f"script: {one}" for one in shown.faults)


def live_faults(browser: Browser, folder: Path, run: str) -> Iterator[str]:
    """Faults of the page of a run: before it moves, amid it, and after its end."""
    command, moving = LIVE_RUNS[run]
    own = (folder / word if isinstance(word, Path) else word for word in command)
    words = (*own, "--live", "--out", folder / f"live {run}")
    with served_page(*words) as served, opened_page(browser, served.url, PHONE) as shown:
        with held_still(served):
            yield from (f"before: {one}" for one in faults_in_all_widths(shown))
        if "--wait" in words:
            shown.press("Start")
        while served.process.poll() is None and not re.search(moving, shown.state):
            shown.page.wait_for_timeout(100)
        with held_still(served):
            if not re.search(moving, shown.state):
                yield f"was over before it was looked at: {shown.state!r}"
            yield from (f"amid: {one}" for one in faults_in_all_widths(shown))
        if served.end() != 0:
            yield f"the command failed: {''.join(served.lines)}"
        shown.page.wait_for_timeout(2000)
        yield from (f"after the end: {one}" for one in faults_in_all_widths(shown))
        yield from after_the_end(shown.page)
        yield from (f"script: {one}" for one in shown.faults)


@contextmanager
def held_still(served: ServedPage) -> Iterator[None]:
    """Hold a command still, so that its page stays as it is while it is measured."""
    served.process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        served.process.send_signal(signal.SIGCONT)


def faults_in_all_widths(shown: OpenedPage) -> Iterator[str]:
    """Faults of a page as it is now, the smallest window first; there every button is tried."""
    for width in WIDTHS[::-1]:
        shown.page.set_viewport_size({"width": width, "height": PHONE["height"]})
        shown.page.wait_for_timeout(500)
        if width == PHONE["width"]:
            yield from (f"{width}: {one}" for one in faults_of_buttons(shown.page))
        yield from (f"{width}: {one}" for one in faults_of_page(shown.page))


def after_the_end(page: Page) -> Iterator[str]:
    """What a page still offers once its run is over."""
    for word in ("Start", "Pause", "Step", "Stop"):
        button = page.get_by_role("button", name=word, exact=True)
        if button.count() and button.is_enabled():
            yield f"after the end: {word} can be pressed"
    state = page.locator(".tj.state").first.inner_text()
    if not state.split("state", 1)[-1].strip().startswith("ended"):
        yield f"after the end: the state is {state!r}"


if __name__ == "__main__":
    QUICK = "--quick" in sys.argv
    ARGUMENTS = [word for word in sys.argv[1:] if word != "--quick"]
    CHOSEN = RUNS if QUICK else {**RUNS, **LONG_RUNS}
    sys.exit(main("boxes of pages and reports", lambda: measure(CHOSEN), ARGUMENTS))
