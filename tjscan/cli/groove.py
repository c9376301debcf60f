"""``tjscan groove``."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

MOST_TOLD: Final = 5
"""Bad rows that are named one by one."""


def groove(
    file: Path,
    *,
    units: Literal["mm", "um", "m"] | None = None,
    pitch: float | None = None,
    invalid: list[float] | None = None,
    model: Literal["tee", "butt-v", "butt-v-sharp"] | None = None,
    noise_mm: float | None = None,
    minimum_points: int | None = None,
    largest_sigma_mm: float | None = None,
    largest_rms_mm: float | None = None,
    inlier_share: float | None = None,
    plot: Path | None = None,
    json: bool = False,
) -> None:
    """Read the groove in recorded profiles: corners and measures, each with its uncertainty.

    The options of how it is read are the keys of a job's [groove] table. What is left out is as
    in the job of a run directory, and as in that table's defaults elsewhere.

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
        What the groove looks like; tee. The others give corners and no measures.
    noise_mm
        Largest standard deviation of the range that is expected; 0.05.
    minimum_points
        Fewest points of a profile that are worth a search; 80.
    largest_sigma_mm
        Largest standard deviation of a corner that is still an answer; 0.4.
    largest_rms_mm
        Largest deviation of the points from the fitted sides; 0.15.
    inlier_share
        Least share of a side's points that must lie on it; 0.1.
    plot
        Draw the profiles with their fits into this PNG.
    json
        Print the readings as JSON on stdout.
    """
    import sys
    from json import dumps

    from tjscan.cli.console import say, show_readings
    from tjscan.core.config import validate
    from tjscan.core.errors import ConfigurationError
    from tjscan.core.files import atomic_directory
    from tjscan.job import ReadingTable, read_job
    from tjscan.laser.files import ProfileFormat, ProfileTable, read_profiles
    from tjscan.recording.reader import read_run
    from tjscan.result.directory import JOB
    from tjscan.result.picture import draw_readings, write_picture
    from tjscan.result.readings import read_all, to_dict

    if plot is not None and (plot.suffix.lower() != ".png" or not plot.parent.is_dir()):
        raise ConfigurationError("names a .png in a folder that exists", file=plot, key="--plot")
    asked = {
        "model": model,
        "noise_mm": noise_mm,
        "minimum_points": minimum_points,
        "largest_sigma_mm": largest_sigma_mm,
        "largest_rms_mm": largest_rms_mm,
        "inlier_share": inlier_share,
    }
    stated = {key: value for key, value in asked.items() if value is not None}
    job = file / JOB
    own = read_job(job).groove.model_dump() if job.is_file() else {}
    settings = validate(ReadingTable, own | stated).settings
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
    readings = list(read_all(table.profiles, settings))
    if json:
        print(dumps({"readings": [to_dict(r) for r in readings], "bad": table.bad}, indent=2))
    else:
        show_readings(readings)
    if plot is not None:
        with atomic_directory(plot.parent) as draft:
            write_picture(draft / plot.name, draw_readings(readings))
        say(f"drawn in {plot}")
    if all(reading.refusal is not None for reading in readings):
        sys.exit(1)
