"""The places that a joint is scanned from."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from tjscan.job.fields import PoseTable


class NamedPoseTable(PoseTable):
    """The pose of a station's base, in frame w. Its name is one of a folder, too."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]


class StationTable(NamedPoseTable):
    """A place that is scanned from: where the arm's base stands in frame w, about, and its start.

    What it leaves out holds as in [scan].
    """

    direction: Literal["counterclockwise", "clockwise"] | None = None
    length_mm: float | None = Field(default=None, gt=0)
    sections: int | None = Field(default=None, ge=3)
    first: PoseTable
    second: PoseTable


def folded(name: str) -> str:
    """A name as folders of some systems, and options, have it."""
    return name.casefold().replace("-", "_")
