"""Commands that run whole simulations: studies and chains."""

from __future__ import annotations

import os
from pathlib import Path

from tjscan.cli.output.console import print_message, show_phase
from tjscan.core.errors import ConfigurationError
from tjscan.result.directory import default_run_directory


def study(
    study: Path,
    *,
    out: Path | None = None,
    resume: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    dry_run: bool = False,
    json: bool = False,
) -> None:
    """Run many simulated scans or crawls and write them in one table.

    Parameters
    ----------
    study
        The study file (TOML); with --resume the study's directory to go on in.
    out
        The directory to make; ``runs/STUDY-DATE`` if left out.
    resume
        Go on with a study that was interrupted; runs that are done are not made again.
    workers
        Processes on this machine; as many as it has cores if left out.
    scheduler
        Address of a dask scheduler to run on instead, for instance tcp://10.0.0.5:8786.
    dry_run
        Resolve and check every run, print how many there are, and make none.
    json
        Print how the runs ended as JSON on stdout.
    """
    from tjscan.cli.output.study import print_study_outcome, study_progress_bar
    from tjscan.runs.tasks import study_backend_of_task
    from tjscan.study.plan import plan_study
    from tjscan.study.run import make_study_directory, read_study, run_study
    from tjscan.study.schedule import DaskScheduler, check_study_packages

    if resume and (out is not None or dry_run):
        raise ConfigurationError("--resume goes on in a study's directory: no --out, no --dry-run")
    if workers is not None and (workers < 1 or scheduler is not None):
        raise ConfigurationError("--workers is 1 or more, and not beside --scheduler")
    directory = study if resume else out or default_run_directory(study)
    if resume:
        plan, _ = read_study(directory, study_backend_of_task)
    else:
        with show_phase("checking the study's runs"):
            plan = plan_study(study, study_backend_of_task)
    if dry_run:
        checked = len(set(plan.checked_indices))
        rest = "" if checked == len(plan) else f"; {checked} were checked, the rest where they run"
        print_message(f"{study}: the study is sound; it makes {len(plan)} runs{rest}")
        return
    check_study_packages()
    if not resume:
        make_study_directory(directory, plan)
    if scheduler is not None and not scheduler.startswith("tls://"):
        print_message(
            f"anyone who reaches {scheduler} runs programs on its workers: docs/study.md shows TLS"
        )
    where = DaskScheduler(workers or os.cpu_count() or 1, scheduler)
    with study_progress_bar(len(plan)) as watch:
        rows = run_study(directory, where, watch, study_backend_of_task)
    print_study_outcome(rows, directory, json=json)


def chain(
    chain: Path,
    *,
    arm: bool = True,
    sources: bool = True,
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Calibrate, scan, stitch and compare in simulation, and show where the error comes from.

    Parameters
    ----------
    chain
        The chain's file (TOML): the two jobs of a simulated cell and what it errs by.
    arm
        Calibrate the arm with the sensor.
    sources
        Run the chain again with each source of error alone, and with none.
    out
        The directory to make; ``runs/CHAIN-DATE`` if left out.
    json
        Print the table as JSON on stdout.
    """
    from tjscan.cli.output.study import error_source_line, print_error_sources
    from tjscan.report.write import write_run_report
    from tjscan.result.directory import CALIBRATION_FILE
    from tjscan.runs.chain import CALIBRATION_RUN_FOLDER, read_chain_file, run_error_sources

    read = read_chain_file(chain)
    directory = out or default_run_directory(chain)
    rows = []
    for row in run_error_sources(read, directory, arm=arm, begin=print_message, alone=sources):
        rows.append(row)
        print_message(error_source_line(row))
        calibration = row.directory / CALIBRATION_RUN_FOLDER
        if (calibration / CALIBRATION_FILE).exists():
            print_message(f"  its calibration on a page: {write_run_report(calibration)}")
    print_error_sources(rows, json=json)
