"""What a study keeps of one tow."""

from __future__ import annotations

from dataclasses import dataclass

from tjscan.study.row import RunOutcome


@dataclass(frozen=True, slots=True)
class TowOutcome(RunOutcome):
    """Outcome of one tow of a study: the figures of `TowFigures`, None where not known.

    Parameters
    ----------
    complete, reason, detail
        As in `RunOutcome`; complete is a tow that welded the whole seam.
    """

    welded_mm: float | None = None
    seconds: float | None = None
    waited_s: float | None = None
    plan_hz: float | None = None
    real_time_factor: float | None = None
    objective: float | None = None
    objective_max: float | None = None
    constraint: float | None = None
    halts: int | None = None
    asked_mm_s: float | None = None
    bend_deg: float | None = None
    force_mean_n: float | None = None
    force_max_n: float | None = None
    welder_off_mm: float | None = None
    followed_mm: float | None = None
    estimate_deg: float | None = None
    estimate_mm: float | None = None
    link_clearance_mm: float | None = None
    body_clearance_mm: float | None = None
    passer_by_mm: float | None = None
    vehicle_gap_mm: float | None = None
    touches: int | None = None
