"""Learn how a crawler slips, from a shuttle along a joint."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.crawler.journal import CombinedCrawlJournal
from tjscan.crawler.slip_calibration import SlipCalibration, write_slip_calibration
from tjscan.crawler.topics import CRAWL_RECORDING, record_crawl
from tjscan.job.crawl.cell import make_crawl_cell
from tjscan.recording.header import JobSnapshot
from tjscan.recording.parts import next_recording_file
from tjscan.result.directory import CALIBRATION, JOB, job_label_of_run
from tjscan.runs.crawl.run import CrawlContext, check_size, make_crawl_directory, make_crawler

LENGTH: Final = 0.8
"""Metres of the shuttle's way out."""

TIMES: Final = 3


def calibrate_slip(context: CrawlContext, directory: Path) -> SlipCalibration:
    """Shuttle along a joint, and write what was learned of slip into a new run directory.

    Parameters
    ----------
    context : CrawlContext
        Its job's method must be the slip-aware one.
    directory : Path
        To make.

    Raises
    ------
    ConfigurationError
        If the job is wrong.
    VehicleFault, LaserFault
        If the crawler was stopped; there is no calibration then.
    """
    with add_file_to_errors(context.job_file):
        if context.job.method != "slip-aware":
            raise ConfigurationError("the paper's method learns no slip", key="method")
        if context.job.calibration is not None:
            raise ConfigurationError(
                "a calibration begins from nothing: leave this key out", key="calibration"
            )
        check_size(context.job)
        method, cell = context.make_method(), make_crawl_cell(context.job)
        make_crawl_directory(context, directory)
    origin = JobSnapshot((directory / JOB).read_text(encoding="utf-8"))
    file = next_recording_file(directory, CRAWL_RECORDING)
    with record_crawl(file, origin, cell.simulated_place) as recording, cell:
        journal = CombinedCrawlJournal((recording, context.journal))
        make_crawler(context, cell, method, journal).shuttle(LENGTH, TIMES)
    if method.slip is None:
        raise ConfigurationError("this method learns no slip", key="method")
    found = SlipCalibration.from_belief(method.slip, context.job.vehicle.device_id)
    write_slip_calibration(directory / CALIBRATION, found, job_label_of_run(directory))
    return found
