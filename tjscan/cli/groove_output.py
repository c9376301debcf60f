"""What ``tjscan groove`` prints and draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from json import dumps
from pathlib import Path
from typing import Final

from tjscan.cli.console import print_message
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.groove.settings import GrooveSettings
from tjscan.laser.files import flip_heights
from tjscan.laser.profile import Profile
from tjscan.result.readings import (
    ProfileReading,
    measure_grooves,
    measures_with_sigmas,
    reading_to_dict,
)

LISTED_BAD_ROWS: Final = 5
"""Unreadable rows that are listed one by one."""

TRIED_TURNED: Final = 10
"""Profiles that are read with heights turned round, where none shows a groove."""


def print_bad_rows(file: Path, bad: Sequence[str]) -> None:
    """Print on stderr which rows of a file could not be read."""
    for row in bad[:LISTED_BAD_ROWS]:
        print_message(f"{file}: {row}; left out")
    if len(bad) > LISTED_BAD_ROWS:
        print_message(f"{file}: and {len(bad) - LISTED_BAD_ROWS} more like these")


def print_readings(readings: Sequence[ProfileReading], bad: Sequence[str], *, json: bool) -> None:
    """Print a line per profile on stdout: measures with standard deviations, then the corners."""
    if json:
        print(
            dumps({"readings": [reading_to_dict(r) for r in readings], "bad": list(bad)}, indent=2)
        )
        return
    for reading in readings:
        if reading.refusal is not None:
            print(f"{reading.name}: {reading.refusal}")
            continue
        found = [] if reading.section is None else measures_with_sigmas(reading.section)
        values = [f"{name} {value:.3f} ± {sigma:.3f}" for name, value, sigma in found]
        corners = "  ".join(
            f"({x:.3f}, {z:.3f})" if seen else "(not seen)"
            for seen, (x, _, z) in zip(reading.is_seen, 1e3 * reading.points_s, strict=True)
        )
        words = [reading.found_in_words] if reading.found_in_words else []
        print(f"{reading.name}: {', '.join([*words, *values, f'x, z in mm {corners}'])}")


def suggest_height_sign(profiles: Mapping[str, Profile], settings: GrooveSettings) -> None:
    """Print on stderr if profiles without a groove show one once their heights change sign."""
    few = dict(islice(profiles.items(), TRIED_TURNED))
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
