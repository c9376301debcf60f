"""A look at a groove that is partly filled: profiles become a surface over its first sections."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import (
    Array,
    array_dataclass,
    inverse_pose,
    pose,
    transform_points,
    unit_vector,
)
from tjscan.groove.filled import KnownFlanks, read_filled_groove
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.settings import DEFAULT_SETTINGS, GrooveSettings
from tjscan.laser.profile import Profile
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.path import GrooveStations
from tjscan.welding.look import SurfaceLook, heights_over_columns, look_of_heights

POOLED_STEPS: Final = 1.5
"""Steps of a look to either side of a station whose profiles count, by their median: a reflection
that passes for steel in one is elsewhere in the next."""

FLANK_STEP, BEYOND_ENDS = 2e-3, 20e-3
"""Between places at which the bare groove's faces are known, and how far beyond its ends: a laser's
plane is turned against the sections. Metres."""

NEAR_FLANKS: Final = 20
"""Of these places, to either side of where a laser's plane cuts the groove, are its faces taken."""


def interpolate_poses(poses: Sequence[Array], step: float) -> Iterator[Array]:
    """Poses along a way from pose to pose, shape (4, 4) each, with the stated ones among them.

    Parameters
    ----------
    poses : sequence of ndarray, shape (4, 4)
        Two or more.
    step : float
        Between two of them at most, metres.
    """
    for a, b in pairwise(poses):
        count = max(1, int(np.ceil(np.linalg.norm(b[:3, 3] - a[:3, 3]) / step)))
        turn = Slerp((0.0, 1.0), Rotation.from_matrix(np.stack((a[:3, :3], b[:3, :3]))))
        for share in np.arange(count) / count:
            yield pose(turn(share).as_matrix(), (1 - share) * a[:3, 3] + share * b[:3, 3])
    yield poses[-1]


def place_in_sections(stations: GrooveStations, points: Array) -> tuple[Array, Array]:
    """Where points are along a groove, and in its sections.

    Parameters
    ----------
    stations : GrooveStations
        Close to each other.
    points : ndarray, shape (k, 3)
        In their frame, metres.

    Returns
    -------
    s : ndarray, shape (k,)
        Metres; NaN for one before the first station or behind the last.
    places : ndarray, shape (k, 2)
        Across and up, metres.
    """
    away = points[:, None] - stations.origin
    along = np.einsum("kni,ni->kn", away, stations.tangent)
    distance = np.einsum("kni,kni->kn", away, away)
    passes = (along[:, :-1] >= 0) & (along[:, 1:] < 0)
    i = np.where(passes, distance[:, :-1], np.inf).argmin(axis=1)
    k = np.arange(len(points))
    share = along[k, i] / (along[k, i] - along[k, i + 1])
    axes = np.stack((stations.across, stations.up), axis=1)
    ends = [np.einsum("ki,kji->kj", away[k, j], axes[j]) for j in (i, i + 1)]
    s = stations.s[i] + share * (stations.s[i + 1] - stations.s[i])
    places = ends[0] + share[:, None] * (ends[1] - ends[0])
    return np.where(passes.any(axis=1), s, np.nan), places


@array_dataclass
class FlanksAlongGroove:
    """Faces of a bare groove between the sections of its scan.

    Parameters
    ----------
    s : ndarray, shape (m,)
        Along the groove, metres.
    corners : ndarray, shape (m, 4, 3)
        p3, p4, g and p2 there, in the frame r of the scan's results, metres.
    sections : ndarray, shape (k,)
        Where the sections are, metres.
    bends : ndarray, shape (k, 2)
        Of wall and leg in them; see `KnownFlanks`.
    """

    s: Array
    corners: Array
    sections: Array
    bends: Array

    @classmethod
    def of_scan(
        cls, edges: GrooveEdges, sections: Sequence[MeasuredSection], begin: float, end: float
    ) -> FlanksAlongGroove:
        """Those of a scan's sections, from one length along the groove to another."""
        begin, end = begin - BEYOND_ENDS, end + BEYOND_ENDS
        s = np.linspace(begin, end, 1 + round((end - begin) / FLANK_STEP))
        bends = []
        for one in sections:
            # In its plane, as a sensor above it would have it: the leg on the left, z into it.
            p2, p3, p4, g = points = np.vstack((one.points[1:4], one.T_r_g[:3, 3]))
            x_g = one.T_r_g[:3, 0]
            z = (p3 + p4) - (p2 + g)
            z = unit_vector(z - (z @ x_g) * x_g)
            x = unit_vector(p2 - p4 - ((p2 - p4) @ z) * z - ((p2 - p4) @ x_g) * x_g)
            flat = np.vstack((one.points, points[3])) @ np.column_stack((x, z))
            wall, leg = unit_vector(flat[5] - flat[1]), unit_vector(flat[5] - flat[3])
            bends.append(KnownFlanks.of_points(flat[:5], wall, leg).bends)
        at, bent = edges.sections, np.array(bends)
        if edges.closed:  # they go on, turn after turn
            turns = edges.length * np.arange(-1, 3)
            at, bent = (turns[:, None] + at).ravel(), np.tile(bent, (len(turns), 1))
        return cls(s, edges.corners(s), at, bent)

    def known_in(self, T_r_s: Array) -> KnownFlanks:
        """Where the plane of a laser at a pose in r cuts them, in its frame s."""
        corners = transform_points(inverse_pose(T_r_s), self.corners)
        # Of a groove that comes back, the plane cuts the near side alone.
        y = corners[:, 0, 1]
        cuts = np.flatnonzero(y[:-1] * y[1:] <= 0)
        if len(cuts):
            k = cuts[np.linalg.norm(corners[cuts, 0], axis=1).argmin()]
        else:
            k = np.abs(y).argmin()
        near = slice(max(k - NEAR_FLANKS, 0), k + NEAR_FLANKS)
        x, y, z = np.moveaxis(corners[near], 2, 0)
        y = y * np.sign(y[-1] - y[0])
        p3, p4, g, p2 = (
            np.array([np.interp(0.0, y[:, k], values[:, k]) for values in (x, z)]) for k in range(4)
        )
        at = float(np.interp(0.0, y.mean(axis=1), self.s[near]))
        bends = np.array([np.interp(at, self.sections, one) for one in self.bends.T])
        return KnownFlanks(np.array((p2, p3, p4)), unit_vector(g - p2), unit_vector(g - p4), bends)


def read_steel(
    profile: Profile,
    flanks: FlanksAlongGroove,
    T_r_s: Array,
    settings: GrooveSettings = DEFAULT_SETTINGS,
) -> tuple[Array, Array]:
    """Points of a profile on steel.

    Parameters
    ----------
    profile : Profile
    flanks : FlanksAlongGroove
    T_r_s : ndarray, shape (4, 4)
        Pose of the sensor.
    settings : GrooveSettings, optional

    Returns
    -------
    points : ndarray, shape (k, 3)
        In frame r, metres; none if the profile is refused.
    sigmas : ndarray, shape (k,)
        Standard deviation of each along its ray, metres.
    """
    try:
        found = read_filled_groove(profile, flanks.known_in(T_r_s), settings)
    except GrooveNotFound:
        return np.empty((0, 3)), np.empty(0)
    x, z = found.points.T
    return transform_points(T_r_s, np.column_stack((x, np.zeros(len(x)), z))), found.sigmas


def surface_of_profiles(
    stations: GrooveStations,
    profiles: Sequence[tuple[Array, Array]],
    u: Array,
    toes_u: Array,
    step: float,
) -> SurfaceLook:
    """Make a surface of profiles.

    Parameters
    ----------
    stations : GrooveStations
        At which it is wanted.
    profiles : sequence of tuple of ndarray
        As `read_steel` gives them, in the stations' frame.
    u : ndarray, shape (m,)
        Columns, metres.
    toes_u : ndarray, shape (n, 2)
        Of the finished weld at each station.
    step : float
        Between two profiles, metres: farther from any, nothing is known.
    """
    rows = []
    for points, sigmas in profiles:
        s, places = place_in_sections(stations, points)
        known = np.isfinite(s)
        across, up = places[known].T
        rows.append(heights_over_columns(across, (s[known], up, sigmas[known]), u))
    at, heights, noise = np.moveaxis(np.array(rows), 1, 0)
    return look_of_heights(stations.s, (at, heights, noise), u, toes_u, POOLED_STEPS * step)
