"""Loaded by every worker process before it runs anything.

Ctrl-C reaches all processes of a terminal: it is for the one that hands out the work. A worker
that has another program than the study is refused when it joins, however late.
"""

from __future__ import annotations

from typing import Any

from distributed import WorkerPlugin

from tjscan.core.signals import ignore_ctrl_c
from tjscan.core.version import program_code


class SameProgram(WorkerPlugin):  # type: ignore[misc]
    """Refuses workers whose program is not the study's, and ends them.

    Parameters
    ----------
    code : str
        Version and source of the study's program.
    """

    name = "tjscan-same-program"

    def __init__(self, code: str) -> None:
        self.code = code

    def setup(self, worker: Any) -> None:
        """Refuse a worker: dask would use one whose plugin fails, so it ends itself."""
        if program_code() != self.code:
            reason = f"this worker has tjscan {program_code()}, the study {self.code}"
            worker.loop.add_callback(worker.close, nanny=True, reason=reason)
            raise RuntimeError(reason)


def dask_setup(worker: Any) -> None:
    """Prepare a worker process of this machine, see the preloads of dask."""
    ignore_ctrl_c()
