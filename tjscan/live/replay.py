"""A recording on the page, with a slider."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from threading import Lock

from tjscan.live.drawables import ArmPosture, Drawable
from tjscan.live.page import Page, PageAddress
from tjscan.live.step import RecordedShow, Step, merge_steps


class Replay:
    """Recordings on a page, each as far as one slider shows.

    Parameters
    ----------
    shows : sequence of RecordedShow
        Side by side. They begin together; the slider goes as far as the longest.
    where : PageAddress, optional

    Raises
    ------
    PageUnavailable
        If the page can't be served.
    """

    def __init__(self, shows: Sequence[RecordedShow], where: PageAddress | None = None) -> None:
        self._shows, self._moving = shows, Lock()
        self.page = Page([show.setting for show in shows], where)
        last = max(len(show.steps) for show in shows) - 1
        # Every piece that was ever drawn of each run, hidden or not.
        self._drawn: list[dict[str, Drawable]] = [{} for _ in shows]
        gui = self.page.server.gui
        self._slider = gui.add_slider("Step", 0, max(last, 1), 1, last, order=0)
        self._shown = -1
        self._slider.on_update(lambda _: self.move_to())
        self.move_to(last)

    def move_to(self, number: int | None = None) -> None:
        """Show all runs as they were after a step, by its number; by default the slider's.

        A drag of the slider sends more places than can be shown.
        """
        with self._moving:
            number = self._slider.value if number is None else number
            if number == self._shown:
                return
            self._shown = number
            with self.page.server.atomic():
                for k, show in enumerate(self._shows):
                    self._move_run(k, show, min(number, len(show.steps) - 1))
                self.page.recolour()

    def _move_run(self, k: int, show: RecordedShow, number: int) -> None:
        """Draw what differs: all that came until then counts, and what came later is hidden."""
        view, drawn = self.page.views[k], self._drawn[k]
        whole = merge_steps([Step(), *show.steps[: number + 1]])
        changed = {
            name: thing
            for name, thing in whole.drawn.items()
            if drawn.get(name) is not thing or isinstance(thing, ArmPosture)
        }
        view.panel.forget()
        facts = {"step": f"{number + 1} of {len(show.steps)}: {whole.label}", **whole.facts}
        self.page.show(replace(whole, drawn=changed, facts=facts), k)
        drawn.update(changed)
        view.stage.show_only(whole.drawn)
