"""When a scan is done, and what it found."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tjscan.scanning.events import RetryCounts
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection, Sections


class StopReason(StrEnum):
    """Why a scan ended."""

    LENGTH = "length reached"
    SECTIONS = "number of sections reached"
    CLOSED = "back at the first section"
    UNREACHABLE = "next pose out of reach"
    LOST = "groove not found"
    REFUSED = "next set-point refused"
    REQUESTED = "stop requested"
    CUT = "recording ends"


def groove_length(sections: Sections) -> float:
    """Length of the chain of groove origins, metres."""
    origins = np.array([scan.T_b_g[:3, 3] for scan in sections])
    return float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())


def step_lengths(sections: Sections) -> list[float]:
    """Distances in metres between the groove origins of the steps that were not taught."""
    origins = np.array([scan.T_b_g[:3, 3] for scan in sections[1:]])
    lengths: list[float] = np.linalg.norm(np.diff(origins, axis=0), axis=1).tolist()
    return lengths


def plan_is_fulfilled(stop: StopReason, plan: ScanPlan) -> bool:
    """Whether a scan did what it was asked to.

    Parameters
    ----------
    stop : StopReason
        Why it ended.
    plan : ScanPlan
        What was asked.
    """
    if stop is StopReason.UNREACHABLE:
        return plan.length is None and plan.sections is None
    return stop in (StopReason.LENGTH, StopReason.SECTIONS, StopReason.CLOSED)


def reason_to_stop(plan: ScanPlan, sections: Sections, step: float) -> StopReason | None:
    """Reason why the scan is done; None while there is more to do.

    Parameters
    ----------
    plan : ScanPlan
        What was asked.
    sections : sequence of ScannedSection
        The sections so far, the two taught ones first.
    step : float
        Length of the step that would follow, metres.

    Notes
    -----
    The length counts from the second taught section, where the scan starts to find its own
    way, and is reached at the step that comes nearest to it. The joint is closed when the scan,
    having left the first section behind, is less than a step from it, before it or past it.
    """
    if plan.length is not None and plan.length - groove_length(sections[1:]) < step / 2:
        return StopReason.LENGTH
    if plan.sections is not None and len(sections) >= plan.sections:
        return StopReason.SECTIONS
    origins = np.array([scan.T_b_g[:3, 3] for scan in sections])
    from_first = np.linalg.norm(origins - origins[0], axis=1)
    if from_first[-1] < step and from_first.max() > 2 * step:
        return StopReason.CLOSED
    return None


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
