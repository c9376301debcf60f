"""The commands of ``tjscan tow``."""

from __future__ import annotations

from pathlib import Path

from tjscan.cli.options.shared import JobKeys, LiveOptions, parse_overrides
from tjscan.result.directory import dated_sibling_directory, default_run_directory


def run(
    job: Path,
    *overrides: JobKeys,
    out: Path | None = None,
    method: str | None = None,
    resume: bool = False,
    dry_run: bool = False,
    json: bool = False,
    page: LiveOptions | None = None,
) -> None:
    """Tow a welding cable along a seam as a job states, into a new run directory.

    Every key of the job is an option too: ``--seam.speed-mm-min 330``, ``--vehicles.driver mqtt``.

    Parameters
    ----------
    job
        The job file (TOML); with --resume the run directory of a tow to go on with.
    out
        The directory to make; ``runs/JOB-DATE`` if left out.
    method
        ours, or paper for the problem of Suzuki et al. (2022) as printed.
    resume
        Go on with a tow that was stopped.
    dry_run
        Find out whether the cable can follow along the whole seam; nothing moves. With --json it
        prints the best first shape, too: of a seam of one point, that for given ends.
    json
        Print the figures as JSON on stdout.
    """
    from tjscan.core.errors import ConfigurationError
    from tjscan.job.tow.job import read_tow_job

    keys = parse_overrides(overrides, method=method)
    file = job / "job.toml" if resume else job
    if resume and not file.is_file():
        raise ConfigurationError("holds no tow: give the run directory of one", file=job)
    parsed = read_tow_job(file, keys)
    if resume and (out is not None or keys or dry_run):
        raise ConfigurationError(
            "--resume goes on with the job of the run: no --out, no --dry-run, no keys"
        )
    page = page or LiveOptions()
    page.check_options()
    # A job with a mistake in it is refused before anything heavy is loaded.
    from tjscan.cli.output.tow import print_seam_feasibility, print_tow_key_figures, watch_tow
    from tjscan.runs.tow.run import resume_tow, run_tow

    if dry_run:
        print_seam_feasibility(parsed, file, json=json)
        return
    directory = file.parent if resume else out or default_run_directory(file)
    with watch_tow(parsed, file, page) as context:
        if resume:
            resume_tow(context)
        else:
            run_tow(context, directory)
    print_tow_key_figures(directory, json=json)


def replay(
    run: Path,
    *overrides: JobKeys,
    out: Path | None = None,
    method: str | None = None,
    json: bool = False,
) -> None:
    """Plan a recorded tow again from its poses, into a new run directory; nothing moves.

    The weights of a planner are options: ``--weights.change 5``. The vehicles went where
    they went, so each plan is what this planner would have asked for next.

    Parameters
    ----------
    run
        The run directory of the tow, whole or cut short.
    out
        The directory to make; ``RUN-DATE`` beside the run if left out.
    method
        The planner: ours, or paper; the run's own if left out.
    json
        Print the figures as JSON on stdout.
    """
    from tjscan.cli.output.tow import print_tow_key_figures
    from tjscan.report.write import write_run_report
    from tjscan.runs.tow.run import replay_tow

    directory = out or dated_sibling_directory(run)
    replay_tow(run, parse_overrides(overrides, method=method), directory, write_run_report)
    print_tow_key_figures(directory, json=json)


def identify(run: Path, *, out: Path | None = None, json: bool = False) -> None:
    """Find what cable a tow had, into a file; ``identified`` of a job names it.

    That is its stiffness, its set and the floor's drag, with their uncertainty. The vehicles must
    have reported how hard their wheels push.

    Parameters
    ----------
    run
        The run directory of a tow, whole or cut short.
    out
        The file (TOML) to write; ``cable.toml`` beside the run if left out. It must not exist.
    json
        Print the figures as JSON on stdout.
    """
    from tjscan.cli.output.console import print_fields, print_json
    from tjscan.runs.tow.run import identify_cable_of_run

    file = out or run.parent / "cable.toml"
    found = identify_cable_of_run(run, file)
    if json:
        print_json(found)
    else:
        print_fields([(key, f"{value:.4g}") for key, value in found.items()], title=str(file))
