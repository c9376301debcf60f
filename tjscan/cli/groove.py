"""``tjscan groove``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tjscan.cli.options.groove import GrooveReadingOptions, ProfileFileOptions

if TYPE_CHECKING:
    from tjscan.laser.files.format import FileProfiles


def groove(
    file: Path,
    *,
    form: ProfileFileOptions | None = None,
    reading: GrooveReadingOptions | None = None,
    plot: Path | None = None,
    corners: bool = False,
    json: bool = False,
) -> None:
    """Read the groove in recorded profiles: corners and measures, each with its uncertainty.

    Each profile is read by itself; a scan also knows the sections before.

    The options of the reading are the keys of a job's [groove] table. What is left out is as in
    the job of a run directory, and as in that table's defaults elsewhere.

    Parameters
    ----------
    file
        Text with columns x and z or a profile per row, NPY, PLY, a Gocator's exported
        recording, a folder of such files, or a run directory.
    plot
        Draw the profiles with their fits into this PNG.
    corners
        Print the corners, x and z in the sensor's frame, in place of the measures.
    json
        Print the readings as JSON on stdout.
    """
    from tjscan.cli.output.console import show_phase

    with show_phase("reading the groove"):
        from tjscan.cli.options.groove import groove_settings_for_file
        from tjscan.cli.output.groove import (
            check_plot_path,
            draw_readings_png,
            print_readings,
            suggest_height_sign,
        )
        from tjscan.result.readings import measure_grooves

        check_plot_path(plot)
        settings = groove_settings_for_file(file, reading)
        table = _read_profiles(file, form)
        readings = list(measure_grooves(table.profiles, settings))
    print_readings(readings, table.bad, corners=corners, json=json)
    if plot is not None:
        with show_phase("drawing the profiles"):
            draw_readings_png(plot, readings, settings)
    if all(reading.refusal is not None for reading in readings):
        suggest_height_sign(table.profiles, settings)
        raise SystemExit(1)


def _read_profiles(file: Path, options: ProfileFileOptions | None) -> FileProfiles:
    """Read the profiles of a file, folder or run directory; prints what of it can't be read.

    Raises
    ------
    ConfigurationError
        If there are none.
    """
    from tjscan.cli.output.console import print_message
    from tjscan.cli.output.groove import print_bad_rows
    from tjscan.core.errors import ConfigurationError
    from tjscan.laser.files.format import FileProfiles
    from tjscan.laser.files.read import read_profiles
    from tjscan.result.directory import JOB_FILE
    from tjscan.scanning.reader import load_profiles_of_run as read_recorded

    o = options or ProfileFileOptions()
    is_run = (file / JOB_FILE).is_file()
    table = FileProfiles(read_recorded(file)) if is_run else read_profiles(file, o.profile_format)
    print_bad_rows(file, table.bad)
    for note in table.notes:
        print_message(f"{file}: {note}")
    if not table.profiles:
        raise ConfigurationError("holds no profile that can be read", file=file)
    return table
