"""Boxes of a page in a browser: text that overlaps or is cut off, what a page is too narrow for."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from mpl_toolkits.mplot3d.art3d import Text3D

if TYPE_CHECKING:
    from playwright.sync_api import Page

LEAST_OVERLAP: Final = 1.5
"""Pixels by which two texts overlap, or one is cut off, before it counts."""

FAULTS_OF_BOXES: Final = """
([paper, tolerance]) => {
    const faults = [], lines = [];
    const root = document.scrollingElement;
    const width = paper || root.clientWidth;
    if (root.scrollWidth > width + tolerance)
        faults.push(`scrolls sideways: ${root.scrollWidth} of ${width} pixels`);
    const said = text => text.replace(/\\s+/g, " ").trim().slice(0, 40);
    const shown = element => {
        if (!element.checkVisibility({checkOpacity: true, checkVisibilityCSS: true})) return false;
        const box = element.getBoundingClientRect();
        return box.width > 0 && box.height > 0;
    };
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
        const element = node.parentElement;
        if (!said(node.data) || /^(STYLE|SCRIPT|TITLE|OPTION|NOSCRIPT)$/i.test(element.tagName)
            || !shown(element)) continue;
        const range = document.createRange();
        range.selectNodeContents(node);
        for (const line of range.getClientRects()) {
            let seen = {left: line.left, right: line.right, top: line.top, bottom: line.bottom};
            let scrolled = false;
            for (let over = element; over && over !== document.body; over = over.parentElement) {
                const style = getComputedStyle(over), box = over.getBoundingClientRect();
                const clips = axis => {
                    const how = style[`overflow${axis}`];
                    return over.tagName === "svg" ? how !== "visible"
                        : style.display !== "inline" && how !== "visible";
                };
                const scrolls = axis => !paper && /auto|scroll/.test(style[`overflow${axis}`]);
                if (clips("X")) {
                    if (scrolls("X")) scrolled = true;
                    else if (seen.left < box.left - tolerance || seen.right > box.right + tolerance)
                        if (!scrolled) faults.push(`cut off: "${said(node.data)}"`);
                    seen.left = Math.max(seen.left, box.left);
                    seen.right = Math.min(seen.right, box.right);
                }
                if (clips("Y")) {
                    if (scrolls("Y")) scrolled = true;
                    else if (seen.top < box.top - 4 || seen.bottom > box.bottom + 4)
                        if (!scrolled) faults.push(`cut off: "${said(node.data)}"`);
                    seen.top = Math.max(seen.top, box.top);
                    seen.bottom = Math.min(seen.bottom, box.bottom);
                }
                if (style.position === "fixed") break;
            }
            if (seen.right <= seen.left || seen.bottom <= seen.top) continue;
            if (seen.left < -tolerance || seen.right > width + tolerance)
                faults.push(`beyond the page: "${said(node.data)}"`);
            // A line's box is taller than its letters.
            const slack = 0.18 * (line.bottom - line.top);
            lines.push({...seen, top: seen.top + slack, bottom: seen.bottom - slack, element,
                        text: said(node.data)});
        }
    }
    for (const picture of document.querySelectorAll("img, svg, canvas, table, button, input")) {
        if (!shown(picture) || picture.parentElement.closest("svg")) continue;
        const box = picture.getBoundingClientRect();
        let held = false;
        for (let over = picture; over && !held; over = over.parentElement)
            held = !paper && /auto|scroll|hidden|clip/.test(getComputedStyle(over).overflowX);
        if (!held && (box.left < -tolerance || box.right > width + tolerance))
            faults.push(`beyond the page: <${picture.tagName.toLowerCase()}>`);
    }
    lines.sort((one, other) => one.top - other.top);
    for (let i = 0; i < lines.length; i++)
        for (let k = i + 1; k < lines.length && lines[k].top < lines[i].bottom; k++) {
            const one = lines[i], other = lines[k];
            const across = Math.min(one.right, other.right) - Math.max(one.left, other.left);
            const down = Math.min(one.bottom, other.bottom) - Math.max(one.top, other.top);
            if (across > tolerance && down > tolerance)
                faults.push(`overlap: "${one.text}" and "${other.text}"`);
        }
    return [...new Set(faults)];
}
"""
"""Faults of the boxes of a page, in words; on paper nothing scrolls, and `paper` is its width."""

A4_WIDTH: Final = 688
"""Pixels of CSS between the margins of a sheet, 210 mm less two of 14 mm."""

SHEET_HEIGHT: Final = 1040
"""Pixels of CSS of a sheet between its margins."""


def faults_of_page(page: Page, *, paper: bool = False) -> list[str]:
    """What is wrong with the boxes of a page as it is now.

    Parameters
    ----------
    page : Page
    paper : bool
        Whether it is measured as it prints on A4.
    """
    if not paper:
        return list(page.evaluate(FAULTS_OF_BOXES, [0, LEAST_OVERLAP]))
    before = page.viewport_size
    page.emulate_media(media="print")
    page.set_viewport_size({"width": A4_WIDTH, "height": SHEET_HEIGHT})
    faults = list(page.evaluate(FAULTS_OF_BOXES, [A4_WIDTH, LEAST_OVERLAP]))
    page.emulate_media(media="null")
    if before is not None:
        page.set_viewport_size(before)
    return faults


def faults_of_buttons(page: Page, patience: float = 5000) -> list[str]:
    """Buttons that can be pressed but not be reached: none scrolls or folds them into view."""
    from playwright.sync_api import Error as PlaywrightError

    faults = []
    for button in page.get_by_role("button").element_handles():
        word = (button.text_content() or "").strip()
        if not word or not button.is_visible() or button.is_disabled():
            continue
        try:
            button.click(trial=True, timeout=patience)
        except PlaywrightError as error:
            if button.is_visible():  # the page of a run may take it away meanwhile
                faults.append(f"out of reach: {word!r} ({str(error).splitlines()[0]})")
    return faults


def faults_of_figure(figure: Figure) -> list[str]:
    """Texts of a figure that overlap each other or are cut off by its edge."""
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    page = figure.bbox.extents
    found = []
    hidden = set(_labels_of_hidden_ticks(figure))
    texts: list[Any] = figure.findobj(Text)
    for text in texts:
        if not (text.get_visible() and text.get_text().strip()):
            continue
        if isinstance(text, Text3D) or id(text) in hidden:  # which stands where its point does
            continue
        box = text.get_window_extent(renderer)
        if not np.isfinite(box.extents).all() or min(box.width, box.height) < LEAST_OVERLAP:
            continue
        found.append((text.get_text().strip()[:40], box))
    faults = []
    for text, box in found:
        x0, y0, x1, y1 = box.extents
        out = max(page[0] - x0, page[1] - y0, x1 - page[2], y1 - page[3])
        if out > LEAST_OVERLAP:
            faults.append(f"cut off in a picture: {text!r}")
    for (one, a), (another, b) in combinations(found, 2):
        across = min(a.x1, b.x1) - max(a.x0, b.x0)
        down = min(a.y1, b.y1) - max(a.y0, b.y0)
        if across > LEAST_OVERLAP and down > 0.36 * min(a.height, b.height):
            faults.append(f"overlap in a picture: {one!r} and {another!r}")
    return faults


def _labels_of_hidden_ticks(figure: Figure) -> Iterator[int]:
    """Identities of texts on axes that are not shown, and of ticks beyond their range."""
    for axes in figure.axes:
        axis: Any
        for axis in axes._axis_map.values():
            shown = axes.get_visible() and axes.axison
            drawn = {id(tick) for tick in axis._update_ticks()} if shown else set()
            for tick in (*axis.majorTicks, *axis.minorTicks):
                if id(tick) not in drawn or axes.name == "3d":
                    yield from map(id, (tick.label1, tick.label2))
            if not shown:
                yield from map(id, (axis.label, axis.offsetText))


@contextmanager
def watched_figures() -> Iterator[dict[str, list[str]]]:
    """Note the faults of every figure that is saved meanwhile, by its texts' first words."""
    faults: dict[str, list[str]] = defaultdict(list)
    save = Figure.savefig

    def save_and_look(figure: Figure, *args: Any, **options: Any) -> None:
        save(figure, *args, **options)
        titles = [axes.get_ylabel() or axes.get_title() for axes in figure.axes]
        faults[next(filter(None, titles), "figure")] += faults_of_figure(figure)

    Figure.savefig = save_and_look  # type: ignore[method-assign, assignment]
    try:
        yield faults
    finally:
        Figure.savefig = save  # type: ignore[method-assign]
