"""``tjscan weld``, ``weld calibrate`` and ``inspect``."""

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


def inspect(run: Path, *, limits: Path, thickness_mm: float, json: bool = False) -> None:
    """Hold the surface of a finished weld against a table of limits.

    The exit code is 3 if a value is beyond a limit. Nothing is said about what a laser can't see,
    or about compliance with a standard.

    Parameters
    ----------
    run
        The run directory of a finished weld, or of a crawl whose passes were planned from looks.
    limits
        The table (TOML), such as ``iso5817-example.toml`` of ``tjscan init``.
    thickness_mm
        Of the thinner part, in millimetres.
    json
        Print the rows as JSON on stdout.
    """
    from tjscan.cli.output.console import print_fields, print_json, print_message
    from tjscan.runs.weld import inspect as inspection
    from tjscan.welding.inspection import WHAT_A_LASER_CANNOT_SEE

    if not thickness_mm > 0:
        raise ConfigurationError("--thickness-mm is more than zero")
    rows = inspection.inspect_run(run, limits, 1e-3 * thickness_mm)
    head = ("imperfection", "worst", "limit", "at / mm", "beyond / mm", "state")
    print_fields(map(inspection.inspection_cells, rows), head)
    print_message(WHAT_A_LASER_CANNOT_SEE)
    if json:
        print_json(inspection.inspection_as_json(rows, simulated=inspection.is_simulated(run)))
    if any(row.state == "beyond" for row in rows):
        raise SystemExit(3)


def calibrate(plate: Path, *, json: bool = False) -> None:
    """Fit the bead model to beads on a plate: width, contact angles, deposition, torch offset.

    Prints the table [weld.bead] for a weld's job.

    Parameters
    ----------
    plate
        The file of the beads and their scan (TOML).
    json
        Print the fit as JSON on stdout.
    """
    from tjscan.cli.output.console import print_json, print_message
    from tjscan.runs.weld.plate import bead_model_as_toml, fit_plate

    fit = fit_plate(plate)
    print_message(bead_model_as_toml(fit))
    if json:
        print_json(fit)
