"""``tjscan view``."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from tjscan.cli.options.page import PageOptions


def view(*runs: Path, page: PageOptions | None = None) -> None:
    """Show recorded runs in a browser, with a slider; several are shown side by side.

    Parameters
    ----------
    runs
        Run directories, finished or not.
    """
    from tjscan.cli.output.console import print_message, show_phase
    from tjscan.core.errors import ConfigurationError
    from tjscan.core.signals import wait_for_ctrl_c

    if not runs:
        raise ConfigurationError("view takes one run directory or more")
    where = (page or PageOptions()).where
    with show_phase("reading the recordings"):
        from tjscan.live.replay import Replay
        from tjscan.runs.tasks import read_recorded_show

        shows = [read_recorded_show(run) for run in runs]
    with Replay(shows, where).page as shown:
        print_message(f"open {shown.url} in a browser; Ctrl-C ends")
        with suppress(KeyboardInterrupt):
            wait_for_ctrl_c()
