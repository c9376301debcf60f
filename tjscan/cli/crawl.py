"""The commands of ``tjscan crawl``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cyclopts import Parameter

from tjscan.cli.options.shared import JobKeys, LiveCrawlOptions, parse_overrides
from tjscan.core.errors import ConfigurationError
from tjscan.result.directory import dated_sibling_directory, default_run_directory


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class CrawlResumeOptions:
    """How a crawl that was stopped goes on.

    Parameters
    ----------
    resume
        Go on with a crawl that was stopped.
    overlap
        Millimetres by which the weld then overlaps what was welded before.
    place
        With --resume after the vehicle was moved: where the torch is now, in millimetres along the
        joint from where the weld begins.
    """

    resume: bool = False
    overlap: float = 20.0
    place: float | None = None

    def check_options(self) -> None:
        """Check that the options go together; raises ConfigurationError if not."""
        if self.place is not None and not self.resume:
            raise ConfigurationError("--place goes with --resume: a new crawl begins at its start")
        if not 0 <= self.overlap <= 1000:
            raise ConfigurationError("--overlap is 0 to 1000 mm")


def run(
    job: Path,
    *overrides: JobKeys,
    out: Path | None = None,
    method: str | None = None,
    calibration: Path | None = None,
    again: CrawlResumeOptions | None = None,
    arc: bool = False,
    json: bool = False,
    page: LiveCrawlOptions | None = None,
) -> None:
    """Align with a joint and weld every pass, as a job file states.

    Ctrl-C stops the crawler at once; --resume goes on from there.

    Every key of the job file is an option too: ``--weld.length-m 2``.

    Parameters
    ----------
    job
        The job file (TOML); with --resume the run directory to go on in.
    out
        The run directory to make; ``runs/JOB-DATE`` if left out.
    method
        How to follow the joint: slip-aware, or paper, as Kermorgant (2018) printed it.
    calibration
        File of ``tjscan crawl calibrate``; the one of the job if left out.
    arc
        Let the power source that the job names strike arcs.
    json
        Print the passes as JSON on stdout.
    """
    from tjscan.job.crawl.job import read_crawl_job

    again, page = again or CrawlResumeOptions(), page or LiveCrawlOptions()
    keys = parse_overrides(overrides, method=method)
    if calibration is not None:
        keys["calibration"] = str(calibration.resolve())
    file = job / "job.toml" if again.resume else job
    if again.resume and not file.is_file():
        raise ConfigurationError("holds no crawl: give the run directory of one", file=job)
    parsed = read_crawl_job(file, keys)
    if again.resume and (out is not None or keys):
        raise ConfigurationError("--resume goes on with the job of the run: no --out, no keys")
    again.check_options()
    page.check_options()
    if page.wait and again.resume:
        raise ConfigurationError("--wait goes with a new crawl: --resume knows where it is")
    # A job with a mistake in it is refused before anything heavy is loaded.
    from tjscan.cli.output.crawl import print_passes, watch_crawl
    from tjscan.runs.crawl.run import resume_crawl, run_crawl

    directory = file.parent if again.resume else out or default_run_directory(file)
    with watch_crawl(parsed, file, page, arc=arc) as context:
        if again.resume:
            place = None if again.place is None else 1e-3 * again.place
            resume_crawl(context, 1e-3 * again.overlap, place)
        else:
            run_crawl(context, directory)
    print_passes(directory, json=json)


def calibrate(job: Path, *overrides: JobKeys, out: Path | None = None, json: bool = False) -> None:
    """Shuttle along a joint and learn how the crawler slips; ``calibration`` of a job names it.

    Parameters
    ----------
    job
        The job file (TOML).
    out
        The directory to make; ``runs/JOB-DATE`` if left out.
    json
        Print the calibration as JSON on stdout.
    """
    from tjscan.job.crawl.job import read_crawl_job

    parsed = read_crawl_job(job, parse_overrides(overrides))
    from tjscan.cli.output.crawl import print_slip_calibration, watch_crawl
    from tjscan.runs.crawl.run import calibrate_slip

    directory = out or default_run_directory(job)
    with watch_crawl(parsed, job) as context:
        found = calibrate_slip(context, directory)
    print_slip_calibration(found, directory, json=json)


def register(job: Path, *overrides: JobKeys, out: Path | None = None, json: bool = False) -> None:
    """Find how far the torch is beside the laser's zero; ``torch.aside_mm`` of a job states it.

    The crawler shuttles along a joint, and rests with the torch over it. Jog the torch, by
    millimetres at the terminal, until its wire points at the middle of the joint.

    Parameters
    ----------
    job
        The job file (TOML).
    out
        The directory to make; ``runs/JOB-DATE`` if left out.
    json
        Print the result as JSON on stdout.
    """
    from tjscan.job.crawl.job import read_crawl_job

    parsed = read_crawl_job(job, parse_overrides(overrides))
    from tjscan.cli.output.crawl import print_registration, watch_crawl
    from tjscan.runs.crawl.run import register_torch

    with watch_crawl(parsed, job) as context:
        found = register_torch(context, out or default_run_directory(job))
    print_registration(found, json=json)


def compare(first: Path, second: Path, *, json: bool = False) -> None:
    """Compare the passes of two crawls: deviation, speed, time and stops.

    Parameters
    ----------
    first, second
        Run directories.
    json
        Print both as JSON on stdout.
    """
    from tjscan.cli.output.crawl import print_comparison
    from tjscan.runs.crawl.results import read_passes

    print_comparison({str(place): read_passes(place) for place in (first, second)}, json=json)


def replay(
    run: Path,
    *overrides: JobKeys,
    out: Path | None = None,
    method: str | None = None,
    json: bool = False,
) -> None:
    """Feed a recorded crawl through another estimator, into a new run directory; nothing moves.

    Keys of the job about slip and the joint's course are options: ``--slip.crab-mrad 2``.
    ``tjscan crawl compare RUN OUT`` then shows both.

    Parameters
    ----------
    run
        The run directory of the crawl, whole or cut short.
    out
        The directory to make; ``RUN-DATE`` beside the run if left out.
    method
        The estimator: slip-aware, or paper, as Kermorgant (2018) printed it; the run's own if
        left out.
    json
        Print the passes as JSON on stdout.
    """
    from tjscan.cli.output.crawl import print_passes
    from tjscan.report.write import write_run_report
    from tjscan.runs.crawl.run import replay_crawl

    directory = out or dated_sibling_directory(run)
    replay_crawl(run, parse_overrides(overrides, method=method), directory, write_run_report)
    print_passes(directory, json=json)


def size(job: Path, *overrides: JobKeys, json: bool = False) -> None:
    """Check a crawler's grip, friction, pull, power, peel and the torque of its turns.

    Ends with exit code 3 if a rule is broken.

    Parameters
    ----------
    job
        The job file (TOML); its table [size] holds magnets, masses and motors.
    json
        Print the figures as JSON on stdout.
    """
    from tjscan.cli.output.crawl import print_crawler_sizing
    from tjscan.crawler.sizing import size_crawler
    from tjscan.job.crawl.job import read_crawl_job

    parsed = read_crawl_job(job, parse_overrides(overrides))
    figures = size_crawler(parsed.size, parsed.vehicle.tracks, parsed.steering.least_radius)
    print_crawler_sizing(figures, json=json)
    if not all(figure.holds for figure in figures):
        raise SystemExit(3)
