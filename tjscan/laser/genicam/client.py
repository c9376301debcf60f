"""The client library in a process of its own: ``python -m tjscan.laser.genicam.client HANDLE``.

Its calls wait for four seconds and more on a laser that fell silent, one after the other, and so
does its end. Here the main process ends it at any time. When the main process is gone, this one
gives the laser back and ends.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from multiprocessing.connection import Connection

from tjscan.core.process import ClientRequest
from tjscan.core.signals import ignore_ctrl_c
from tjscan.laser.genicam.camera import GenicamClient


def main() -> None:
    """Serve the main process's requests on the connection whose number is the only argument."""
    ignore_ctrl_c()
    client, connection = GenicamClient(), Connection(int(sys.argv[1]))
    with suppress(EOFError, OSError):  # the main process is gone
        while True:
            request: ClientRequest = connection.recv()
            connection.send(request.answered_by(client, client.explain))
    client.close()
    os._exit(0)  # without waiting for the library's threads


if __name__ == "__main__":
    main()
