"""Where a file comes from and what its numbers mean, as every file of a run states it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal, Self

from tjscan.core.version import PROGRAM_VERSION

FRAME_DESCRIPTIONS: Final = {
    "j": "the joint's own: z up the brace's axis, x along the leg, origin where the axes cross",
    "b": "the arm's base",
    "w": "the work area",
    "f": "the arm's flange",
    "c": "the butt joint: x along it from where its weld begins, y to the right, z into the hull",
}
"""What the letters of the frames of results mean."""

CSV_CONTEXT: Final = "http://www.w3.org/ns/csvw"
"""Of the metadata of tables: W3C (2015), Model for Tabular Data and Metadata on the Web."""

METADATA_SUFFIX: Final = "-metadata.json"
"""What the metadata's file has after the table's name."""

LengthUnit = Literal["mm", "m"]


@dataclass(frozen=True, slots=True)
class Provenance:
    """What wrote a file and when, from which job, and the frame and units of its numbers.

    Parameters
    ----------
    program : str
        Name and version of the program.
    written : datetime
        When, in UTC.
    job : str
        File name of the job, and the beginning of the SHA-256 of its resolved text.
    frame : str
        Letter of the frame of its points.
    length : str
        Unit of its lengths: mm or m. Areas and variances are in its squares.
    angle : str
        Unit of its angles.
    """

    program: str
    written: datetime
    job: str
    frame: str
    length: LengthUnit = "mm"
    angle: Literal["deg"] = "deg"

    @classmethod
    def for_file_written_now(cls, job: str, frame: str, length: LengthUnit = "mm") -> Self:
        """Provenance of a file that this program writes now."""
        now = datetime.now(UTC).replace(microsecond=0)
        return cls(f"tjscan {PROGRAM_VERSION}", now, job, frame, length)

    @property
    def header_entries(self) -> dict[str, str]:
        """Names and texts of the entries in the head of a file."""
        meaning = FRAME_DESCRIPTIONS.get(self.frame, "")
        return {
            "program": self.program,
            "written": self.written.isoformat(),
            "job": self.job,
            "frame": self.frame + (meaning and f" ({meaning})"),
            "units": f"{self.length}, {self.angle}",
        }

    def comment_lines(self, mark: str) -> str:
        """The entries as comment lines for the head of a file, each beginning with a mark."""
        return "".join(
            f"{mark} {name}: {' '.join(text.split())}\n"
            for name, text in self.header_entries.items()
        )

    def write_table(self, file: Path, text: str) -> None:
        """Write a table, CSV text, and beside it where it comes from.

        The table alone is in its file, so that any program opens it; the rest is in
        ``NAME-metadata.json``, as the W3C's model for tabular data has it.
        """
        file.write_text(text, encoding="utf-8", newline="")
        metadata = {"@context": CSV_CONTEXT, "url": file.name, "notes": [self.header_entries]}
        beside = file.with_name(f"{file.name}{METADATA_SUFFIX}")
        beside.write_text(json.dumps(metadata, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def from_comment_lines(cls, text: str, mark: str) -> Self | None:
        """Read the provenance from the comment lines of a file; None if they are not there."""
        found: dict[str, str] = {}
        for line in text.splitlines():
            name, colon, value = line.removeprefix(f"{mark} ").partition(": ")
            if line.startswith(f"{mark} ") and colon:
                found.setdefault(name, value)
        try:
            units = found["units"]
            written = datetime.fromisoformat(found["written"])
            frame = found["frame"].split(" ")[0]
        except (KeyError, ValueError):
            return None
        length: LengthUnit = "mm" if units.startswith("mm") else "m"
        return cls(found.get("program", ""), written, found.get("job", ""), frame, length)
