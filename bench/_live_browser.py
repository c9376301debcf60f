"""The live page in a browser, with the command that serves it, as its bench and tests drive it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from threading import Thread
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image

from tjscan.core.frames import Array

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, ViewportSize

COMMAND: Final = (sys.executable, "-c", "from tjscan.cli import main; main()")
WINDOW: Final[ViewportSize] = {"width": 800, "height": 450}
"""Pixels; a larger one takes a browser without a graphics card too long to draw."""
STRIP: Final[ViewportSize] = {"width": 700, "height": 120}
"""A window that hardly takes time to draw; what is pressed in it is scrolled to."""
PATIENCE: Final = 45_000
"""Milliseconds for what a page on a busy machine takes: WebGL without a graphics card starts in
some ten seconds."""

CURVE_IS_DRAWN: Final = """
([colour, least]) => {
    const path = document.querySelector(`.tj.chart path[stroke="${colour}"]`);
    return path && path.getAttribute("d").split("M").length > least;
}
"""
"""Whether the first chart has a curve of as many dots in a colour."""


class ServedPage:
    """A command that serves a page, and what it writes.

    Parameters
    ----------
    process : subprocess.Popen
        Whose stderr nobody else reads.
    """

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process, self.lines = process, list[str]()
        self.url = self._read_url()
        self._reader = Thread(target=self._read_on, daemon=True)
        self._reader.start()

    def end(self, timeout: float = 600.0) -> int:
        """Wait for the command's end; gives its exit code."""
        code = self.process.wait(timeout)
        self._reader.join(timeout)
        return code

    def _read_url(self) -> str:
        if self.process.stderr is not None:
            for line in self.process.stderr:
                self.lines.append(line)
                if found := re.search(r"http://\S+/", line):
                    return found[0]
        raise RuntimeError(f"no page was served: {''.join(self.lines)}")

    def _read_on(self) -> None:
        if self.process.stderr is not None:
            self.lines.extend(self.process.stderr)


@contextmanager
def served_page(*arguments: object) -> Iterator[ServedPage]:
    """Start a command that serves a page on a free port; it is killed in the end."""
    words = [*COMMAND, *map(str, arguments), "--port", "0"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True, bufsize=1) as process:
        try:
            yield ServedPage(process)
        finally:
            process.kill()


class OpenedPage:
    """The page in a browser.

    Parameters
    ----------
    page : Page
        Open, with its first button drawn.
    requests : list of str
        Addresses that were asked for.
    faults : list of str
        Errors of its scripts.
    """

    def __init__(self, page: Page, requests: list[str], faults: list[str]) -> None:
        self.page, self.requests, self.faults = page, requests, faults

    def press(self, word: str) -> None:
        """Press a button."""
        self.page.get_by_role("button", name=word, exact=True).click(timeout=PATIENCE)

    def wait_for(self, words: str) -> None:
        """Wait until the page's state shows some words, as a regular expression."""
        shown = self.page.locator(".tj.state").first
        shown.filter(has_text=re.compile(words, re.DOTALL)).wait_for(timeout=PATIENCE)

    def hold(self, word: str, until: str) -> None:
        """Press a button and hold it until the page's state shows some words; it is held still."""
        self.page.get_by_role("button", name=word, exact=True).hover(timeout=PATIENCE)
        self.page.mouse.down()
        self.wait_for(until)

    def wait_for_another(self, state: str) -> None:
        """Wait until the page's state is not this one any more."""
        changed = "before => document.querySelector('.tj.state').innerText != before"
        self.page.wait_for_function(changed, arg=state, timeout=PATIENCE)

    @property
    def state(self) -> str:
        """What the page says of the state."""
        return self.page.locator(".tj.state").first.inner_text()

    def picture(self) -> Array:
        """Pixels of the window, shape (n, m, 3)."""
        return _pixels(self.page.screenshot(timeout=2 * PATIENCE))

    def wait_for_curve(self, colour: str, least: int) -> None:
        """Wait until the first chart has a curve of as many dots in a colour."""
        self.page.wait_for_function(CURVE_IS_DRAWN, arg=[colour, least], timeout=PATIENCE)


def _pixels(png: bytes) -> Array:
    return np.asarray(Image.open(BytesIO(png)).convert("RGB"), dtype=float)


@contextmanager
def opened_page(browser: Browser, url: str, window: ViewportSize = WINDOW) -> Iterator[OpenedPage]:
    """Open the page in a window of a browser, and close it in the end.

    Parameters
    ----------
    browser : Browser
    url : str
    window : dict, optional
        Its size in pixels; `STRIP` where nobody looks at the picture.
    """
    from playwright.sync_api import Error as PlaywrightError

    context = browser.new_context(viewport=window)
    page, requests, faults = context.new_page(), list[str](), list[str]()
    page.on("request", lambda request: requests.append(request.url))
    page.on("websocket", lambda socket: requests.append(socket.url))
    page.on("pageerror", lambda error: faults.append(str(error)))
    try:
        page.goto(url, timeout=PATIENCE)
        page.locator(".tj.state").first.wait_for(timeout=PATIENCE)
        yield OpenedPage(page, requests, faults)
    finally:
        with suppress(PlaywrightError):  # of a browser that was killed there is nothing to close
            context.close()


def press_through_calibration(shown: OpenedPage) -> None:
    """Take all that is asked for; finish when enough lines are there, and save."""
    while True:
        shown.wait_for("press(Take|Redo|Finish) or")
        state = shown.state
        shown.press("Finish" if "Take one more" in state or "Save it" in state else "Take")
        if "Save it" in state:
            return
        shown.wait_for_another(state)


def kill_browser(browser: Browser) -> float:
    """Let a browser's process die amid what it does; gives when, in `time.monotonic`."""
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    (pid,) = (one["id"] for one in processes if one["type"] == "browser")
    with browser.contexts[-1].pages[-1].expect_event("close", timeout=PATIENCE):
        killed = time.monotonic()
        os.kill(pid, signal.SIGKILL)
    return killed


def share_like(picture: Array, colour: tuple[int, int, int], hue_tolerance: float = 0.06) -> float:
    """Share of a picture's pixels that have the hue of a colour, in whatever light.

    Parameters
    ----------
    picture : ndarray, shape (n, m, 3)
    colour : tuple of int
        Not grey.
    hue_tolerance : float
        Of the direction of the colour without its grey, radians / π.
    """
    chroma = picture - picture.mean(axis=2, keepdims=True)
    wanted = np.array(colour) - np.mean(colour)
    size = np.linalg.norm(chroma, axis=2)
    cosine = (chroma @ wanted) / np.maximum(size * np.linalg.norm(wanted), 1e-9)
    return float(((cosine > np.cos(np.pi * hue_tolerance)) & (size > 20)).mean())
