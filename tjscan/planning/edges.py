"""The groove's four edges as smooth curves through the measured corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.interpolate import splev, splprep

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.groove.measured import MeasuredSection

FEWEST: Final = 4
"""Sections that a cubic needs."""

LEAST_SIGMA: Final = 1e-6
"""Metres: no corner counts as known better."""

CORNERS: Final = ("p3", "p4", "g", "p2")


@dataclass(frozen=True, slots=True, eq=False)
class GrooveEdges:
    """Curves of p3, p4, g and p2 over the length s of the chain of p3.

    Parameters
    ----------
    length : float
        Of the chain, back to its start where the groove closes; metres.
    closed : bool
        Whether the groove closes.
    sections : ndarray, shape (k,)
        Where the measured sections stand, metres.
    area_sigma : ndarray, shape (k,)
        Standard deviation of each section's area as a share of it.
    """

    length: float
    closed: bool
    sections: Array
    area_sigma: Array
    _curves: tuple[Any, ...]

    def corners(self, s: Array) -> Array:
        """p3, p4, g and p2 at lengths (m,), shape (m, 4, 3), metres."""
        return self._evaluate(s, 0)

    def derivatives(self, s: Array) -> Array:
        """Their derivatives by s, shape (m, 4, 3)."""
        return self._evaluate(s, 1)

    def relative_area_sigma(self, s: Array) -> Array:
        """Standard deviation of the area as a share of it, shape (m,); linear between sections."""
        at, sigma = self.sections, self.area_sigma
        return np.asarray(np.interp(s, at, sigma, period=self.length if self.closed else None))

    def _evaluate(self, s: Array, order: int) -> Array:
        if self.closed:
            s = np.mod(s, self.length)
        return np.stack(
            [np.transpose(splev(s, curve, der=order)) for curve in self._curves], axis=1
        )


def fit_groove_edges(sections: Sequence[MeasuredSection], longest_step: float) -> GrooveEdges:
    """Fit smoothing splines to the corners of sections, weighted by their covariance.

    The sum of squared deviations of each edge, in standard deviations of the section's own (not of
    what all sections of a scan share), is one a section: half of what two directions of noise
    leave, so that true shape is rather kept than smoothed away. g, where the lines along wall and
    leg meet, has no covariance of its own: see `_sigmas`.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In their order along the groove.
    longest_step : float
        Sections further apart are refused, metres.

    Raises
    ------
    ConfigurationError
        If there are too few, they stand out of order, one is missing, or a root is open.
    """
    if len(sections) < FEWEST:
        raise ConfigurationError(f"{FEWEST} sections or more are needed", key="sections")
    for section in sections:
        if "open root" in section.conditions:
            raise ConfigurationError(
                f"section {section.index} has an open root; root passes over an opening are not "
                "planned yet",
                key="conditions",
            )
    points = np.array([s.points for s in sections])
    corners = np.stack(
        (points[:, 2], points[:, 3], np.array([s.T_r_g[:3, 3] for s in sections]), points[:, 1]),
        axis=1,
    )
    return fit_edges_to_corners(corners, _sigmas(sections), _area_sigmas(sections), longest_step)


def fit_edges_to_corners(
    corners: Array, sigmas: Array, area_sigma: Array, longest_step: float
) -> GrooveEdges:
    """Fit the edges to corners.

    Parameters
    ----------
    corners : ndarray, shape (k, 4, 3)
        p3, p4, g and p2 of each section, metres.
    sigmas : ndarray, shape (k, 4)
        Their standard deviations, metres.
    area_sigma : ndarray, shape (k,)
        Standard deviation of each area as a share of it.
    longest_step : float
        Metres.

    Raises
    ------
    ConfigurationError
        If the sections stand out of order or one is missing.
    """
    steps = np.diff(corners[:, 0], axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    back = np.sum(steps[1:] * steps[:-1], axis=1) <= 0
    if lengths.min() <= 0 or back.any():
        i = int(np.argmax(back)) + 1 if back.any() else int(np.argmin(lengths))
        raise ConfigurationError(
            f"section number {i + 1} of the table and the one after it stand out of order: the "
            "groove would run back there",
            key="sections",
        )
    gap = float(np.linalg.norm(corners[-1, 0] - corners[0, 0]))
    closed = len(corners) > FEWEST and gap <= 2 * float(np.median(lengths))
    if (lengths > longest_step).any():
        i = int(np.argmax(lengths))
        raise ConfigurationError(
            f"sections number {i + 1} and {i + 2} of the table stand {1e3 * lengths[i]:.0f} mm "
            "apart: one is missing between them, or the key is too small",
            key="sequence.longest_step_mm",
        )
    s = np.concatenate(([0.0], lengths.cumsum()))
    length = float(s[-1]) + (gap if closed else 0.0)
    at = np.append(s, length) if closed else s
    curves = []
    for j in range(4):
        points, sigma = corners[:, j], np.maximum(sigmas[:, j], LEAST_SIGMA)
        if closed:
            points, sigma = np.vstack((points, points[:1])), np.append(sigma, sigma[0])
        # The noise of a corner lies in two directions, its sigma is that of both together.
        weights = np.sqrt(2) / sigma
        curve, _ = splprep(list(points.T), w=weights, u=at, s=len(s), per=closed, quiet=1)
        curves.append(curve)
    return GrooveEdges(length, closed, s, np.asarray(area_sigma), tuple(curves))


def _sigmas(sections: Sequence[MeasuredSection]) -> Array:
    """Standard deviations of p3, p4, g and p2 by what is each section's own, shape (k, 4).

    That of g is not measured: it is at least that of p2 and p4 together, and at least what the
    area's standard deviation allows for, since g moves the area by half its distance from p2 to p4.
    """
    p2, p3, p4 = np.array([section.own_corner_sigmas for section in sections]).T
    lever = np.array([0.5 * np.linalg.norm(s.points[1] - s.points[3]) for s in sections])
    area = np.array([section.sigmas[3] for section in sections])
    return np.stack((p3, p4, np.maximum(np.hypot(p2, p4), area / lever), p2), axis=1)


def _area_sigmas(sections: Sequence[MeasuredSection]) -> Array:
    return np.array([section.sigmas[3] / section.measures[3] for section in sections])
