"""What the report of a run shows of its weld."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tjscan.core.manifest import check_files_unaltered
from tjscan.result.chapter import HeadlineNumber, ReportChapter, ReportChart, verdict_on
from tjscan.result.directory import JOB_FILE
from tjscan.runs.weld.journal import (
    HEIGHT_EVENT,
    SURFACE_EVENT,
    WELD_RECORDING,
    WELD_STOP_EVENT,
    WIDE_POOLS_EVENT,
)
from tjscan.runs.weld.results import SIMULATED_WELD_NOTE, RecordedWeld, read_recorded_weld

NOT_SEEN_NOTE = (
    "A laser sees no crack, no lack of fusion, no pore below a millimetre and nothing of the far "
    "side of the root."
)


def weld_chapter(directory: Path) -> ReportChapter:
    """Make a weld's chapter of a report; see `tjscan.result.chapter.ChapterWriter`."""
    if not (directory / f"{WELD_RECORDING}.mcap").is_file():
        return ReportChapter()
    check_files_unaltered(directory / JOB_FILE)
    found = read_recorded_weld(directory)
    return ReportChapter(
        facts=tuple(_weld_facts(found)),
        findings=tuple(_weld_findings(found)),
        headline=tuple(_weld_headline(found)),
        charts=tuple(_weld_charts(found)),
        events=found.events,
    )


def _weld_headline(found: RecordedWeld) -> Iterator[HeadlineNumber]:
    begun = sum(1 for bead in found.beads if found.arcs_of(bead))
    stopped = any(event.name == WELD_STOP_EVENT for event in found.events)
    words = f"{begun} of {len(found.beads)} planned beads are welded"
    if found.arcs:
        yield verdict_on(begun == len(found.beads) and not stopped, words)
    else:
        yield HeadlineNumber("planned only", words)
    length = 1e3 * sum(arc.end - arc.begin for arc in found.arcs)
    minutes = sum(arc.seconds for arc in found.arcs) / 60
    yield HeadlineNumber(f"{length:.0f} mm of bead", f"in {minutes:.1f} min of arc, simulated")
    yield HeadlineNumber(f"{len(found.looks)} looks", "at the groove, in between and in the end")


def _weld_facts(found: RecordedWeld) -> Iterator[tuple[str, str]]:
    yield "arc time", f"{sum(arc.seconds for arc in found.arcs) / 60:.1f} min, as simulated"
    for bead in found.beads:
        arcs = found.arcs_of(bead)
        length = sum(arc.end - arc.begin for arc in arcs)
        speed = [60e3 * float(v) for v in (bead.speed.min(), bead.speed.max())]
        yield (
            f"{bead.name}, layer {bead.layer + 1}",
            f"{1e6 * bead.area.mean():.1f} mm² planned on average (believed), {speed[0]:.0f} to "
            f"{speed[1]:.0f} mm/min (set); {1e3 * length:.0f} mm welded by "
            f"{len(arcs)} arc{'s' * (len(arcs) != 1)}",
        )
    for look in found.looks[-1:]:
        yield (
            "learnt",
            f"deposition {look.gain:.3f} of what wire and speed give, torch "
            f"{1e3 * look.offset:.2f} mm beside its pose, shrinkage {look.shrinkage:.2f} of the "
            "model's (believed)",
        )


def _weld_findings(found: RecordedWeld) -> Iterator[str]:
    yield f"{SIMULATED_WELD_NOTE}."
    yield NOT_SEEN_NOTE
    for bead in found.beads:
        if at_limit := float(bead.is_at_limit.mean()):
            yield (
                f"{100 * at_limit:.0f} % of {bead.name} is at a limit of the WPS: what is missing "
                "there is left to later beads."
            )
        if not bead.weldable.all():
            share = 100 * (1 - float(bead.weldable.mean()))
            yield f"{share:.0f} % of {bead.name} was not read, and no arc burned there."
    for event in found.events:
        if event.name == WELD_STOP_EVENT:
            yield f"It was stopped: {event.detail}"
        if event.name in (SURFACE_EVENT, WIDE_POOLS_EVENT):
            yield f"{event.name.capitalize()}: {event.detail}."
        if event.name == HEIGHT_EVENT:
            yield f"The torch's height was at its bound: {event.detail}"


def _weld_charts(found: RecordedWeld) -> Iterator[ReportChart]:
    if not found.looks:
        return
    middle = len(found.looks[0].read) // 2
    title = "section in the middle of the weld, look by look"
    for look in found.looks:
        x, y = 1e3 * look.u, 1e3 * look.seen.w[middle]
        yield ReportChart(title, "across, brace to leg / mm", "height / mm", x, y, line=look.name)
    along = "along the groove / mm"
    for bead in found.beads:
        s, speed = 1e3 * bead.s, 60e3 * bead.speed
        yield ReportChart("travel speed set", along, "speed / (mm/min)", s, speed, line=bead.name)
    for quantity, label, factor in (
        ("current", "current / A", 1.0),
        ("heat_input", "heat input / (kJ/mm)", 1e-6),
    ):
        for bead in found.beads:
            rows = [row for row in found.stretches if bead.is_of(row)]
            known = [(row.begin, getattr(row, quantity)) for row in rows]
            known = [(begin, one) for begin, one in known if one.value is not None]
            if known:
                x = 1e3 * np.array([begin for begin, _ in known])
                y = factor * np.array([one.value for _, one in known])
                title = f"{quantity.replace('_', ' ')}, {known[0][1].source}"
                yield ReportChart(title, along, label, x, y, line=bead.name)
