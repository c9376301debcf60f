"""What a study keeps of one crawl."""

from __future__ import annotations

from dataclasses import dataclass

from tjscan.study.row import RunOutcome


@dataclass(frozen=True, slots=True)
class CrawlOutcome(RunOutcome):
    """Outcome of one crawl of a study. Lengths in millimetres.

    All but the first four are of the last pass in which the arc burned, and None where it never
    did.

    Parameters
    ----------
    complete, reason, detail
        As in `RunOutcome`; complete is a crawl that welded every pass, and what ended another is
        the guard that stopped it.
    passes : int
        How many were begun.
    vehicle_rms_mm, vehicle_p95_mm : float
        True offset of the vehicle from the joint: root mean square, and 95th percentile of its
        amount.
    torch_rms_mm, torch_p95_mm : float
        The same of the torch's true deviation from its path.
    error_rms_mm : float
        Root mean square of the estimated offset's error.
    sigma_mm : float
        Root mean square of what the estimate states as its standard deviation.
    read_percent : float
        Share of the profiles in which the joint was read.
    """

    passes: int = 0
    vehicle_rms_mm: float | None = None
    vehicle_p95_mm: float | None = None
    torch_rms_mm: float | None = None
    torch_p95_mm: float | None = None
    error_rms_mm: float | None = None
    sigma_mm: float | None = None
    read_percent: float | None = None
