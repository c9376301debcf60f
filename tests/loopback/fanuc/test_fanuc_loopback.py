"""A loopback FANUC controller has its port before it says that it is ready."""

from __future__ import annotations

import socket

import pytest
from command import tjscan
from ur_cell import address

from tjscan_loopback.fanuc.serve import StreamServer


def test_an_address_that_another_has_is_refused_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    host = address()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((host, StreamServer.port))
        assert tjscan("fanuc-loopback", "--host", host) == 2
    shown = capsys.readouterr()
    assert "ready" not in shown.out
    assert "host" in shown.err
    assert "in use" in shown.err
