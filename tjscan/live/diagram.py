"""A state diagram on the page, as SVG."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import Final

TALL, GAP, WIDE, LEFT = 24, 20, 150, 18
"""Pixels: of a state's box, between two, across one, and left of them."""
BULGE: Final = 16
"""Pixels by which an arrow past one more state runs farther to the right."""
NOW, ALARM = "#2a6fbb", "#d0342c"


@dataclass(frozen=True, slots=True)
class StateDiagram:
    """States in a column, the ways between them, and the one that is.

    Parameters
    ----------
    states : tuple of str
        From top to bottom.
    ways : tuple of (str, str, str)
        From a state to another, and what leads there.
    now : str
        The state that is.
    alarm : str
        State that every other may lead to; empty where there is none.
    """

    states: tuple[str, ...]
    ways: tuple[tuple[str, str, str], ...]
    now: str
    alarm: str = ""

    def to_svg(self) -> str:
        """Draw it."""
        labels: dict[tuple[int, int], list[str]] = {}
        for start, end, label in self.ways:
            labels.setdefault((self.states.index(start), self.states.index(end)), []).append(label)
        parts = [self._box(k, state) for k, state in enumerate(self.states)]
        if self.alarm:
            parts.append(_alarm_line(self.states.index(self.alarm)))
        parts += [_arrow(start, end) for start, end in labels]
        parts += [_label(start, end, " / ".join(one)) for (start, end), one in labels.items()]
        height = _top(len(self.states)) - GAP + 4
        return (
            f'<svg viewBox="0 0 380 {height}" width="100%" role="img" '
            f'aria-label="state: {escape(self.now)}" font-family="system-ui,sans-serif" '
            f'font-size="11" fill="none" stroke="currentColor">{_HEAD}{"".join(parts)}</svg>'
        )

    def _box(self, k: int, state: str) -> str:
        is_now = state == self.now
        fill = (ALARM if state == self.alarm else NOW) if is_now else "none"
        text = "#fff" if is_now else "currentColor"
        return (
            f'<rect x="{LEFT}" y="{_top(k)}" width="{WIDE}" height="{TALL}" rx="5" fill="{fill}"/>'
            f'<text x="{LEFT + WIDE / 2}" y="{_top(k) + 16}" text-anchor="middle" fill="{text}" '
            f'stroke="none" font-size="12" font-weight="{700 if is_now else 400}">'
            f"{escape(state)}</text>"
        )


_HEAD: Final = (
    '<defs><marker id="tj-head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
    'markerHeight="7" orient="auto"><path d="M0 0L8 4L0 8z" fill="currentColor" stroke="none"/>'
    "</marker></defs>"
)


def _top(k: int) -> int:
    return 2 + k * (TALL + GAP)


def _middle(k: int, above: bool | None = None) -> float:
    """Height of a box's middle, or of a quarter above or below it."""
    return _top(k) + TALL / 2 + (0 if above is None else -TALL / 4 if above else TALL / 4)


def _arrow(start: int, end: int) -> str:
    """Straight down to the next state; else round the right side of what lies between."""
    middle, side = LEFT + WIDE / 2, LEFT + WIDE
    if end == start + 1:
        way = f"M{middle} {_top(start) + TALL}V{_top(end) - 1}"
    else:
        out = side + BULGE * abs(end - start)
        y0, y1 = _middle(start, end < start), _middle(end, end > start)
        way = f"M{side} {y0}C{out} {y0} {out} {y1} {side + 1} {y1}"
    return f'<path d="{way}" marker-end="url(#tj-head)"/>'


def _label(start: int, end: int, label: str) -> str:
    """Beside the middle of the arrow, on the ground's colour where it crosses another."""
    if end == start + 1:
        x, y = LEFT + WIDE / 2 + 8, _top(end) - GAP / 2
    else:
        x, y = LEFT + WIDE + 0.75 * BULGE * abs(end - start) + 5, _middle(start) / 2
        y += _middle(end) / 2
    ground = "stroke:var(--mantine-color-body,#fff);stroke-width:4;paint-order:stroke"
    return f'<text x="{x}" y="{y + 3}" fill="currentColor" style="{ground}">{escape(label)}</text>'


def _alarm_line(alarm: int) -> str:
    x, y = LEFT / 3, _top(alarm) + TALL / 2
    branches = "".join(f"M{x} {_top(k) + TALL / 2}H{LEFT}" for k in range(alarm))
    return (
        f'<path d="{branches}M{x} {_top(0) + TALL / 2}V{y}H{LEFT - 1}" stroke="{ALARM}" '
        'marker-end="url(#tj-head)"/>'
    )
