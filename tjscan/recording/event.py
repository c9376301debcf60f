"""An event, as a recording holds it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True, slots=True)
class RecordedEvent:
    """An event, read from a recording.

    Parameters
    ----------
    time : datetime
        When, UTC.
    name, detail : str
        As the journal of the scan, the crawl or the tow was told.
    """

    time: datetime
    name: str
    detail: str
