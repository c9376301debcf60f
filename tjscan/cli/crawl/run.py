"""``tjscan crawl run``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tjscan.cli.options.page import LiveCrawlOptions


def run(
    job: Path,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    out: Path | None = None,
    method: str | None = None,
    calibration: Path | None = None,
    resume: bool = False,
    overlap: float = 20.0,
    place: float | None = None,
    json: bool = False,
    page: LiveCrawlOptions | None = None,
) -> None:
    """Align with a joint and weld every pass, as a job file says.

    Ctrl-C stops the crawler at once; --resume goes on from there.

    Every key of the job file is an option too: ``--weld.length-m 2``.

    Parameters
    ----------
    job
        The job file (TOML); with --resume the run directory to go on in.
    out
        The run directory to make; ``runs/JOB-DATE`` where left out.
    method
        How to follow the joint: slip-aware, or paper for that of Kermorgant (2018) as printed.
    calibration
        What ``tjscan crawl calibrate`` learned; that of the job where left out.
    resume
        Go on with a crawl that was stopped.
    overlap
        Millimetres by which the weld then overlaps what was welded before.
    place
        With --resume after the vehicle was moved: where the torch stands now, in millimetres
        along the joint from where the weld begins.
    json
        Print the passes as JSON on stdout.
    """
    from tjscan.cli.options.overrides import parse_overrides
    from tjscan.core.errors import ConfigurationError
    from tjscan.job.crawl.job import read_crawl_job

    keys = parse_overrides(overrides) | ({} if method is None else {"method": method})
    if calibration is not None:
        keys["calibration"] = str(calibration.resolve())
    file = job / "job.toml" if resume else job
    if resume and not file.is_file():
        raise ConfigurationError("holds no crawl: give the run directory of one", file=job)
    parsed = read_crawl_job(file, keys)
    if resume and (out is not None or keys):
        raise ConfigurationError("--resume goes on with the job of the run: no --out, no keys")
    if place is not None and not resume:
        raise ConfigurationError("--place goes with --resume: a new crawl begins at its start")
    if not 0 <= overlap <= 1000:
        raise ConfigurationError("--overlap is 0 to 1000 mm")
    page = page or LiveCrawlOptions()
    page.check()
    if page.wait and resume:
        raise ConfigurationError("--wait goes with a new crawl: --resume knows where it stands")
    # A job with a mistake in it is refused before anything heavy is loaded.
    from tjscan.cli.crawl.output import print_passes, watch_crawl
    from tjscan.runs.crawl.run import resume_crawl, run_crawl
    from tjscan.runs.run import default_run_directory

    directory = file.parent if resume else out or default_run_directory(file)
    with watch_crawl(parsed, file, page) as context:
        if resume:
            resume_crawl(context, 1e-3 * overlap, None if place is None else 1e-3 * place)
        else:
            run_crawl(context, directory)
    print_passes(directory, json=json)
