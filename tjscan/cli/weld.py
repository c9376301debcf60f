"""``tjscan weld``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tjscan.cli.options.shared import JobKeys, parse_overrides
from tjscan.core.errors import ConfigurationError
from tjscan.result.directory import JOB_FILE, default_run_directory


def weld(
    job: Path,
    *overrides: JobKeys,
    out: Path | None = None,
    arc: bool = False,
    looks: Literal["pass", "layer", "cap", "none"] = "pass",
    resume: bool = False,
    json: bool = False,
) -> None:
    """Scan a groove, weld it bead by bead, and look at it in between: simulated arms alone.

    Without --arc nothing is welded: it scans, and plans every bead by the bead model. Ctrl-C puts
    the arc out at once; --resume goes on from there, with an overlap.

    Every key of the job file is an option too: ``--weld.overlap-mm 15``.

    Parameters
    ----------
    job
        The job file (TOML); with --resume the run directory to go on in.
    out
        The run directory to make; ``runs/JOB-DATE`` if left out.
    arc
        Let the arc burn. It holds for this command alone.
    looks
        When to look, and to plan again: after each pass, before each layer, before the last layer
        alone, or never.
    resume
        Go on with a weld that was stopped, or with a dry run.
    json
        Print the log as JSON on stdout.
    """
    from tjscan.job.weld import read_weld_job

    file = job / JOB_FILE if resume else job
    if resume and not file.is_file():
        raise ConfigurationError("holds no weld: give the run directory of one", file=job)
    keys = parse_overrides(overrides)
    parsed = read_weld_job(file, keys)
    if resume and (out is not None or keys):
        raise ConfigurationError("--resume goes on with the job of the run: no --out, no keys")
    from tjscan.cli.output.weld import print_weld_log, watch_weld
    from tjscan.runs.weld.run import LookSchedule, resume_weld, run_weld

    directory = file.parent if resume else out or default_run_directory(file)
    with watch_weld(parsed, file) as context:
        if resume:
            resume_weld(context, arc=arc, looks=LookSchedule(looks))
        else:
            run_weld(context, directory, arc=arc, looks=LookSchedule(looks))
    print_weld_log(directory, json=json)
