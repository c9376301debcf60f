"""What recording takes of a scan's time."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

from _corpus import EXAMPLES
from _table import Row

from tjscan.job.files import read_scan_job
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.recording import ScanRecordingWriter


class _Timed:
    """A recording, and the seconds that it takes."""

    def __init__(self, recording: ScanRecordingWriter) -> None:
        self._recording, self.seconds = recording, 0.0

    def record(self, message: object) -> None:
        began = perf_counter()
        self._recording.record(message)
        self.seconds += perf_counter() - began


def recording_time(times: int, sections: int) -> Row:
    """Share of a scan's wall time that recording takes, the arm moving in real time."""
    file = EXAMPLES / "paper.toml"
    job = read_scan_job(file, {"scan.sections": sections, "simulation.arm.realtime": True})
    shares = []
    for _ in range(times):
        cell = ScanContext(job, file).make_cell()
        with TemporaryDirectory() as name:
            began = perf_counter()
            with ScanRecordingWriter(Path(name) / "scan.mcap") as recording:
                timed = _Timed(recording)
                scan_in_cell(cell, job, timed)
                ending = perf_counter()
            ended = perf_counter()
        shares.append((timed.seconds + ended - ending) / (ended - began))
    return Row("recording, share of a scan's wall time", 100 * median(shares), 5, "%")
