"""Whoever talks nonsense to the loopback controller is hung up on, and it goes on."""

from __future__ import annotations

import os
import resource
import signal
import socket
import struct
import time
from contextlib import closing, suppress
from pathlib import Path
from random import Random

import pytest
from ur_cell import address

from tjscan.robot.ur.dashboard import DashboardClient
from tjscan_loopback.process import UrLoopbackProcess

PORTS = (29999, 30001, 30002, 30003, 30004)


def nonsense(random: Random) -> bytes:
    """Bytes that are no package, packages that hold nonsense, and scripts without end."""
    kind = random.randrange(4)
    if kind == 0:
        return random.randbytes(random.randrange(1, 4000))
    if kind == 1:  # a whole package of a kind that there is
        payload = random.randbytes(random.randrange(0, 60))
        return struct.pack(">HB", len(payload) + 3, random.choice(b"VvOISPU")) + payload
    if kind == 2:  # outputs, some of them asked for at an impossible rate
        rate = random.choice([0.0, float("nan"), float("inf"), -1.0, 1e-300])
        return struct.pack(">HBd", 11 + 8, ord("O"), rate) + b"actual_q"
    return random.choice([b"def f():\n", b"movej([0,0])\n", b"x = 1/0\n"]) * random.randrange(1, 50)


def test_nonsense_on_every_port_leaves_it_at_work(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine takes its time to hang up on all of them before it answers.
    monkeypatch.setattr("tjscan.robot.ur.dashboard.DASHBOARD_ANSWER_LIMIT", 60.0)
    random = Random(7)
    with UrLoopbackProcess(address(), "--fast") as loopback:
        for _ in range(60):
            for port in PORTS:
                with socket.create_connection((loopback.host, port), 10) as wire, suppress(OSError):
                    for _ in range(random.randrange(1, 4)):
                        wire.sendall(nonsense(random))
        with closing(DashboardClient(loopback.host)) as dashboard:
            assert dashboard.ask_dashboard_value("robotmode") == "RUNNING"
    assert "Traceback" not in capfd.readouterr().err


def test_a_script_without_an_end_is_not_kept_for_ever() -> None:
    with UrLoopbackProcess(address()) as loopback:
        before = _memory(loopback.pid)
        with socket.create_connection((loopback.host, 30003), 10) as wire, suppress(OSError):
            for _ in range(2000):
                wire.sendall(b"def f():\n" + b" " * 100_000)
        loopback.wait_for_line("hung up")
        assert _memory(loopback.pid) - before < 50 << 20


def test_its_clock_catches_up_when_it_was_held_up() -> None:
    held = 0.3
    with UrLoopbackProcess(address()) as loopback:
        before = _clock_behind(loopback.host)
        os.kill(loopback.pid, signal.SIGSTOP)
        time.sleep(held)
        os.kill(loopback.pid, signal.SIGCONT)
        assert _clock_behind(loopback.host) - before < 0.5 * held


def _clock_behind(host: str) -> float:
    """Seconds that the clock is behind this machine's, by the quickest of 300 states."""
    receive = pytest.importorskip("rtde_receive").RTDEReceiveInterface(host)
    behind: dict[float, float] = {}
    while len(behind) < 300:
        shown = receive.getTimestamp()
        behind.setdefault(shown, time.monotonic() - shown)
    receive.disconnect()
    return min(behind.values())


def _memory(pid: int) -> int:
    """Bytes that a process holds."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize()
