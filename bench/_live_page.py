"""The live page: what it costs a scan, what it sends and to whom, and what clicks do."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue
from resource import RUSAGE_CHILDREN, getrusage
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

import numpy as np
from _browser import launched, started_browser, why_no_browser
from _live_browser import (
    COMMAND,
    STRIP,
    kill_browser,
    opened_page,
    press_through_calibration,
    served_page,
    share_like,
)
from _live_client import page_client
from _live_hand import hand_rows
from _table import Row

from tjscan.core.frames import Array
from tjscan.crawler.journal import read_crawl
from tjscan.crawler.phases import Phase
from tjscan.live.access import LOOPBACK_ADDRESS
from tjscan.live.colours import ARM_COLOUR, viridis_colours
from tjscan.live.page import Button, Page, PageAddress
from tjscan.live.step import SceneSetup
from tjscan.recording.journal import RunEvent
from tjscan.runs.tasks import read_recorded_show
from tjscan.scanning.recording import read_recorded_scan

if TYPE_CHECKING:
    from playwright.sync_api import Browser

EXAMPLES: Final = Path(__file__).parents[1] / "examples"
SCAN: Final = EXAMPLES / "paper.toml"
CRAWL: Final = EXAMPLES / "crawl.toml"
CALIBRATION: Final = EXAMPLES / "calibrate.toml"
RUNS: Final = 3
"""Scans with and without the page, by turns; the quickest of each counts."""
CLICKS: Final = 10
MANY_POINTS: Final = Path(__file__).with_name("_live_many_points.py")


def live_rows() -> Iterator[Row]:
    """All rows of the live page."""
    if why_no_browser():
        print(f"no browser: {why_no_browser()}", file=sys.stderr)
        return
    with tempfile.TemporaryDirectory() as name, started_browser() as browser:
        folder = Path(name)
        yield from cost_rows(browser, folder)
        yield from traffic_rows(folder / "alone-0")
        yield from click_rows(browser)
        yield from scan_rows(browser, folder)
        yield calibration_row(browser, folder)
        yield from stop_rows(browser, folder)
        yield from hand_rows(browser, folder)
        yield from memory_rows(browser)


def cost_rows(browser: Browser, folder: Path) -> Iterator[Row]:
    """Time of a scan with the page and without, and whether its sections are the same."""
    alone, shown, watched = [], [], []
    for k in range(RUNS):
        alone.append(_scan_time(folder / f"alone-{k}"))
        shown.append(_scan_time(folder / f"shown-{k}", "--live"))
        watched.append(_scan_time(folder / f"watched-{k}", "--live", "--wait", browser=browser))
    points = [_recorded(folder / f"{name}-0") for name in ("alone", "shown", "watched")]
    off = [float(np.abs(one - points[0]).max()) for one in points[1:]]
    yield Row("sections with the page against without, largest difference", max(off), 0, "m")
    share = 100 / min(alone)
    yield Row("processor time of make scan, page and no browser", share * min(shown) - 100, 5, "%")
    yield Row("… page and one browser", share * min(watched) - 100, 15, "%")


def _scan_time(out: Path, *options: str, browser: Browser | None = None) -> float:
    """Seconds of a processor that a scan took; those of the browser are not among them."""
    before = getrusage(RUSAGE_CHILDREN)
    words = ("scan", SCAN, "--out", out, *options)
    if not options:
        subprocess.run([*COMMAND, *map(str, words)], check=True, stderr=subprocess.DEVNULL)
    else:
        with served_page(*words) as served, ExitStack() as stack:
            if browser is not None:
                shown = stack.enter_context(opened_page(browser, served.url, STRIP))
                shown.press("Start")
            if served.end() != 0:
                raise RuntimeError("".join(served.lines))
    after = getrusage(RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _recorded(run: Path) -> Array:
    scan = read_recorded_scan(run)
    return np.array([scan.sections[i].points_b for i in sorted(scan.sections)])


def traffic_rows(run: Path) -> Iterator[Row]:
    """What a recording's steps send to a browser, and how long the server takes for each."""
    show = read_recorded_show(run)
    sizes, seconds = [], []
    gc.freeze()  # else a collection of all that the bench has loaded falls on one of the steps
    page = Page([show.setting], PageAddress(port=0))
    with page, page_client(page) as client:
        client.receive()
        for step in show.steps:
            begun = time.thread_time()
            page.show_step(step)
            seconds.append(time.thread_time() - begun)
            sizes.append(client.receive())
        bound = _bound_addresses(page.server.get_port())
    sections = [size for size, step in zip(sizes, show.steps, strict=True) if step.samples]
    views = [
        size
        for size, step in zip(sizes, show.steps, strict=True)
        if "laser" in step.drawn and not step.samples
    ]
    yield Row("bytes of a section, with the views that led to it", sum(sizes) / len(sections), 2e4)
    yield Row("… the largest of a section alone", max(sections), 2e4)
    yield Row("views at 20 Hz", 20e-3 * max(views), 400, "kB/s")
    yield Row(
        "server's time for a step, 99th percentile", 1e3 * np.percentile(seconds, 99), 30, "ms"
    )
    yield Row("addresses bound but 127.0.0.1", len(bound - {LOOPBACK_ADDRESS}), 0)
    yield Row("… 127.0.0.1", len(bound & {LOOPBACK_ADDRESS}), 1, at_least=1)


def _bound_addresses(port: int) -> set[str]:
    """Addresses on which this machine listens at a port, from the kernel's tables."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text(encoding="ascii").splitlines()[1:]:
            address, _, number = line.split()[1].partition(":")
            if int(number, 16) == port and line.split()[3] == "0A":  # it listens
                parts = [str(int(address[k : k + 2], 16)) for k in range(6, -2, -2)]
                found.add(".".join(parts) if len(address) == 8 else address)
    return found


def click_rows(browser: Browser) -> Iterator[Row]:
    """How long a click takes to become an order."""
    pressed: SimpleQueue[float] = SimpleQueue()
    button = Button("Order", lambda: pressed.put(time.perf_counter()))
    taken = []
    with (
        Page([SceneSetup("clicks")], PageAddress(port=0)) as page,
        opened_page(browser, page.url) as shown,
    ):
        page.add_buttons([button])
        for _ in range(CLICKS):
            begun = time.perf_counter()
            shown.press("Order")
            taken.append(pressed.get(timeout=60) - begun)
    yield Row(f"click to order taken, median of {CLICKS}", float(np.median(taken)), 0.5, "s")


def scan_rows(browser: Browser, folder: Path) -> Iterator[Row]:
    """A scan by clicks in two browsers, one of which is killed in its middle; then opened again."""
    run, begun, wrong = folder / "clicked", time.perf_counter(), 0
    words = ("scan", SCAN, "--out", run, "--live", "--wait")
    with served_page(*words) as served:
        with (
            opened_page(browser, served.url) as one,
            launched(browser.browser_type) as doomed,
            opened_page(doomed, served.url, STRIP) as other,
        ):
            other.press("Step")
            for page in (one, other):
                page.wait_for("paused: after section 2")
            picture = one.picture()
            other.press("Step")
            other.wait_for("scanning one section|after section 3")
            kill_browser(doomed)
            one.wait_for("paused: after section 3")
            state, requests, faults = one.state, list(one.requests), one.faults
        with opened_page(browser, served.url, STRIP) as again:
            again.wait_for("paused: after section 3")
            wrong += again.state != state
            again.press("Start")
            code = served.end()
            requests += again.requests
    seconds = time.perf_counter() - begun
    apart = float(np.abs(_recorded(run) - _recorded(folder / "alone-0")).max())
    own = urlsplit(served.url).netloc
    foreign = [one for one in requests if urlsplit(one).netloc not in (own, "")]
    coloured = sum(share_like(picture, colour) for colour in viridis_colours()[120:256:45])
    yield Row("a scan by clicks in two browsers, one killed, opened again", seconds, 60, "s")
    yield Row("… its exit code", code, 0)
    yield Row("… largest difference of its sections", apart, 0, "m")
    yield Row("… pages opened again that show another state", wrong, 0)
    yield Row("… errors of the page's scripts", len(faults), 0)
    yield Row("… requests to anywhere else", len(foreign), 0)
    yield Row(
        "… share of the picture that is the arm", 100 * share_like(picture, ARM_COLOUR), 100, "%", 2
    )
    yield Row("… that is the groove", 100 * coloured, 100, "%", 0.05)


def calibration_row(browser: Browser, folder: Path) -> Row:
    """A whole calibration by clicks."""
    begun = time.perf_counter()
    short = ("--board.touches", 4, "--board.lines", 5)
    words = ("calibrate", CALIBRATION, "--out", folder / "calibration", *short, "--live")
    with served_page(*words) as served, opened_page(browser, served.url, STRIP) as shown:
        press_through_calibration(shown)
        code = served.end()
    seconds = time.perf_counter() - begun
    return Row("a whole calibration by clicks", seconds if code == 0 else np.nan, 60, "s")


def stop_rows(browser: Browser, folder: Path) -> Iterator[Row]:
    """The crawler, stopped by a click while it drives."""
    run, begun = folder / "crawl", time.perf_counter()
    words = ("crawl", "run", CRAWL, "--out", run, "--weld.length-m", 2, "--live")
    with served_page(*words) as served, opened_page(browser, served.url) as shown:
        shown.wait_for("alignment|welding")
        shown.press("STOP")
        code = served.end()
    seconds = time.perf_counter() - begun
    names = [one.name for one in read_crawl(run) if isinstance(one, RunEvent)]
    yield Row("the crawler stopped by a click", seconds, 60, "s")
    yield Row("… its exit code, as by Ctrl-C", code, 130, at_least=130)
    yield Row("… its last event is the stop", names[-1] == Phase.STOP, 1, at_least=1)


def memory_rows(browser: Browser) -> Iterator[Row]:
    """Memory of server and browser with 10⁵ points."""
    command: Sequence[str] = (sys.executable, str(MANY_POINTS))
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        if process.stdout is None or process.stdin is None:
            raise RuntimeError("no pipes")
        served = json.loads(process.stdout.readline())
        with opened_page(browser, served["url"]) as shown:
            shown.wait_for("100000")
            heap = shown.page.evaluate("performance.memory.usedJSHeapSize")
            process.stdin.write("\n")
            process.stdin.flush()
            resident = json.loads(process.stdout.readline())["resident"]
    yield Row("10⁵ points, memory of the server's process", resident / 1e6, 250, "MB")
    yield Row("… of the browser's scripts", heap / 1e6, 100, "MB")
