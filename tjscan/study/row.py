"""What a study keeps of one scan."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

from tjscan.study.task import Task, Value, canonical

LOST_WORKER = "WorkerLost"
"""The reason of a row whose process died twice."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What came out of one scan. Lengths in millimetres, angles in degrees; None where unknown.

    Travel, rotation and time run from the second taught pose on.

    Parameters
    ----------
    complete : bool
        Whether the scan did what was asked.
    reason : str
        Why it ended: a stop in words, or the name of an error.
    detail : str
        The same in one sentence.
    sections, scans : int
        Finished sections and profiles taken, the two taught ones included.
    scans_per_section : float
        Profiles per section, of those that no hand taught.
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
    """

    complete: bool
    reason: str
    detail: str
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


@dataclass(frozen=True, slots=True)
class Row:
    """One scan of a study: what was varied, and what came out.

    Parameters
    ----------
    key : str
        Of the task.
    index : int
        Its place in the table.
    inputs : mapping
        What was varied.
    measured : Measured
        What came out.
    path : tuple of tuple of float
        Where the flange went, a point per view: azimuth in degrees and, in millimetres,
        distance from the brace's axis and height along it.
    wall_s : float
        How long it took on the clock of whoever ran it: the one value that differs from run
        to run.
    """

    key: str
    index: int
    inputs: Mapping[str, Value]
    measured: Measured
    path: tuple[tuple[float, float, float], ...] = ()
    wall_s: float = 0.0

    @classmethod
    def failed(cls, task: Task, reason: str, detail: str, wall_s: float = 0.0) -> Self:
        """The row of a scan that did not end by itself."""
        return cls(task.key, task.index, task.inputs, Measured(False, reason, detail), (), wall_s)

    @property
    def timeless(self) -> Row:
        """All of it that is the same in every run."""
        return replace(self, wall_s=0.0)

    def to_json(self) -> str:
        """One line."""
        return canonical(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> Self:
        """What `to_json` wrote.

        Raises
        ------
        ValueError
            If the line is no row, or was cut off.
        """
        try:
            data: dict[str, Any] = json.loads(line)
            if not isinstance(data["key"], str):
                raise ValueError("no row of a study: its key is no word")
            data["measured"] = Measured(**data["measured"])
            data["path"] = tuple((a, r, z) for a, r, z in data["path"])
            return cls(**data)
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"no row of a study: {error}") from None
