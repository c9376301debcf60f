"""A crawler driven by hand from its page, and the browser lost: how long until it stands."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from _browser import launched
from _live_browser import STRIP, kill_browser, opened_page, served_page
from _table import Row

from tjscan.vehicle.vehicle import DEAD_MAN_TIME
from tjscan_loopback.broker import MosquittoProcess, find_mosquitto
from tjscan_loopback.process import VehicleLoopbackProcess

if TYPE_CHECKING:
    from playwright.sync_api import Browser

TIMES: Final = 5
JOB: Final = """
[vehicle]
id = "crawler-1"
driver = "mqtt"
[torch]
driver = "mqtt"
[vehicle.mqtt]
port = {port}
[[pass]]
speed_mm_s = 8
[simulation.vehicle]
start_mm = [-400.0, 5.0]
"""


def hand_rows(browser: Browser, folder: Path) -> Iterator[Row]:
    """A vehicle behind a broker, driven by a held button; each time the browser is killed."""
    if find_mosquitto() is None:
        print("no vehicle to drive by hand: mosquitto is not installed", file=sys.stderr)
        return
    file, longest = folder / "by-hand.toml", 0.0
    with MosquittoProcess() as broker:
        file.write_text(JOB.format(port=broker.port), encoding="utf-8")
        words = ("crawl", "run", file, "--out", folder / "by-hand", "--live", "--wait")
        with (
            VehicleLoopbackProcess(broker.address, "--settings", str(file)) as vehicle,
            served_page(*words) as served,
        ):
            for _ in range(TIMES):
                longest = max(longest, _rolls_on(browser, served.url, vehicle))
    name = f"the crawler held to drive, its browser killed {TIMES} times: longest until it stands"
    yield Row(name, longest, DEAD_MAN_TIME, "s")


def _rolls_on(browser: Browser, url: str, vehicle: VehicleLoopbackProcess) -> float:
    """Seconds for which the vehicle goes on once its browser is dead."""
    with (
        launched(browser.browser_type) as doomed,
        opened_page(doomed, url, STRIP) as shown,
    ):
        shown.hold("Hold: forward", "speed1[5-9]|speed2")
        killed = kill_browser(doomed)
    return vehicle.wait_until_at_rest() - killed
