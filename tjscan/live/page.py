"""The page: a server, buttons, and for each run a picture and a panel; and a recording on it."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan, tan
from threading import Lock, RLock
from time import monotonic, sleep
from typing import Any, Final, Literal, Self

import numpy as np
import viser

from tjscan.core.frames import Array
from tjscan.live.access import LOOPBACK_ADDRESS, close_server, open_server
from tjscan.live.colours import ColourScale, viridis_colours
from tjscan.live.drawables import ArmPosture, Drawable, MeasuredPiece
from tjscan.live.panel import Panel
from tjscan.live.stage import Stage
from tjscan.live.step import (
    BUTTONS_FACT_NAME,
    STATE_FACT,
    Measure,
    RecordedShow,
    SceneSetup,
    Step,
    merge_steps,
)

FIELD_OF_VIEW: Final = 0.75
"""Radians, of the picture's height, or of its width where that is less."""
RUN_SPACING: Final = 1.6
"""Distance of runs side by side, as a multiple of the distance that they are seen from."""


END_SENDING_TIME: Final = 0.5
"""Seconds that browsers are left to be sent how a run ended, before the page is closed."""

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


def press_in_time(press: Act, clock: Callable[[], float] = monotonic) -> Act:
    """Press what a held button says, but not for each of many that come at once.

    They were held up on their way: by now the button may be released.
    """
    last = float("-inf")

    def act() -> None:
        nonlocal last
        since, last = clock() - last, clock()
        if since > 0.5 / HELD_BUTTON_RATE:
            press()

    return act


BUTTONS_ORDER: Final = -300.0
"""Of the first button: above all that grows, so that none moves away from who presses it."""
BIG_BUTTON_STYLE: Final = "height:4.5rem!important;font-size:1.8rem!important;font-weight:700"
"""Style of a button that must be seen at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageAddress:
    """Where the page is served.

    Parameters
    ----------
    port : int
        0 for any that is free.
    address : str
        Of this machine.
    """

    port: int = 8080
    address: str = LOOPBACK_ADDRESS


class RunView:
    """One run on the page: its picture and its panel."""

    def __init__(
        self, server: viser.ViserServer, setting: SceneSetup, root: str, shift: Array
    ) -> None:
        self.setting = setting
        self.stage = Stage(server, setting, root, shift)
        self.panel = Panel(server, setting)
        self._values: list[Mapping[str, float]] = []

    def show_step(self, step: Step, measure: Measure | None) -> None:
        """Show what a step changes; colours span all values of the measure that ever came."""
        pieces = (one for one in step.drawn.values() if isinstance(one, MeasuredPiece))
        self._values += [piece.values for piece in pieces]
        scale = self.colour_by(measure)
        self.stage.draw_things(step.drawn)
        self.panel.show_step(step, measure, scale)

    def colour_by(self, measure: Measure | None) -> ColourScale | None:
        """Colour the picture by a measure; gives the scale, which holds all its values so far.

        None if nothing is coloured.
        """
        if measure is None or not self._values:
            return None
        scale = ColourScale.spanning(one.get(measure.name, np.nan) for one in self._values)
        self.stage.colour_by(measure.name, scale)
        return scale


class Page:
    """A page that is served while it is entered.

    Parameters
    ----------
    settings : sequence of Setting
        Of the runs, side by side.
    where : PageAddress

    Raises
    ------
    PageUnavailable
        If it can't be served.
    """

    def __init__(self, settings: Sequence[SceneSetup], where: PageAddress | None = None) -> None:
        where, self.token = where or PageAddress(), secrets.token_urlsafe(18)
        viridis_colours()  # loads Matplotlib, which would hold up the first section
        self.server = open_server(where.address, where.port, self.token, "tjscan")
        host = f"[{where.address}]" if ":" in where.address else where.address
        self.url = f"http://{host}:{self.server.get_port()}/{self.token}/"
        self._buttons: dict[str, Any] = {}
        self._changing = RLock()
        self._measures = {one.title: one for setting in settings for one in setting.measures}
        self._measure = next(iter(self._measures.values()), None)
        try:
            with self.server.atomic():
                self._prepare_scene(settings)
                if len(self._measures) > 1:
                    choice = self.server.gui.add_dropdown("Colour and plot", list(self._measures))
                    choice.on_update(lambda _: self.choose_measure(choice.value))
                self.views = self._add_views(settings)
        except BaseException:
            close_server(self.server)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        close_server(self.server)

    def show_step(self, step: Step, run: int = 0) -> None:
        """Show what a step changes in one of the runs."""
        with self._changing, self.server.atomic():
            self.views[run].show_step(step, self._measure)

    def enable_buttons(self, words: Mapping[str, bool]) -> None:
        """Let buttons be pressed, or not, by their words."""
        with self._changing:
            for word, enabled in words.items():
                self._buttons[word].disabled = not enabled

    def withdraw_buttons(self, words: Sequence[str]) -> None:
        """Take buttons away, by their words: what is left moves up."""
        self.enable_buttons(dict.fromkeys(words, False))
        with self._changing, self.server.atomic():
            for word in words:
                self._buttons[word].visible = False

    def show_end(self, how: str) -> None:
        """Show that the run is over, and how; no button can be pressed any more."""
        self.enable_buttons(dict.fromkeys(self._buttons, False))
        facts = {STATE_FACT: f"ended{': ' * bool(how)}{how}", BUTTONS_FACT_NAME: ""}
        self.show_step(Step(facts=facts))
        self.server.flush()
        if self.server.get_clients():
            sleep(END_SENDING_TIME)

    def add_buttons(self, buttons: Sequence[Button]) -> None:
        """Add buttons; none that is pressed acts on the others before they are there."""
        with self._changing, self.server.atomic():
            for button in buttons:
                self._add_button(button)

    def _add_button(self, button: Button) -> None:
        gui, order = self.server.gui, BUTTONS_ORDER + len(self._buttons)
        handle = gui.add_button(button.word, color=button.tone, hint=button.hint, order=order)

        press = press_in_time(button.press) if button.held else button.press

        def act(_: object) -> None:
            press()

        if button.held:
            handle.on_hold(act, callback_hz=HELD_BUTTON_RATE)
        else:
            handle.on_click(act)
        if button.big:  # as tall as four others
            style = f"<style>[id='{handle._impl.uuid}']{{{BIG_BUTTON_STYLE}}}</style>"
            gui.add_html(style, order=BUTTONS_ORDER)
        self._buttons[button.word] = handle

    def choose_measure(self, title: str) -> None:
        """Colour and plot by a measure, by its title."""
        self._measure = self._measures[title]
        self.recolour()

    def recolour(self) -> None:
        """Colour and plot everything by the measure that is chosen."""
        if self._measure is None:
            return
        with self._changing, self.server.atomic():
            for view in self.views:
                view.panel.plot_measure(self._measure, view.colour_by(self._measure))

    def _prepare_scene(self, settings: Sequence[SceneSetup]) -> None:
        """Theme, lights that a machine without a graphics card can draw, and the camera."""
        server = self.server
        server.gui.configure_theme(
            control_width="large",
            show_logo=False,
            show_share_button=False,
            brand_color=(42, 111, 187),
        )
        server.gui.main_panel.dock_right()
        server.scene.configure_default_lights(cast_shadow=False)
        server.scene.configure_environment_map(hdri=None)
        server.scene.add_light_hemisphere(
            "/sky", sky_color=(255, 255, 255), ground_color=(150, 155, 165), intensity=2.0
        )
        first = settings[0]
        away = first.look_from - first.look_at
        look_at = first.look_at + _positions_side_by_side(settings).mean(axis=0)
        server.initial_camera.fov, server.initial_camera.look_at = FIELD_OF_VIEW, look_at
        server.initial_camera.position = look_at + away * (1 + 0.8 * (len(settings) - 1))
        server.on_client_connect(_see_whole_width)

    def _add_views(self, settings: Sequence[SceneSetup]) -> list[RunView]:
        shifts = _positions_side_by_side(settings)
        if len(settings) == 1:
            return [RunView(self.server, settings[0], "/run", shifts[0])]
        views, tabs = [], self.server.gui.add_tab_group()
        for k, setting in enumerate(settings):
            with tabs.add_tab(setting.title):
                views.append(RunView(self.server, setting, f"/run_{k}", shifts[k]))
            above = setting.look_at + np.array((0.0, 0.0, 0.6))
            self.server.scene.add_label(f"/run_{k}/title", setting.title, position=above)
        return views


def _see_whole_width(client: viser.ClientHandle) -> None:
    """Let a window that is higher than wide, a phone's, see as far to the sides as any."""

    def widen(camera: viser.CameraHandle) -> None:
        camera.fov = 2 * atan(tan(0.5 * FIELD_OF_VIEW) / min(camera.aspect, 1.0))

    client.camera.on_update(widen)  # windows change their shape
    widen(client.camera)


def _positions_side_by_side(settings: Sequence[SceneSetup]) -> Array:
    """Positions of runs side by side, square to the line of sight, shape (n, 3)."""
    away = settings[0].look_from - settings[0].look_at
    aside = np.cross((0.0, 0.0, 1.0), away)
    spacing = RUN_SPACING * float(np.linalg.norm(away))
    step = spacing * aside / max(float(np.linalg.norm(aside)), 1e-9)
    return np.outer(np.arange(len(settings)), 0.5 * step)


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
        self._slider.on_update(lambda _: self.move_to_step())
        self.move_to_step(last)

    def move_to_step(self, number: int | None = None) -> None:
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
                    self._move_run_to_step(k, show, min(number, len(show.steps) - 1))
                self.page.recolour()

    def _move_run_to_step(self, k: int, show: RecordedShow, number: int) -> None:
        """Draw what differs: all that came until then counts, and what came later is hidden."""
        view, drawn = self.page.views[k], self._drawn[k]
        whole = merge_steps([Step(), *show.steps[: number + 1]])
        changed = {
            name: thing
            for name, thing in whole.drawn.items()
            if drawn.get(name) is not thing or isinstance(thing, ArmPosture)
        }
        view.panel.forget_steps()
        facts = {"step": f"{number + 1} of {len(show.steps)}: {whole.label}", **whole.facts}
        self.page.show_step(replace(whole, drawn=changed, facts=facts), k)
        drawn.update(changed)
        view.stage.show_only(whole.drawn)
