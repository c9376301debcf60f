"""When a scan is done."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.scan import Scan


class StopReason(StrEnum):
    """Why a scan ended."""

    LENGTH = "length reached"
    SECTIONS = "number of sections reached"
    CLOSED = "back at the first section"
    UNREACHABLE = "next pose out of reach"
    LOST = "groove not found"


def groove_length(sections: Sequence[Scan]) -> float:
    """Length of the chain of groove origins, metres."""
    origins = np.array([scan.T_b_g[:3, 3] for scan in sections])
    return float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())


def finished(plan: ScanPlan, sections: Sequence[Scan]) -> StopReason | None:
    """Tell why the scan is done, or None while there is more to do.

    Parameters
    ----------
    plan : ScanPlan
        What was asked.
    sections : sequence of Scan
        The sections so far, the two taught ones first.

    Notes
    -----
    The length counts from the second taught section, where the scan starts to find its own
    way, and is reached at the step that comes nearest to it. The joint is closed when the
    first section lies ahead, no more than a step away.
    """
    if plan.length is not None and plan.length - groove_length(sections[1:]) < plan.step / 2:
        return StopReason.LENGTH
    if plan.sections is not None and len(sections) >= plan.sections:
        return StopReason.SECTIONS
    ahead = sections[0].T_b_g[:3, 3] - sections[-1].T_b_g[:3, 3]
    if ahead @ sections[-1].T_b_t[:3, 0] > 0 and np.linalg.norm(ahead) < plan.step:
        return StopReason.CLOSED
    return None
