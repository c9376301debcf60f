"""``tjscan laser``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from tjscan.cli.options.overrides import JobKeys, parse_overrides


def laser(
    job: Path,
    *overrides: JobKeys,
    profiles: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
    write: Path | None = None,
    json: bool = False,
) -> None:
    """Show what a line laser sees, live, with the groove that is read in it. No arm is needed.

    Of the job file only [laser] and [groove] count. Ctrl-C ends it. Every key of the job file is
    an option too.

    Parameters
    ----------
    job
        The job file (TOML).
    profiles
        How many to take; left out, until interrupted.
    write
        Write the profiles into this new text file, which 'tjscan groove' reads.
    json
        Print a line of JSON for each profile on stdout.
    """
    from contextlib import ExitStack
    from itertools import islice

    from tjscan.cli.output.laser import LiveProfiles, print_description
    from tjscan.runs.laser import open_laser_of_job, open_profile_file, read_live_profiles

    with ExitStack() as stack:
        device, settings = stack.enter_context(open_laser_of_job(job, parse_overrides(overrides)))
        keep = None if write is None else stack.enter_context(open_profile_file(write))
        print_description(device)
        show = stack.enter_context(LiveProfiles(json=json))
        for reading in islice(read_live_profiles(device, settings), profiles):
            show.show_reading(reading)
            if keep is not None:
                keep(reading.profile)
