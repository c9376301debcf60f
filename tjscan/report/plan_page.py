"""``plan.html``: a weld plan on a page that opens offline."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.files import read_small_file, write_files_atomically
from tjscan.planning import document
from tjscan.report import picture

PLAN_PAGE: Final = "plan.html"
PLAN_FILE, BEADS_FILE, PICTURE_FILE = "plan.json", "beads.csv", "plan.png"

MOST_PICTURE_BYTES: Final = 5_000_000
"""A larger picture would make the page too large to send."""

WELDING_POSITION_COLOURS: Final = {
    "PA": "#2ca02c",
    "PB": "#98df8a",
    "PC": "#1f77b4",
    "PD": "#ffbb78",
    "PE": "#d62728",
    "PF": "#9467bd",
    "PG": "#8c564b",
}


def write_plan_page(directory: Path) -> Path:
    """Write ``plan.html`` from the plan's files in a directory, and return it.

    Parameters
    ----------
    directory : Path
        Holds ``plan.json``, ``beads.csv`` and ``plan.png``.

    Raises
    ------
    ConfigurationError
        If one of them can't be read.
    RecordingError
        If the page can't be written.
    """
    plan = document.read_plan(directory / PLAN_FILE)
    courses = document.read_beads_csv(directory / BEADS_FILE)
    filled = picture.picture_from_png(
        read_small_file(directory / PICTURE_FILE, MOST_PICTURE_BYTES, "a picture"),
        "Three sections filled, speed and heat input along each bead",
        "Beads are numbered in the order of welding. Dashed: the windows of the WPS. If a bead "
        "overlaps its start, s goes on beyond the groove's length.",
    )
    page = picture.load_template("plan.html.jinja").render(
        plan=plan,
        beads=list(document.bead_rows(plan)),
        out_of_wps=document.out_of_wps_rows(plan),
        out_of_wps_head=document.OUT_OF_WPS_HEAD,
        bead_head=tuple(document.BEAD_COLUMNS),
        pictures=[filled, draw_welding_positions(courses)],
        provenance=plan.provenance.header_entries,
    )
    with write_files_atomically(directory) as draft:
        (draft / PLAN_PAGE).write_text(page, encoding="utf-8")
    return directory / PLAN_PAGE


def draw_welding_positions(courses: Sequence[document.BeadCourse]) -> picture.ReportPicture:
    """Draw in which welding position each bead is laid, along the groove."""
    figure = picture.new_figure(12, 1.6 + 0.24 * len({bead.number for bead in courses}))
    axes = figure.add_subplot()
    seen: set[str] = set()
    for bead in courses:
        for name, start, end in _stretches_of_welding_position(bead):
            colour = WELDING_POSITION_COLOURS[name]
            axes.barh(bead.number, end - start, left=start, height=0.8, color=colour)
            seen.add(name)
    for name in sorted(seen):
        axes.barh(np.nan, 0, color=WELDING_POSITION_COLOURS[name], label=name)
    axes.set_yticks(sorted({bead.number for bead in courses}))
    axes.invert_yaxis()
    axes.set(xlabel="s / mm", ylabel="bead")
    axes.legend(ncols=len(seen), fontsize="small", loc="lower right", bbox_to_anchor=(1, 1))
    return picture.inline_figure(
        figure,
        "Welding positions",
        "The nearest principal position of ISO 6947 along each bead, in the order of welding.",
    )


def _stretches_of_welding_position(bead: document.BeadCourse) -> Iterator[tuple[str, float, float]]:
    """Positions, with the lengths from where to where each stays the same."""
    first = 0
    for name, group in groupby(bead.positions):
        end = first + len(list(group))
        yield name, float(bead.s[first]), float(bead.s[min(end, len(bead.s) - 1)])
        first = end
