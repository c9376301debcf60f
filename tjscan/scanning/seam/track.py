"""What the finished sections show of the groove's walls, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.frames import Array, frozen_arrays
from tjscan.scanning.section import ScannedSection

MOST_SECTIONS: Final = 30
"""Sections that are looked back upon: at the shortest steps still half a saddle."""

ARM_REPEATABILITY: Final = 0.05e-3 / np.sqrt(3)
"""Metres, standard deviation on one axis by which an arm misses the pose it reports: assumption,
after the ±0.05 mm that makers state. No section knows of it, yet it outweighs what they state."""

ANGULAR_REPEATABILITY: Final = 1e-4 / np.sqrt(3)
"""Radians about one axis: assumption, the above over half a metre of arm."""

END_SIGMA: Final = 0.15e-3
"""Metres by which p1 and p5 lie off their walls, standard deviation: assumption. The curve that
is fitted between them and p2 or p4 is a parabola, or where that is doubtful a line."""

LEAST_SIGMA: Final = 1e-6
"""Metres and radians: nothing is known better, not even without any noise."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class RecentSections:
    """The last sections, the oldest first, in frame b. n sections; k = 0 brace, 1 leg.

    Parameters
    ----------
    along : ndarray, shape (n,)
        Length of the groove up to each, metres, counted from the last: never above 0.
    origins : ndarray, shape (n, 3)
        Origins of frame g, metres.
    points : ndarray, shape (2, n, 3)
        p2 on the brace's wall, p4 on the leg, metres.
    ends : ndarray, shape (2, n, 3)
        p1 at the end of what was seen of the brace, p5 of the leg, metres.
    tangents : ndarray, shape (2, n, 3)
        Unit vectors in the laser plane along the brace's wall at p2 (down) and along the leg at
        p4 (out).
    shape : ndarray, shape (n, 3)
        Distances of p2 and p4 from the origin along these tangents (metres), groove angle
        (radians): what is left of a section once both tangents are known.
    sigmas : ndarray, shape (6, n)
        Standard deviations of where p2, p4 and p1, p5 lie across their walls (metres), and of
        the directions of both tangents (radians), the arm's repeatability included.
    shape_sigmas : ndarray, shape (n, 3)
        Of `shape`.
    """

    along: Array
    origins: Array
    points: Array
    ends: Array
    tangents: Array
    shape: Array
    sigmas: Array
    shape_sigmas: Array


def recent_section_arrays(sections: Sequence[ScannedSection]) -> RecentSections:
    """Arrays of the last `MOST_SECTIONS` of two or more sections."""
    last = sections[-MOST_SECTIONS:]
    grooves = [scan.groove for scan in last]
    R = np.array([scan.view.T_b_s[:3, :3] for scan in last])
    p = np.array([scan.view.T_b_s[:3, 3] for scan in last])
    ends_s = np.array([g.points_s[[0, 4]] for g in grooves])
    corners_s = np.array([g.points_s[[1, 3]] for g in grooves])
    origins_s = np.array([g.T_s_g[:3, 3] for g in grooves])
    tangents_s = np.array([(g.wall_s, g.leg_s) for g in grooves])
    origins = (R @ origins_s[..., None])[..., 0] + p
    chords = np.linalg.norm(np.diff(origins, axis=0), axis=1)

    # Square to a tangent, in the laser plane.
    normals = tangents_s[..., [2, 0]] * (-1, 1)
    corners = np.array([g.corner_covariances_s[[0, 2]] for g in grooves])
    across = np.einsum("nki,nkij,nkj->nk", normals, corners, normals)
    turned = np.array([np.diag(g.tangent_covariance) for g in grooves])
    lengths = np.sum((corners_s - origins_s[:, None]) * tangents_s, axis=-1)
    # The origin is found along a tangent by both: their noise over the distance between them.
    reached = across.sum(axis=1) + (lengths**2 * turned).sum(axis=1) + ARM_REPEATABILITY**2
    # A corner that is not seen lies somewhere along its tangent.
    along = np.einsum("nki,nkij,nkj->nk", tangents_s[..., [0, 2]], corners, tangents_s[..., [0, 2]])
    absent = np.array([[corner in g.absent for corner in ("p2", "p4")] for g in grooves])
    unseen = np.where(absent, along, 0.0)
    openings = np.array([(g.groove_angle, g.measure_covariance[0, 0]) for g in grooves])
    return RecentSections(
        along=np.concatenate((-chords[::-1].cumsum()[::-1], [0.0])),
        origins=origins,
        points=np.moveaxis(corners_s @ np.swapaxes(R, 1, 2) + p[:, None], 1, 0),
        ends=np.moveaxis(ends_s @ np.swapaxes(R, 1, 2) + p[:, None], 1, 0),
        tangents=np.moveaxis(tangents_s @ np.swapaxes(R, 1, 2), 1, 0),
        shape=np.column_stack((lengths, openings[:, 0])),
        sigmas=np.sqrt(
            np.concatenate(
                (
                    across.T + ARM_REPEATABILITY**2 + LEAST_SIGMA**2,
                    across.T + ARM_REPEATABILITY**2 + END_SIGMA**2,
                    turned.T + ANGULAR_REPEATABILITY**2 + LEAST_SIGMA**2,
                )
            )
        ),
        shape_sigmas=np.sqrt(
            np.column_stack((reached[:, None] + unseen, openings[:, 1])) + LEAST_SIGMA**2
        ),
    )
