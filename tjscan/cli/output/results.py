"""What ``tjscan groove`` prints and draws, and what ``tjscan compare`` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from json import dumps
from math import hypot
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.cli.output.console import print_message, print_table
from tjscan.comparison.compare import Comparison, comparison_to_dict
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.groove.settings import GrooveSettings
from tjscan.laser.files.read import flip_heights
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

MOST_PROFILES_INVERTED: Final = 10
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
        print(
            dumps({"readings": [reading_to_dict(r) for r in readings], "bad": list(bad)}, indent=2)
        )
        return
    corners = corners or all(r.section is None for r in readings)  # a butt joint's are all it has
    cells = [_corner_cells(r) if corners else _measure_cells(r) for r in readings]
    names = list(dict.fromkeys(name for row in cells for name in row))
    print_table(
        [
            ("profile", *names, "found"),
            *(
                (reading.name, *(row.get(name, "") for name in names), _found_in_words(reading))
                for reading, row in zip(readings, cells, strict=True)
            ),
        ]
    )


def _measure_cells(reading: ProfileReading) -> dict[str, str]:
    """Each measure with one standard deviation."""
    found = [] if reading.section is None else measures_with_sigmas(reading.section)
    return {name: f"{value:.3f} ± {sigma:.3f}" for name, value, sigma in found}


def _corner_cells(reading: ProfileReading) -> dict[str, str]:
    """Each corner with the standard deviation of x and z together; a tee's ends have none."""
    ends = (len(reading.points_s) - len(reading.corner_sigmas)) // 2
    sigmas = ["" for _ in range(ends)]
    sigmas = [*sigmas, *(f" ± {1e3 * hypot(*one):.3f}" for one in reading.corner_sigmas), *sigmas]
    return {
        f"p{i}_x_z_mm": f"{x:.3f} {z:.3f}{sigma}" if seen else "not seen"
        for i, (seen, (x, _, z), sigma) in enumerate(
            zip(reading.corners_seen, 1e3 * reading.points_s, sigmas, strict=True), start=1
        )
    }


def _found_in_words(reading: ProfileReading) -> str:
    if reading.refusal is not None:
        return str(reading.refusal)
    return reading.found_in_words or "butt joint"


def suggest_height_sign(profiles: Mapping[str, Profile], settings: GrooveSettings) -> None:
    """Print on stderr if profiles without a groove show one once their heights change sign."""
    few = dict(islice(profiles.items(), MOST_PROFILES_INVERTED))
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
    if c.tolerance is not None:
        verdict = "within" if c.passed else "OUTSIDE"
        print(f"p95 {verdict} the tolerance of {1e3 * c.tolerance:g} mm")
