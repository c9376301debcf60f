"""The centre of a joint as Kermorgant (2018, section 3.2) reads it: for the paper's method.

The profile is smoothed; a line on the hull is fitted to more and more points from either end,
until the next ones are outliers time after time: the last inlier is the edge. The centre is the
barycentre of the closed polygon between the edges. The paper prints no numbers; those here suit
its sensor.
"""

from __future__ import annotations

from math import atan2, hypot
from typing import Final

import numpy as np
import scipy  # its parts are loaded at first use

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.core.robust import mad_sigma, tukey_weights
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.crawler.paper_method import READING_SIGMA
from tjscan.laser.profile import Profile

FILTER_POINTS, FILTER_DEGREE = 11, 2
"""Points and degree of the Savitzky-Golay filter (the paper's [25])."""

FIRST_LINE_POINTS: Final = 20
"""Points at an end that the first line is fitted to."""

LINE_REFITS: Final = 5
"""Reweighted fits of that line."""

OUTLIER_SIGMAS: Final = 4.0
"""Standard deviations from the line beyond which a point is an outlier."""

LEAST_SIGMA: Final = 0.02e-3
"""Least standard deviation that this rests on, in metres: smoothed points are near their line."""

OUTLIERS_ENDING_HULL: Final = 6
"""Outliers one after the other that end the hull."""

LEAST_POLYGON_AREA: Final = 1e-6
"""Area of the smallest polygon with a barycentre, in m²."""


class PaperJointReader:
    """A `JointReader` that takes the barycentre of each profile, whatever was read before."""

    def read(self, profile: Profile, travel: float) -> JointPlacement:
        """Find the joint in a profile; see `JointReader.read`."""
        edges, barycentre = read_joint_as_paper(profile)
        (left, low), (right, high) = edges.tolist()
        return JointPlacement(
            centre=float(barycentre[0]),
            hull_z=(low + high) / 2,
            roll=-atan2(high - low, right - left),
            centre_sigma=READING_SIGMA,
        )


def read_joint_as_paper(profile: Profile) -> tuple[Array, Array]:
    """Read edges and barycentre off a profile, in frame s.

    Parameters
    ----------
    profile : Profile
        Its points run along x_s, either way.

    Returns
    -------
    edges : ndarray, shape (2, 2)
        x_s and z_s of the edge at low and of that at high x_s, in metres.
    barycentre : ndarray, shape (2,)
        x_s and z_s, in metres.

    Raises
    ------
    GrooveNotFound
        If a line from either end meets no edge, or nothing is between the edges.
    """
    valid = profile.valid
    x, z = profile.x_s[valid], profile.z_s[valid]
    points = np.column_stack((x, z))
    if len(x) < 2 * FIRST_LINE_POINTS + FILTER_POINTS:
        raise GrooveNotFound("too few points", f"{len(x)} columns hold a point", points)
    if x[0] > x[-1]:
        x, z = x[::-1], z[::-1]
    z = scipy.signal.savgol_filter(z, FILTER_POINTS, FILTER_DEGREE)
    first, last = _last_inlier(x, z), len(x) - 1 - _last_inlier(x[::-1], z[::-1])
    if not first < last:
        raise GrooveNotFound("no bevel", "the hull goes on from end to end", points)
    polygon = np.column_stack((x, z))[first : last + 1]
    return polygon[[0, -1]], polygon_barycentre(polygon)


def polygon_barycentre(polygon: Array) -> Array:
    """Barycentre of a closed polygon, shape (n, 2), by Green's theorem.

    Raises
    ------
    GrooveNotFound
        If it has no area.
    """
    origin = polygon[0]
    x, z = (polygon - origin).T
    u, w = np.roll(x, -1), np.roll(z, -1)
    cross = x * w - u * z
    double = float(cross.sum())
    if abs(double) < 2 * LEAST_POLYGON_AREA:
        raise GrooveNotFound("no bevel", "nothing is between the edges", polygon)
    return np.asarray(origin + np.array(((x + u) @ cross, (z + w) @ cross)) / (3 * double))


def _last_inlier(x: Array, z: Array) -> int:
    """Number of the last point on the line that begins at the first one."""
    # Far coordinates make sums of squares useless.
    x, z = x - x[0], z - z[0]
    slope, height, sigma = _first_line(x[:FIRST_LINE_POINTS], z[:FIRST_LINE_POINTS])
    on = np.abs(
        z[:FIRST_LINE_POINTS] - height - slope * x[:FIRST_LINE_POINTS]
    ) < OUTLIER_SIGMAS * sigma * hypot(1.0, slope)
    a, b = x[:FIRST_LINE_POINTS][on], z[:FIRST_LINE_POINTS][on]
    n, sx, sz, sxx, sxz = float(len(a)), a.sum(), b.sum(), a @ a, a @ b
    last, missed = FIRST_LINE_POINTS - 1, 0
    for k, (u, w) in enumerate(
        zip(x[FIRST_LINE_POINTS:].tolist(), z[FIRST_LINE_POINTS:].tolist(), strict=True),
        FIRST_LINE_POINTS,
    ):
        if abs(w - height - slope * u) > OUTLIER_SIGMAS * sigma * hypot(1.0, slope):
            missed += 1
            if missed == OUTLIERS_ENDING_HULL:
                break
            continue
        last, missed = k, 0
        n, sx, sz, sxx, sxz = n + 1, sx + u, sz + w, sxx + u * u, sxz + u * w
        slope = (n * sxz - sx * sz) / (n * sxx - sx * sx)
        height = (sz - slope * sx) / n
    return last


def _first_line(x: Array, z: Array) -> tuple[float, float, float]:
    """Slope, height and robust standard deviation of the points about a line."""
    weight = np.ones_like(x)
    for _ in range(LINE_REFITS):
        slope, height = np.polyfit(x, z, 1, w=np.sqrt(weight)).tolist()
        away = z - height - slope * x
        sigma = max(mad_sigma(away), LEAST_SIGMA)
        weight = tukey_weights(away / sigma, least=1e-6)
    return slope, height, sigma
