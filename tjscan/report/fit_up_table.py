"""The table of the fit-up by clock position: measured, as drawn, and whether it is allowed."""

from __future__ import annotations

from dataclasses import dataclass

from tjscan.report.clock import clock_text
from tjscan.report.data import ReportData
from tjscan.report.dimensions import COVERAGE, section_dimensions, sections_by_the_clock
from tjscan.result.section import lengths_along_groove


@dataclass(frozen=True, slots=True)
class FitUpCell:
    """A cell: its text, what was drawn there, and its verdict as of `Dimension`."""

    text: str
    under: str = ""
    verdict: str = ""


@dataclass(frozen=True, slots=True)
class FitUpTable:
    """Head, rows and note of the table."""

    head: tuple[str, ...]
    rows: tuple[tuple[FitUpCell, ...], ...]
    note: str


def fit_up_table(data: ReportData) -> FitUpTable:
    """Make the table of the sections nearest to the full hours.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    chosen = sections_by_the_clock(data)
    azimuths = data.unwrapped_azimuths
    lengths = 1e3 * lengths_along_groove(data.sections)
    sections = [data.sections[k] for k in chosen]
    every = section_dimensions(sections, data.joint)
    names = [one.name for one in every[0]]
    roots = dict.fromkeys(row[1].name for row in every)
    names[1] = " or ".join(roots)
    head = [f"{name} / {one.unit}" for name, one in zip(names, every[0], strict=True)]
    rows = []
    for k, section, dimensions in zip(chosen, sections, every, strict=True):
        where = f"{lengths[k]:.0f} mm" if azimuths is None else clock_text(azimuths[k])
        cells = [FitUpCell(one.text, one.designed_text, one.verdict) for one in dimensions]
        rows.append((FitUpCell(where), FitUpCell(data.section_number(section)), *cells))
    stated = any(one.verdict for row in every for one in row)
    note = f"± is {COVERAGE:g} standard deviations. "
    if data.joint is not None:
        note += "In brackets what is drawn, in the section's own plane"
        note += ", and its tolerance" if stated else ""
        note += "; the root face is what remains of the drawn wall. "
    if stated:
        note += (
            "Green keeps its tolerance with all of its uncertainty, red breaks it so, and what is "
            "amber may do either (ISO 14253-1)."
        )
    elif data.joint is not None:
        note += "The joint's file states no [tolerance] to hold it against."
    return FitUpTable(("at", "section", *head), tuple(rows), note)
