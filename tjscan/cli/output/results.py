"""What ``tjscan groove``, ``tjscan laser`` and ``tjscan compare`` print and draw."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from itertools import islice
from json import dumps
from math import hypot
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.text import Text

from tjscan.cli.output.console import print_message, print_table
from tjscan.comparison.compare import Comparison, comparison_to_dict
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.groove.settings import GrooveSettings
from tjscan.laser.files.read import flip_heights
from tjscan.laser.line_laser import LineLaser, SelfDescribingLaser
from tjscan.laser.profile import Profile
from tjscan.result.readings import (
    ProfileReading,
    measure_grooves,
    measures_with_sigmas,
    reading_to_dict,
)
from tjscan.uncertainty.budget import budget_in_words

MOST_LISTED_BAD_ROWS: Final = 5
"""Unreadable rows that are listed one by one."""

MOST_PROFILES_TRIED_INVERTED: Final = 10
"""Profiles that are read with heights turned round if none shows a groove."""


def print_bad_rows(file: Path, bad: Sequence[str]) -> None:
    """Print on stderr which rows of a file could not be read."""
    for row in bad[:MOST_LISTED_BAD_ROWS]:
        print_message(f"{file}: {row}; left out")
    if len(bad) > MOST_LISTED_BAD_ROWS:
        print_message(f"{file}: and {len(bad) - MOST_LISTED_BAD_ROWS} more like these")


def print_readings(
    readings: Sequence[ProfileReading], bad: Sequence[str], *, corners: bool, json: bool
) -> None:
    """Print what was read in each profile on stdout: a table, or JSON, which holds all.

    Parameters
    ----------
    readings : sequence of ProfileReading
        One for each profile.
    bad : sequence of str
        Rows of the file that could not be read.
    corners : bool
        A table of the corners, x and z in frame s, in place of the measures.
    json : bool
        JSON in place of a table.
    """
    if json:
        dicts = [reading_to_dict(reading) for reading in readings]
        print(dumps({"readings": dicts, "bad": list(bad)}, indent=2))
        return
    corners = corners or all(r.section is None for r in readings)  # a butt joint's are all it has
    cells = [_corner_cells(r) if corners else _measure_cells(r) for r in readings]
    names = list(dict.fromkeys(name for row in cells for name in row))
    rows = [("profile", *names, "found")]
    for reading, row in zip(readings, cells, strict=True):
        found = str(reading.refusal or reading.found_in_words or "butt joint")
        rows.append((reading.name, *(row.get(name, "") for name in names), found))
    print_table(rows)


def _measure_cells(reading: ProfileReading) -> dict[str, str]:
    """Each measure with one standard deviation."""
    found = [] if reading.section is None else measures_with_sigmas(reading.section)
    return {name: f"{value:.3f} ± {sigma:.3f}" for name, value, sigma in found}


def _corner_cells(reading: ProfileReading) -> dict[str, str]:
    """Each corner with the standard deviation of x and z together; a tee's ends have none."""
    ends = (len(reading.points_s) - len(reading.corner_sigmas)) // 2
    sigmas = ["" for _ in range(ends)]
    sigmas = [*sigmas, *(f" ± {1e3 * hypot(*one):.3f}" for one in reading.corner_sigmas), *sigmas]
    found = zip(reading.corners_seen, 1e3 * reading.points_s, sigmas, strict=True)
    return {
        f"p{i}_x_z_mm": f"{x:.3f} {z:.3f}{sigma}" if seen else "not seen"
        for i, (seen, (x, _, z), sigma) in enumerate(found, start=1)
    }


def suggest_height_sign(profiles: Mapping[str, Profile], settings: GrooveSettings) -> None:
    """Print on stderr if profiles without a groove show one once their heights change sign."""
    few = dict(islice(profiles.items(), MOST_PROFILES_TRIED_INVERTED))
    turned = {name: flip_heights(p) for name, p in few.items() if p.valid.any()}
    found = sum(reading.refusal is None for reading in measure_grooves(turned, settings))
    if 2 * found > len(turned):
        print_message(
            f"{found} of {len(turned)} profiles show a groove with heights the other way round: "
            "they seem to grow towards the sensor; give --z-scale the other sign"
        )


def check_plot_path(plot: Path | None) -> None:
    """Check that a picture can be written there; raises ConfigurationError if not."""
    if plot is not None and (plot.suffix.lower() != ".png" or not plot.parent.is_dir()):
        raise ConfigurationError("names a .png in a folder that exists", file=plot, key="--plot")


def draw_readings_png(
    plot: Path, readings: Sequence[ProfileReading], settings: GrooveSettings
) -> None:
    """Draw the profiles with their fitted grooves into a PNG."""
    from tjscan.result.picture import draw_profiles_with_fits, write_png

    with write_files_atomically(plot.parent) as draft:
        write_png(draft / plot.name, draw_profiles_with_fits(readings, settings))
    print_message(f"drawn in {plot}")


def print_comparison(comparison: Comparison, *, json: bool) -> None:
    """Print what was compared and its distances on stdout, or JSON; warnings go to stderr."""
    if json:
        print(dumps(comparison_to_dict(comparison), indent=2))
        return
    c, a = comparison, comparison.alignment
    for shape in (c.measured, c.reference):
        print(f"{shape.name}: {shape.stated.unit}, as {shape.stated.unit_source} states")
    print(f"given in frame {c.reference.stated.frame}")
    if a.method != "none":
        rounds = f", {a.rounds} rounds" if a.rounds else ""
        print(
            f"aligned by {a.method}: moved {1e3 * a.moved:.3f} mm, turned "
            f"{np.degrees(a.rotation_angle):.4f}°, {100 * a.fitness:.1f} % on the reference, "
            f"residual {1e3 * a.residual:.4f} mm rms{rounds}"
        )
    for d in reversed(c.deviations):  # the corners first: a cloud holds ghosts too
        s = d.statistics
        within = "" if d.within is None else f", {100 * d.within:.2f} % within tolerance"
        print(f"{d.kind}, {len(d.distances)} distances: {d.meaning}")
        print(
            f"  median {s.median:.4f}, p95 {s.p95:.4f}, rms {s.rms:.4f}, mean {s.mean:.4f}, "
            f"max {s.max:.4f} mm{within}"
        )
    if c.uncertainty is not None:
        print(budget_in_words(c.uncertainty))
    for warning in c.warnings:
        print_message(f"warning: {warning}")
    verdict = ""
    if c.tolerance is not None:
        place = "within" if c.passed else "OUTSIDE"
        verdict = f", {place} the tolerance of {1e3 * c.tolerance:g} mm"
    p95, of_what = c.p95
    print(f"p95 {p95:.4f} mm{verdict}: of {of_what}")


PROFILE_DRAWING_ROWS: Final = 18
PROFILE_DRAWING_COLUMNS: Final = 110
"""Characters of the drawing of a profile."""

POINT_MARK, CORNER_MARKS = "·", "12345678"


def print_laser_description(laser: LineLaser) -> None:
    """Print on stderr the identity of a laser and the data that it sends, as far as known."""
    if laser.identity:
        print_message(str(laser.identity))
    if isinstance(laser, SelfDescribingLaser):
        described = laser.describe()
        for line in (described.link, described.format, described.advice):
            if line:
                print_message(line)


def draw_profile(reading: ProfileReading, columns: int, rows: int) -> list[str]:
    """Draw a profile as lines of text, the sensor above; corners by their numbers.

    Parameters
    ----------
    reading : ProfileReading
        The profile, and what was read in it.
    columns, rows : int
        Characters.
    """
    profile = reading.profile
    x, z = (1e3 * values[profile.valid] for values in (profile.x_s, profile.z_s))
    if not len(x):
        return ["no point in range"]
    canvas = np.full((rows, columns), " ")
    (left, right), (top, bottom) = _nonempty_span(x), _nonempty_span(z)
    across, down = (columns - 1) / (right - left), (rows - 1) / (bottom - top)
    canvas[np.round((z - top) * down).astype(int), np.round((x - left) * across).astype(int)] = (
        POINT_MARK
    )
    for mark, (corner_x, _, corner_z) in zip(CORNER_MARKS, 1e3 * reading.points_s, strict=False):
        column, row = round((corner_x - left) * across), round((corner_z - top) * down)
        if 0 <= column < columns and 0 <= row < rows:
            canvas[row, column] = mark
    lines = ["".join(row).rstrip() for row in canvas]
    return [*lines, f"x {left:.1f} to {right:.1f} mm, z {top:.1f} (top) to {bottom:.1f} mm"]


def describe_reading(reading: ProfileReading) -> str:
    """One line about a profile: how many points, and the groove or why there is none."""
    valid = int(reading.profile.valid.sum())
    points = f"{reading.name}: {valid} of {len(reading.profile)} points"
    if reading.refusal is not None:
        return f"{points}, {reading.refusal}"
    measures = [] if reading.section is None else measures_with_sigmas(reading.section)
    values = [f"{name} {value:.2f} ± {sigma:.2f}" for name, value, sigma in measures]
    words = [reading.found_in_words] if reading.found_in_words else []
    return ", ".join([points, *words, *values])


@contextmanager
def show_live_readings(*, json: bool) -> Iterator[Callable[[ProfileReading], None]]:
    """Give what shows readings as they come, while the block runs; Ctrl-C ends it.

    Parameters
    ----------
    json : bool
        Whether to print JSON instead, a line for each.
    """
    console = Console(highlight=False)
    drawn = console.is_terminal and not json
    live = Live(console=console, auto_refresh=False) if drawn else None

    def show_reading(reading: ProfileReading) -> None:
        if json:
            print(dumps(_reading_with_time(reading)), flush=True)
        elif live is None:
            print(describe_reading(reading), flush=True)
        else:
            columns = min(console.width, PROFILE_DRAWING_COLUMNS)
            lines = draw_profile(reading, columns, PROFILE_DRAWING_ROWS)
            with suppress(BlockingIOError):  # a terminal that is slower than the laser
                live.update(Text("\n".join((*lines, describe_reading(reading)))), refresh=True)

    with suppress(KeyboardInterrupt), live or nullcontext():
        yield show_reading


def _reading_with_time(reading: ProfileReading) -> dict[str, object]:
    profile = reading.profile
    return {
        "points": int(profile.valid.sum()),
        "columns": len(profile),
        "time_s": profile.time,
        "time_uncertainty_s": profile.time_uncertainty,
        **reading_to_dict(reading),
    }


def _nonempty_span(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float]:
    """Least and greatest value; never the same."""
    low, high = float(values.min()), float(values.max())
    return (low, high) if high > low else (low - 0.5, high + 0.5)
