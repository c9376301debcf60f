"""What ``tjscan laser`` shows: a drawing of each profile, or a line for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from json import dumps
from typing import Final

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.text import Text

from tjscan.cli.output.console import print_message
from tjscan.laser.line_laser import DescribedLaser, LineLaser
from tjscan.result.readings import ProfileReading, measures_with_sigmas, reading_to_dict

PROFILE_DRAWING_ROWS: Final = 18
PROFILE_DRAWING_COLUMNS: Final = 110
"""Characters of the drawing of a profile."""

POINT_MARK, CORNER_MARKS = "·", "12345678"


def print_laser_description(laser: LineLaser) -> None:
    """Print on stderr the identity of a laser and the data that it sends, as far as known."""
    if laser.identity:
        print_message(str(laser.identity))
    if isinstance(laser, DescribedLaser):
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
    (left, right), (top, bottom) = _value_span(x), _value_span(z)
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
            lines = [
                *draw_profile(reading, columns, PROFILE_DRAWING_ROWS),
                describe_reading(reading),
            ]
            with suppress(BlockingIOError):  # a terminal that is slower than the laser
                live.update(Text("\n".join(lines)), refresh=True)

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


def _value_span(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float]:
    """Least and greatest value; never the same."""
    low, high = float(values.min()), float(values.max())
    return (low, high) if high > low else (low - 0.5, high + 0.5)
