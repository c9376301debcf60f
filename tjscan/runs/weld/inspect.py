"""A finished weld's last look against a table of limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.sourced import NumberSource, value_entry
from tjscan.core.units import DEG, MM, FileUnit
from tjscan.crawler.journal import CRAWL_RECORDING
from tjscan.job.crawl.job import read_crawl_job
from tjscan.job.weld import read_weld_job
from tjscan.recording.parts import recording_files
from tjscan.result.directory import JOB_FILE
from tjscan.runs.crawl.run import look_at_finished_weld
from tjscan.runs.weld.journal import LookMessage, read_weld
from tjscan.runs.weld.results import SIMULATED_WELD_NOTE
from tjscan.runs.weld.run import Weld, WeldContext
from tjscan.welding.inspection import (
    WHAT_A_LASER_CANNOT_SEE,
    InspectionRow,
    inspect_weld,
    measure_weld,
    read_limits,
)


def inspect_run(directory: Path, limits: Path, thickness: float) -> tuple[InspectionRow, ...]:
    """Hold the last look of a weld's, or a crawl's, run against a table of limits.

    Parameters
    ----------
    directory : Path
        Of the run.
    limits : Path
        File of the table.
    thickness : float
        Of the thinner part, metres.

    Raises
    ------
    ConfigurationError
        If the run's weld is not finished or was not looked at since, or the table is wrong.
    """
    table = read_limits(limits)
    if is_crawl(directory):
        planner, seen = look_at_finished_weld(directory)
        u = np.tile(seen.u, (len(seen.w), 1))
        measures = measure_weld(planner.belief, u, seen.w, seen.sigma, seen.read, butt=True)
        return inspect_weld(measures, table, thickness)
    context = WeldContext(read_weld_job(directory / JOB_FILE), directory / JOB_FILE)
    weld, last = Weld.of_scan(context, directory), dict[str, LookMessage]()
    for message in read_weld(directory):
        weld.replay(message)
        if isinstance(message, LookMessage):
            last[message.station] = message
    done = max((look.beads for look in last.values()), default=0)
    if weld.planner is None or done < weld.count:
        raise ConfigurationError(
            "its weld is not finished, or was not looked at after the last bead: weld on with "
            "'tjscan weld RUN --resume --arc'",
            file=directory,
        )
    seen = weld.over_all_sections([(look.seen, look.station) for look in last.values()])
    u = np.tile(seen.u, (len(seen.w), 1))
    measures = measure_weld(weld.planner.belief, u, seen.w, seen.sigma, seen.read, butt=False)
    return inspect_weld(measures, table, thickness)


def is_crawl(directory: Path) -> bool:
    """Whether a run directory is a crawl's."""
    return recording_files(directory, CRAWL_RECORDING)[0].is_file()


def is_simulated(directory: Path) -> bool:
    """Whether the weld of a run was simulated: an arm's always is."""
    return not is_crawl(directory) or read_crawl_job(directory / JOB_FILE).simulation is not None


def inspection_as_json(rows: tuple[InspectionRow, ...], *, simulated: bool) -> dict[str, Any]:
    """Rows of an inspection as JSON holds them: each number states where it comes from."""
    return {
        "schema": "tjscan.weld-inspection",
        **({"note": SIMULATED_WELD_NOTE} if simulated else {}),
        "not_seen": WHAT_A_LASER_CANNOT_SEE,
        "rows": [
            {
                "imperfection": row.limit.imperfection,
                "number": row.limit.number,
                "level": row.limit.level,
                "remark": row.limit.remark,
                "state": row.state,
                **{
                    name: value_entry(value, source, unit)
                    for name, value, unit, source in _numbers_of_row(row, simulated=simulated)
                },
            }
            for row in rows
        ],
    }


def _numbers_of_row(
    row: InspectionRow, *, simulated: bool
) -> tuple[tuple[str, float, FileUnit, NumberSource], ...]:
    unit = DEG if row.limit.imperfection == "toe angle" else MM
    measured = NumberSource.SIMULATED if simulated else NumberSource.MEASURED
    return (
        ("value", row.value, unit, measured),
        ("sigma", row.sigma, unit, NumberSource.BELIEVED),
        ("limit", row.allowed, unit, NumberSource.SET),
        ("place", row.s, MM, measured),
        ("length", row.length, MM, measured),
        ("longest_in_100_mm", row.longest_in_window, MM, measured),
        ("not_seen", row.unseen, MM, measured),
    )


def inspection_cells(row: InspectionRow) -> tuple[str, ...]:
    """A row of an inspection as a table shows it."""
    unit = DEG if row.limit.imperfection == "toe angle" else MM
    value, sigma, limit = (x / unit.factor for x in (row.value, row.sigma, row.allowed))
    return (
        f"{row.limit.imperfection} {row.limit.number} {row.limit.level}".strip(),
        f"{value:.2f} ± {sigma:.2f}",
        f"{'≥' if row.limit.is_least else '≤'} {limit:.2f} {unit.suffix}",
        f"{1e3 * row.s:.0f}",
        f"{1e3 * row.length:.0f}",
        row.state,
    )
