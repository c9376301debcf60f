"""A loopback controller as a process of its own, for whoever wants one under control."""

from __future__ import annotations

from tjscan.core.errors import ArmNotConnected, ArmNotResponding
from tjscan.core.loopback import LoopbackProgram


class LoopbackProcess(LoopbackProgram):
    """Process with a loopback controller; a context manager that starts and ends it.

    Parameters
    ----------
    host : str
        The address it shall listen on.
    *options : str
        Further options of ``tjscan ur-loopback``.
    """

    ended, silent = ArmNotConnected, ArmNotResponding

    def __init__(self, host: str, *options: str) -> None:
        super().__init__("ur-loopback", "--host", host, *options)
        self.host = host
