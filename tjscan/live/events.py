"""An event, as a journal receives it and the page lists it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NotedEvent:
    """An event on its way to the page.

    Parameters
    ----------
    name, detail : str
        What, in a word and in a sentence.
    """

    name: str
    detail: str
