"""Buttons of the page: those that are pressed, and those that are held."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

HELD_BUTTON_RATE: Final = 20.0
"""Hz at which a button that is held repeats it."""

Act = Callable[[], object]
"""What a button does."""

Tone = Literal["green", "yellow", "blue", "red", "gray"]


@dataclass(frozen=True, slots=True)
class Button:
    """A button of the page.

    Parameters
    ----------
    word : str
        On it.
    press : callable
        What it does; called in a thread of the page. Of a button that is held it is called
        `HELD_BUTTON_RATE` times a second until the button is released, or the browser or its
        link is gone.
    tone : str
        Its colour.
    hint : str
        What it does, in a sentence.
    big : bool
        Whether it must be seen at once.
    held : bool
        Whether it acts as long as it is held.
    """

    word: str
    press: Act
    tone: Tone = "blue"
    hint: str = ""
    big: bool = False
    held: bool = False


def stop_button(interrupt: Act, what: str) -> Sequence[Button]:
    """The button of all vehicles.

    Parameters
    ----------
    interrupt : callable
        Does what Ctrl-C does.
    what : str
        Is stopped.
    """
    return [Button("STOP", interrupt, "red", f"As Ctrl-C: stop {what} at once", big=True)]
