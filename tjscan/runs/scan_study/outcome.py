"""What a study keeps of one scan."""

from __future__ import annotations

from dataclasses import dataclass, field

from tjscan.study.row import HIDDEN, RunOutcome


@dataclass(frozen=True, slots=True)
class ScanOutcome(RunOutcome):
    """Outcome of one scan of a study. Lengths in millimetres, angles in degrees.

    Travel, rotation and time run from the second taught pose on.

    Parameters
    ----------
    complete, reason, detail
        As in `RunOutcome`.
    sections, scans : int
        Finished sections and profiles taken, the two taught ones included.
    scans_per_section : float
        Profiles per section, of those that were not taught.
    half_steps : int
        How often a section was tried again at half the step.
    groove_length_mm : float
        Of the chain of groove origins.
    step_nominal_mm, step_mean_mm, step_std_mm : float
        The step asked for, and the steps made.
    step_error_percent : float
        Of the mean step, with its sign.
    travel_mm, travel_prediction_mm, travel_correction_mm : float
        Of the flange, in all and of the moves into either kind of view.
    rotation_deg, rotation_prediction_deg, rotation_correction_deg : float
        The same for what it turned.
    motion_time_s : float
        On the arm's clock.
    corner_mean_mm, corner_p95_mm : float
        Distance of p2, p3, p4 from the joint's edges.
    path : tuple of tuple of float
        Where the flange went, a point per view: azimuth in degrees and, in millimetres,
        distance from the brace's axis and height along it. No column of the table.
    """

    sections: int = 0
    scans: int = 0
    scans_per_section: float | None = None
    half_steps: int = 0
    groove_length_mm: float | None = None
    step_nominal_mm: float | None = None
    step_mean_mm: float | None = None
    step_std_mm: float | None = None
    step_error_percent: float | None = None
    travel_mm: float | None = None
    travel_prediction_mm: float | None = None
    travel_correction_mm: float | None = None
    rotation_deg: float | None = None
    rotation_prediction_deg: float | None = None
    rotation_correction_deg: float | None = None
    motion_time_s: float | None = None
    corner_mean_mm: float | None = None
    corner_p95_mm: float | None = None
    path: tuple[tuple[float, float, float], ...] = field(default=(), metadata=HIDDEN)

    def __post_init__(self) -> None:
        # JSON holds lists.
        object.__setattr__(self, "path", tuple((a, r, z) for a, r, z in self.path))
