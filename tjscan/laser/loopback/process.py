"""A loopback laser as a process of its own, for whoever wants one under control."""

from __future__ import annotations

from tjscan.core.errors import LaserNotConnected, LaserNotResponding
from tjscan.core.loopback import LoopbackProgram


class LaserLoopbackProcess(LoopbackProgram):
    """Process with a loopback laser; a context manager that starts and ends it.

    Parameters
    ----------
    host : str
        The address it shall have.
    *options : str
        Further options of ``tjscan laser-loopback``.
    """

    ended, silent = LaserNotConnected, LaserNotResponding

    def __init__(self, host: str, *options: str) -> None:
        super().__init__("laser-loopback", "--host", host, *options)
        self.host = host
