"""The way of a profile through the code, from the capture to the accepted section.

Run from the root of the checkout: ``python .ci/profile_way.py``. It scans the first sections of
`examples/paper.toml` with the simulated devices, recording included, and traces the correction
substep of the fourth section. A call is whatever Python reports as one, generators that go on
included; a change of file is a call that follows a call in another file of `tjscan/`.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Final

import tjscan
from tjscan.job.files import read_scan_job
from tjscan.runs.scan.run import ScanContext, run_scan
from tjscan.scanning.section import ProfileView, ScannedSection, Substep

SOURCE_FOLDER: Final = f"{Path(tjscan.__file__).parent}/"
PAPER_JOB: Final = Path(tjscan.__file__).parents[1] / "examples" / "paper.toml"
TRACED_SECTION: Final = 3
"""Number of the section whose correction substep is traced, from 0."""

FIRST_CALL, NEXT_CALL = "take_view", "_finish_section"
"""Names of the function that the way begins with, and of the one called once it has ended."""


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a function of `tjscan/`: its file, relative to that folder, and its name."""

    file: str
    function: str


@dataclass(frozen=True, slots=True)
class ProfileWay:
    """The calls between the capture of a profile and the accepted section, in order."""

    calls: tuple[Call, ...]

    @property
    def files(self) -> list[str]:
        """The files that take part, in the order of their first calls."""
        return list(dict.fromkeys(call.file for call in self.calls))

    @property
    def file_changes(self) -> int:
        """How many calls follow a call in another file."""
        return sum(before.file != after.file for before, after in pairwise(self.calls))

    @property
    def functions(self) -> int:
        """How many functions take part."""
        return len(set(self.calls))


class _TracingJournal:
    """Journal that traces calls from the prediction view of a section until it is finished."""

    def __init__(self) -> None:
        self.calls: list[Call] = []

    def record(self, message: object) -> None:
        match message:
            case ProfileView(index=number, substep=Substep.PREDICTION) if number == TRACED_SECTION:
                sys.setprofile(self._note_call)
            case ScannedSection():
                sys.setprofile(None)

    def _note_call(self, frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(SOURCE_FOLDER):
            file = code.co_filename.removeprefix(SOURCE_FOLDER)
            self.calls.append(Call(file, code.co_qualname))


def trace_profile_way() -> ProfileWay:
    """Scan the first sections of the paper's job, and give the way of the traced profile."""
    journal = _TracingJournal()
    job = read_scan_job(PAPER_JOB, {"scan.sections": TRACED_SECTION + 1})
    with tempfile.TemporaryDirectory() as folder:
        try:
            run_scan(ScanContext(job, PAPER_JOB, journal), Path(folder) / "run")
        finally:
            sys.setprofile(None)
    names = [call.function.rpartition(".")[2] for call in journal.calls]
    return ProfileWay(tuple(journal.calls[names.index(FIRST_CALL) : names.index(NEXT_CALL)]))


def main() -> None:
    """Print the way's figures, and its files with their calls."""
    way = trace_profile_way()
    for name, count in (
        ("files", len(way.files)),
        ("changes of file", way.file_changes),
        ("functions", way.functions),
        ("calls", len(way.calls)),
    ):
        print(f"{name:16}{count:6}")
    for file in way.files:
        print(f"  {file:40}{sum(call.file == file for call in way.calls):6}")


if __name__ == "__main__":
    main()
