"""A broker of its own, under control: mosquitto, on this machine alone."""

from __future__ import annotations

import shutil
import socket
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Final, Self

from tjscan.core.errors import ConfigurationError, VehicleLinkLost

START_LIMIT: Final = 20.0
"""Seconds in which a broker starts; a busy machine takes its time."""


def find_mosquitto() -> str | None:
    """Path of the program mosquitto; None if it is not installed."""
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")


class MosquittoProcess:
    """Process of a broker on 127.0.0.1 and a free port; a context manager starts and ends it.

    Parameters
    ----------
    *settings : str
        Further lines of its configuration.
    """

    def __init__(self, *settings: str) -> None:
        self._settings = settings
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port: int = probe.getsockname()[1]

    @property
    def address(self) -> str:
        """``HOST:PORT``."""
        return f"127.0.0.1:{self.port}"

    def __enter__(self) -> Self:
        """Start it, and wait until it listens.

        Raises
        ------
        ConfigurationError
            If mosquitto is not installed.
        VehicleLinkLost
            If it does not start.
        """
        self._directory = tempfile.TemporaryDirectory()
        try:
            self.start()
        except BaseException:
            self._directory.cleanup()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.kill()
        self._directory.cleanup()

    def start(self) -> None:
        """Start it, again on the same port after `kill`; see `__enter__`."""
        program = find_mosquitto()
        if program is None:
            raise ConfigurationError("mosquitto is not installed: sudo apt-get install mosquitto")
        file = Path(self._directory.name) / "mosquitto.conf"
        file.write_text(
            "per_listener_settings true\n"
            f"listener {self.port} 127.0.0.1\n"
            "allow_anonymous true\npersistence false\nset_tcp_nodelay true\n"
            + "\n".join(self._settings),
            encoding="utf-8",
        )
        self._process = subprocess.Popen(
            [program, "-c", str(file)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        until = time.monotonic() + START_LIMIT
        while self._process.poll() is None and time.monotonic() < until:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1.0).close()
            except OSError:
                time.sleep(0.02)
            else:
                return
        self.kill()
        raise VehicleLinkLost(f"mosquitto does not listen on {self.address}")

    def kill(self) -> None:
        """End it as a power cut would."""
        self._process.kill()
        self._process.wait()
