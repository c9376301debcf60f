"""Read what recordings have to show on the page, whichever algorithm made them."""

from __future__ import annotations

from pathlib import Path

from tjscan.core.errors import ConfigurationError
from tjscan.core.registry import TASKS
from tjscan.live.step import RecordedShow, ShowReader


def read_recorded_show(directory: Path) -> RecordedShow:
    """Read what a run directory has to show.

    Parameters
    ----------
    directory : Path
        Of the run, finished or not.

    Raises
    ------
    ConfigurationError
        If it holds no recording that can be shown, or one with nothing in it.
    RecordingError
        If its recording is damaged.
    """
    for task in map(TASKS.load, TASKS.names):
        if not task.live:
            continue
        read: ShowReader = task.load_part("live")
        show = read(directory)
        if show is not None:
            if not show.steps:
                raise ConfigurationError("nothing was recorded in it yet", file=directory)
            return show
    raise ConfigurationError(
        "holds no recording that can be shown: give the directory of a scan, a crawl, a tow or a "
        "calibration, or of one station",
        file=directory,
    )
