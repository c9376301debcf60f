"""Buttons of the page, pressed as soon as they are there."""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest

from tjscan.live.page import Button, Page, PageAddress
from tjscan.live.step import SceneSetup


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
