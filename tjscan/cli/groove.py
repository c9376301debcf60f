"""``tjscan groove``."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

MOST_NOISE_MM: Final = 5.0
"""No line laser is noisier."""

MOST_TOLD: Final = 5
"""Bad rows that are named one by one."""


def groove(
    file: Path,
    *,
    units: Literal["mm", "um", "m"] | None = None,
    pitch: float | None = None,
    invalid: list[float] | None = None,
    model: Literal["tee", "butt-v", "butt-v-sharp"] = "tee",
    noise_mm: float = 0.05,
    plot: Path | None = None,
    json: bool = False,
) -> None:
    """Read the groove in recorded profiles: corners and measures, each with its uncertainty.

    Parameters
    ----------
    file
        CSV with columns x and z, CSV with a profile per row, PLY, or a run directory.
    units
        Unit of length, where the names of the columns don't tell it.
    pitch
        Distance of the columns of a matrix, in that unit.
    invalid
        A value that stands for no point, beside NaN and nothing.
    model
        What the groove looks like.
    noise_mm
        Largest standard deviation of the range that is expected.
    plot
        Draw the profiles with their fits into this PNG.
    json
        Print the readings as JSON on stdout.
    """
    import sys
    from json import dumps

    from tjscan.cli.console import say, show_readings
    from tjscan.errors import ConfigurationError
    from tjscan.groove.find import GrooveSettings
    from tjscan.groove.models import MODELS
    from tjscan.laser.files import ProfileFormat, ProfileTable, read_profiles
    from tjscan.recording.reader import read_run
    from tjscan.result.picture import write_picture
    from tjscan.result.readings import draw_readings, read_all, to_dict

    if not 0 < noise_mm <= MOST_NOISE_MM:
        raise ConfigurationError(f"lies above 0, up to {MOST_NOISE_MM:g} mm", key="--noise-mm")
    if plot is not None and (plot.suffix.lower() != ".png" or not plot.parent.is_dir()):
        raise ConfigurationError("names a .png in a folder that exists", file=plot, key="--plot")
    if file.is_dir():
        table = ProfileTable(read_run(file))
    else:
        table = read_profiles(file, ProfileFormat(units, pitch, tuple(invalid or ())))
    for bad in table.bad[:MOST_TOLD]:
        say(f"{file}: {bad}; left out")
    if len(table.bad) > MOST_TOLD:
        say(f"{file}: and {len(table.bad) - MOST_TOLD} more like these")
    if not table.profiles:
        raise ConfigurationError("holds no profile that can be read", file=file)
    settings = GrooveSettings(model=MODELS[model], noise=1e-3 * noise_mm)
    readings = list(read_all(table.profiles, settings))
    if json:
        print(dumps({"readings": [to_dict(r) for r in readings], "bad": table.bad}, indent=2))
    else:
        show_readings(readings)
    if plot is not None:
        write_picture(plot, draw_readings(readings))
        say(f"drawn in {plot}")
    if all(reading.refusal is not None for reading in readings):
        sys.exit(1)
