"""The page: a server, and for each run shown a picture and a panel."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from threading import RLock
from typing import Any, Final, Self

import numpy as np
import viser

from tjscan.core.frames import Array
from tjscan.live.access import LOOPBACK_ADDRESS, close_server, open_server
from tjscan.live.buttons import HELD_BUTTON_RATE, Button
from tjscan.live.colours import ColourScale, viridis_colours
from tjscan.live.drawables import MeasuredPiece
from tjscan.live.panel import Panel
from tjscan.live.stage import Stage
from tjscan.live.step import Measure, SceneSetup, Step

FIELD_OF_VIEW: Final = 0.75
"""Radians, of the picture's height."""
RUN_SPACING: Final = 1.6
"""Distance of runs side by side, as a multiple of the distance that they are seen from."""

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

    def show(self, step: Step, measure: Measure | None) -> None:
        """Show what a step changes; colours span all values of the measure that ever came."""
        pieces = (one for one in step.drawn.values() if isinstance(one, MeasuredPiece))
        self._values += [piece.values for piece in pieces]
        scale = self.colour_by(measure)
        self.stage.draw(step.drawn)
        self.panel.update(step, measure, scale)

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
                self._add_choice_of_measure()
                self.views = self._add_views(settings)
        except BaseException:
            close_server(self.server)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        close_server(self.server)

    def show(self, step: Step, run: int = 0) -> None:
        """Show what a step changes in one of the runs."""
        with self._changing, self.server.atomic():
            self.views[run].show(step, self._measure)

    def enable(self, words: Mapping[str, bool]) -> None:
        """Let buttons be pressed, or not, by their words."""
        with self._changing:
            for word, enabled in words.items():
                self._buttons[word].disabled = not enabled

    def add_buttons(self, buttons: Sequence[Button]) -> None:
        """Add buttons; none that is pressed acts on the others before they are there."""
        with self._changing, self.server.atomic():
            for button in buttons:
                self._add_button(button)

    def _add_button(self, button: Button) -> None:
        gui, order = self.server.gui, BUTTONS_ORDER + len(self._buttons)
        handle = gui.add_button(button.word, color=button.tone, hint=button.hint, order=order)

        def act(_: object) -> None:
            button.press()

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
                view.panel.plot(self._measure, view.colour_by(self._measure))

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

    def _add_choice_of_measure(self) -> None:
        if len(self._measures) > 1:
            choice = self.server.gui.add_dropdown("Colour and plot", list(self._measures))
            choice.on_update(lambda _: self.choose_measure(choice.value))

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


def _positions_side_by_side(settings: Sequence[SceneSetup]) -> Array:
    """Positions of runs side by side, square to the line of sight, shape (n, 3)."""
    away = settings[0].look_from - settings[0].look_at
    aside = np.cross((0.0, 0.0, 1.0), away)
    spacing = RUN_SPACING * float(np.linalg.norm(away))
    step = spacing * aside / max(float(np.linalg.norm(aside)), 1e-9)
    return np.outer(np.arange(len(settings)), 0.5 * step)
