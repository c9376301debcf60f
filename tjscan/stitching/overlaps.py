"""Where two stations saw the same stretch of the groove."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import pi
from typing import Final

import numpy as np

from tjscan.core.frames import Array, inverse_pose, transform_points
from tjscan.stitching.stations import StationTubeFit

FULL_TURN: Final = 2 * pi

GAP_IN_STEPS: Final = 1.6
"""Steps between neighbouring sections of which a gap between stations is one, not a step."""


@dataclass(frozen=True, slots=True)
class AzimuthArc:
    """An arc of azimuths, from start to end.

    Parameters
    ----------
    start, end : float
        Radians; the end is beyond the start.
    """

    start: float
    end: float

    @property
    def span_angle(self) -> float:
        """Angle of the arc from start to end, radians."""
        return self.end - self.start

    @property
    def middle_azimuth(self) -> float:
        """Azimuth of the arc's middle, radians, -pi to pi."""
        return float(np.angle(np.exp(0.5j * (self.start + self.end))))

    def offset_from_middle(self, azimuth: Array) -> Array:
        """Angles of azimuths from the arc's middle, -pi to pi."""
        return np.asarray(np.angle(np.exp(1j * (azimuth - 0.5 * (self.start + self.end)))))

    def contains(self, azimuth: Array) -> Array:
        """Whether azimuths lie within the arc."""
        return np.asarray(np.abs(self.offset_from_middle(azimuth)) <= 0.5 * self.span_angle + 1e-9)


@dataclass(frozen=True, slots=True)
class StationOverlap:
    """Two stations and the arc of azimuths that both saw.

    Parameters
    ----------
    first, second : int
        Which stations.
    arc : AzimuthArc
        The azimuth that both saw.
    sections : tuple of (int, int)
        How many sections each has there.
    """

    first: int
    second: int
    arc: AzimuthArc
    sections: tuple[int, int]


def section_azimuths(fit: StationTubeFit) -> Array:
    """Azimuths of a station's sections in their order, without jumps, shape (n,)."""
    T_j_b = inverse_pose(fit.frame.T)
    middle = np.array([scan.points_b[2:4].mean(axis=0) for scan in fit.station.sections])
    x, y, _ = transform_points(T_j_b, middle).T
    return np.unwrap(np.arctan2(y, x))


def arc_of_azimuths(azimuths: Array) -> AzimuthArc:
    """Arc that a station's section azimuths reach over."""
    return AzimuthArc(float(azimuths.min()), float(azimuths.max()))


def find_overlaps(azimuths: Sequence[Array]) -> list[StationOverlap]:
    """Find every arc that two stations share, however short; two stations may share two.

    Parameters
    ----------
    azimuths : sequence of ndarray
        Of each station's sections.
    """
    overlaps = []
    for a, b in combinations(range(len(azimuths)), 2):
        one, other = arc_of_azimuths(azimuths[a]), arc_of_azimuths(azimuths[b])
        for turn in range(-3, 4):
            shift = turn * FULL_TURN
            shared = AzimuthArc(
                max(one.start, other.start + shift), min(one.end, other.end + shift)
            )
            if shared.span_angle > 0:
                count = tuple(int(shared.contains(azimuths[k]).sum()) for k in (a, b))
                overlaps.append(StationOverlap(a, b, shared, (count[0], count[1])))
    return overlaps


def azimuth_coverage(azimuths: Sequence[Array]) -> tuple[float, list[AzimuthArc]]:
    """How much of the full turn stations cover, in radians, and the gaps.

    Neighbouring sections further apart than `GAP_IN_STEPS` usual steps have a gap between them.
    """
    around = np.sort(np.concatenate(azimuths) % FULL_TURN)
    steps = np.diff(np.append(around, around[0] + FULL_TURN))
    usual = float(np.median(np.concatenate([np.abs(np.diff(a)) for a in azimuths])))
    gaps = [AzimuthArc(float(around[k]), float(around[k] + steps[k])) for k in range(len(around))]
    gaps = [gap for gap in gaps if gap.span_angle > GAP_IN_STEPS * usual]
    return FULL_TURN - sum(gap.span_angle for gap in gaps), gaps
