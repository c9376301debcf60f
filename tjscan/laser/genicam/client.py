"""The client library in a process of its own: ``python -m tjscan.laser.genicam.client HANDLE``.

Its calls wait for four seconds and more on a laser that fell silent, one after the other, and so
does its end. Here they harm nobody: the main process waits as long as it likes, and ends this one.
When the main process is gone, this one gives the laser back and ends.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from multiprocessing.connection import Connection

from tjscan.core.errors import LaserFault
from tjscan.core.signals import ignore_ctrl_c
from tjscan.laser.genicam.camera import GenicamClient
from tjscan.laser.genicam.messages import LaserAnswer, LaserRequest


def serve_main_process(connection: Connection, client: GenicamClient) -> None:
    """Serve the main process's requests until it is gone."""
    while True:
        try:
            request: LaserRequest = connection.recv()
        except (EOFError, OSError):
            return
        try:
            value = getattr(client, request.name)(**request.arguments)
            answer = LaserAnswer(request.number, value)
        except LaserFault as fault:
            answer = LaserAnswer(request.number, fault=fault)
        except Exception as error:  # the library raises what it likes
            answer = LaserAnswer(request.number, fault=client.explain(error))
        with suppress(OSError):  # the main process is gone: the next request finds out
            connection.send(answer)


def main() -> None:
    """Run on the connection whose number is the only argument."""
    ignore_ctrl_c()
    client = GenicamClient()
    serve_main_process(Connection(int(sys.argv[1])), client)
    client.close()
    os._exit(0)  # without waiting for the library's threads


if __name__ == "__main__":
    main()
