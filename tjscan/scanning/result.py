"""What a scan found."""

from __future__ import annotations

from dataclasses import dataclass

from tjscan.scanning.events import RetryCounts
from tjscan.scanning.progress import StopReason
from tjscan.scanning.section import ProfileView, ScannedSection


@dataclass(frozen=True, slots=True, eq=False)
class ScanResult:
    """What a scan found.

    Parameters
    ----------
    sections : tuple of ScannedSection
        The finished sections in order, the two taught ones first.
    views : tuple of ProfileView
        Every profile taken, in order.
    stop : StopReason
        Why it ended.
    detail : str
        The same in one sentence, with numbers.
    counts : RetryCounts
        How often each kind of retry was made.
    """

    sections: tuple[ScannedSection, ...]
    views: tuple[ProfileView, ...]
    stop: StopReason
    detail: str
    counts: RetryCounts
