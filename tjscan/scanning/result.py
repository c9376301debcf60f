"""What a scan found: when it ended, and when it was interrupted."""

from __future__ import annotations

from dataclasses import dataclass

from tjscan.scanning.events import EventCounts
from tjscan.scanning.progress import StopReason
from tjscan.scanning.section import ScannedSection, View


@dataclass(frozen=True, slots=True, eq=False)
class ScanResult:
    """What a scan found.

    Parameters
    ----------
    sections : tuple of ScannedSection
        The finished sections in order, the two taught ones first.
    views : tuple of View
        Every profile taken, in order.
    stop : StopReason
        Why it ended.
    detail : str
        The same in one sentence, with numbers.
    counts : EventCounts
        How often each kind of retry was made.
    """

    sections: tuple[ScannedSection, ...]
    views: tuple[View, ...]
    stop: StopReason
    detail: str
    counts: EventCounts


@dataclass(frozen=True, slots=True, eq=False)
class InterruptedScan:
    """What an interrupted scan had found.

    Parameters
    ----------
    sections, views : tuple
        As in `ScanResult`.
    counts : EventCounts
        As in `ScanResult`.
    """

    sections: tuple[ScannedSection, ...]
    views: tuple[View, ...]
    counts: EventCounts
