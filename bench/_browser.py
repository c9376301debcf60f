"""A headless Chromium, drawing in software, as benches and tests drive it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from PIL import Image

from tjscan.core.frames import Array

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserType, Page

CHROMIUM: Final = Path("/usr/bin/chromium")
"""Debian's."""

SOFTWARE_GL: Final = (
    "--no-sandbox",  # whoever runs the tests may be root
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)

SHADE: Final = 8.0
"""Of 255: a translucent face that turns changes by less."""

SETTLED: Final = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
"""Waits until what was asked for is drawn."""


def why_no_browser() -> str:
    """Why no browser can be driven here; empty where one can."""
    if find_spec("playwright") is None:
        return "playwright is not installed: pip install -e '.[browser]'"
    return "" if CHROMIUM.is_file() else f"there is no {CHROMIUM}: apt-get install chromium"


@contextmanager
def started_browser() -> Iterator[Browser]:
    """Start Chromium, and close it in the end."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver, launched(driver.chromium) as browser:
        yield browser


@contextmanager
def launched(kind: BrowserType) -> Iterator[Browser]:
    """Start one more process of a browser that runs; close it in the end."""
    browser = kind.launch(executable_path=str(CHROMIUM), args=[*SOFTWARE_GL])
    try:
        yield browser
    finally:
        browser.close()


@dataclass
class WatchedPage:
    """A page from disk, with all that it asked for and all that went wrong on it.

    Parameters
    ----------
    page : Page
        Open.
    requests, faults : list of str
        Addresses asked for beside the page itself and data within it; errors and warnings.
    """

    page: Page
    requests: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def picture(self, selector: str) -> Array:
        """Pixels of an element, once all is drawn; its rim, which a scroll moves, is left out."""
        self.page.evaluate(SETTLED)
        png = self.page.locator(selector).first.screenshot()
        return np.asarray(Image.open(BytesIO(png)).convert("RGB"), dtype=float)[2:-2, 2:-2]

    def drag(self, selector: str, dx: float, dy: float) -> None:
        """Drag from the middle of an element, in pixels."""
        self.page.locator(selector).first.scroll_into_view_if_needed()
        box = self.page.locator(selector).first.bounding_box()
        if box is None:
            raise ValueError(f"{selector} is not shown")
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        mouse = self.page.mouse
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + dx, y + dy, steps=3)
        mouse.up()
        mouse.move(1, 1)


def open_file(
    browser: Browser,
    file: Path,
    *,
    width: int = 1000,
    colours: Literal["light", "dark"] = "light",
    without_webgl: bool = False,
) -> WatchedPage:
    """Open a file in a window of so many pixels, and note all that it asks for."""
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=colours)
    if without_webgl:
        page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    watched = WatchedPage(page)
    own = file.resolve().as_uri()

    def note_request(address: str) -> None:
        if address != own and not address.startswith("data:"):
            watched.requests.append(address)

    page.on("request", lambda request: note_request(request.url))
    page.on("pageerror", lambda error: watched.faults.append(str(error)))
    page.on(
        "console",
        lambda said: (
            watched.faults.append(said.text) if said.type in ("error", "warning") else None
        ),
    )
    page.goto(own)
    page.evaluate(SETTLED)
    return watched


def changed_share(one: Array, other: Array) -> float:
    """Share of the pixels of two pictures that differ by more than a shade."""
    return float((np.abs(one - other).max(axis=2) > SHADE).mean())


def printed_pages(page: Page) -> int:
    """Sheets of A4 that a page prints to."""
    return page.pdf(prefer_css_page_size=True, print_background=True).count(b"/Type /Page\n")
