"""Buttons of the page, pressed as soon as they are there."""

from concurrent.futures import Future, ThreadPoolExecutor
from math import tan
from typing import Any

import pytest
from _live_client import page_client

from tjscan.live.listening import show_run
from tjscan.live.page import FIELD_OF_VIEW, Button, Page, PageAddress
from tjscan.live.step import SceneSetup, Step
from tjscan.recording.journal import RunEvent
from tjscan.runs.live.scan import scan_buttons
from tjscan.scanning.stopping import StopRequest

FIELD_OF_VIEW_MESSAGE = "SetCameraFovMessage"


def test_a_button_pressed_while_others_are_added_finds_them_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    words = ("one", "two", "three")
    pressed: list[Future[None]] = []
    with (
        Page([SceneSetup("nothing")], PageAddress(port=0)) as page,
        ThreadPoolExecutor() as browser,
    ):
        add = page.server.gui.add_button

        def add_and_press(word: str, **how: Any) -> Any:
            handle = add(word, **how)
            pressed.append(browser.submit(page.enable_buttons, dict.fromkeys(words, False)))
            return handle

        monkeypatch.setattr(page.server.gui, "add_button", add_and_press)
        page.add_buttons([Button(word, lambda: None) for word in words])
        for one in pressed:
            one.result()
    assert len(pressed) == len(words)


class NothingShown:
    """A show of a run that only has events."""

    setting = SceneSetup("nothing")

    def step_of_entry(self, entry: object) -> Step:
        assert isinstance(entry, RunEvent)
        return Step(events=((entry.name, entry.detail),))


@pytest.mark.parametrize("width", [390, 1500])
def test_a_window_of_any_shape_sees_as_far_to_the_sides(width: int) -> None:
    height = 780
    with (
        Page([SceneSetup("nothing")], PageAddress(port=0)) as page,
        page_client(page) as browser,
    ):
        browser.look(image_width=width, image_height=height, fov=1.0)
        views: list[Any] = []
        while len(views) < 2:  # the one of all windows, and this one's
            browser.receive()
            views = [one["fov"] for one in browser.messages if one["type"] == FIELD_OF_VIEW_MESSAGE]
        half = tan(0.5 * views[-1])
        assert min(half, half * width / height) == pytest.approx(tan(0.5 * FIELD_OF_VIEW))


def test_after_its_end_a_run_shows_how_it_ended_and_no_button_answers() -> None:
    stop = StopRequest()
    with show_run(
        NothingShown(),
        PageAddress(port=0),
        lambda _: None,
        lambda run: scan_buttons(run, stop, lambda: None),
    ) as run:
        page = run.page
        assert page is not None
        run.show_state("pausing after the section under way")
        run.record(RunEvent("stop", "length reached"))
    assert all(handle.disabled for handle in page._buttons.values())
    shown = page.views[0].panel.state.content
    assert "ended: stop, length reached" in shown
    assert "pausing" not in shown
