"""Two tubes that meet, as far as the sections of their seam show.

A few sections do not hold two cylinders: two taught ones give eight numbers for ten. What is
missing is taken from what joints of tubes are like, as a prior, and its doubt is kept.

`RecentSections` holds what the finished sections show of the walls, as arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import log, radians
from typing import Final

import numpy as np

from tjscan.core.frames import Array, cross, unit_vector
from tjscan.core.gaussian_process import Matern52
from tjscan.scanning.section import Sections

MOST_RECENT_SECTIONS: Final = 30
"""Sections that are looked back upon: at the shortest steps still half a saddle."""

ARM_REPEATABILITY: Final = 0.05e-3 / np.sqrt(3)
"""Metres, standard deviation on one axis by which an arm misses the pose it reports: assumption,
after the ±0.05 mm that makers state. No section knows of it, yet it outweighs what they state."""

ANGULAR_REPEATABILITY: Final = 1e-4 / np.sqrt(3)
"""Radians about one axis: assumption, the above over half a metre of arm."""

SIDE_OFF_WALL_SIGMA: Final = 0.15e-3
"""Metres by which p1 and p5 lie off their walls, standard deviation: assumption. The curve that
is fitted between them and p2 or p4 is a parabola, or a line if that is doubtful."""

LEAST_SIGMA: Final = 1e-6
"""Metres and radians: nothing is known better, not even without any noise."""


class RecentSections:
    """The last sections, the oldest first, in frame b. n sections; k = 0 brace, 1 leg.

    Parameters
    ----------
    sections : sequence of ScannedSection
        Two or more; the last `MOST_RECENT_SECTIONS` count.

    Attributes
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
        Standard deviations of where p2, p4 and p1, p5 are across their walls (metres), and of
        the directions of both tangents (radians), the arm's repeatability included.
    shape_sigmas : ndarray, shape (n, 3)
        Of `shape`.
    """

    def __init__(self, sections: Sections) -> None:
        last = sections[-MOST_RECENT_SECTIONS:]
        grooves = [scan.groove for scan in last]
        R = np.array([scan.view.T_b_s[:3, :3] for scan in last])
        p = np.array([scan.view.T_b_s[:3, 3] for scan in last])
        ends_s = np.array([g.points_s[[0, 4]] for g in grooves])
        corners_s = np.array([g.points_s[[1, 3]] for g in grooves])
        origins_s = np.array([g.T_s_g[:3, 3] for g in grooves])
        tangents_s = np.array([(g.wall_s, g.leg_s) for g in grooves])
        self.origins = (R @ origins_s[..., None])[..., 0] + p
        chords = np.linalg.norm(np.diff(self.origins, axis=0), axis=1)
        self.along = np.concatenate((-chords[::-1].cumsum()[::-1], [0.0]))
        self.points, self.ends = (
            np.moveaxis(places_s @ np.swapaxes(R, 1, 2) + p[:, None], 1, 0)
            for places_s in (corners_s, ends_s)
        )
        self.tangents = np.moveaxis(tangents_s @ np.swapaxes(R, 1, 2), 1, 0)

        # Square to a tangent, in the laser plane.
        normals = tangents_s[..., [2, 0]] * (-1, 1)
        corners = np.array([g.corner_covariances_s[[0, 2]] for g in grooves])
        across = np.einsum("nki,nkij,nkj->nk", normals, corners, normals)
        turned = np.array([np.diag(g.tangent_covariance) for g in grooves])
        read = across.T + ARM_REPEATABILITY**2
        tilts = turned.T + ANGULAR_REPEATABILITY**2 + LEAST_SIGMA**2
        lengths = np.sum((corners_s - origins_s[:, None]) * tangents_s, axis=-1)
        # The origin is found along a tangent by both: their noise over the distance between them.
        reached = across.sum(axis=1) + (lengths**2 * turned).sum(axis=1) + ARM_REPEATABILITY**2
        # A corner that is not seen is somewhere along its tangent.
        in_plane = tangents_s[..., [0, 2]]
        along = np.einsum("nki,nkij,nkj->nk", in_plane, corners, in_plane)
        absent = np.array([[corner in g.absent for corner in ("p2", "p4")] for g in grooves])
        unseen = np.where(absent, along, 0.0)
        openings = np.array([(g.groove_angle, g.measure_covariance[0, 0]) for g in grooves])
        self.shape = np.column_stack((lengths, openings[:, 0]))
        variances = np.concatenate((read + LEAST_SIGMA**2, read + SIDE_OFF_WALL_SIGMA**2, tilts))
        self.sigmas = np.sqrt(variances)
        shape_variances = np.column_stack((reached[:, None] + unseen, openings[:, 1]))
        self.shape_sigmas = np.sqrt(shape_variances + LEAST_SIGMA**2)


BRACE_RADIUS_PRIOR: Final = (0.2, 0.7)
"""Median in metres, and standard deviation of the logarithm: braces of some 0.2 to 0.8 m."""
LEG_TO_BRACE_RADIUS_PRIOR: Final = (1.6, 0.4)
"""The leg's radius over the brace's, likewise."""
AXES_LEAN_SIGMA: Final = radians(25)
"""How far the axes are from square, standard deviation."""
AXES_OFFSET_SIGMA: Final = 0.05
"""How far the axes pass each other, as a share of the brace's radius, standard deviation."""
WALL_SHIFT_SIGMA: Final = 3e-3
"""Metres, standard deviation of where a wall is beside p2 or p4 as read."""
WALL_TILT_SIGMA: Final = radians(30)
"""Of its direction beside what the last two sections show, and of the brace's axis beside the
laser plane."""

SECTION_SHAPE_SIGMAS: Final = (4e-3, 4e-3, radians(8))
"""How much the distances of p2 and p4 from the origin, and the opening, vary round a joint."""
SECTION_SHAPE_WAVELENGTH: Final = 0.2
"""Metres along the groove over which they do."""

OUT_OF_ROUND_SIGMA: Final = 0.3e-3
"""Metres by which a wall leaves its cylinder, standard deviation: assumption for rolled tubes,
over the `OUT_OF_ROUND_WAVELENGTH` that cylinders through a few neighbouring sections do not
follow."""
WALL_DIRECTION_SIGMA: Final = radians(0.15)
"""The same of a wall's direction in the section."""
OUT_OF_ROUND_WAVELENGTH: Final = 0.15
"""Metres along the groove over which it does."""

MISREAD_SIGMAS: Final = 5.0
"""Standard deviations from what its neighbours show by which no true reading is off."""
MOST_WEIGHT_REVISIONS: Final = 3
"""How often the rest is asked again."""

LEG_AXIS_START_COUNT: Final = 4
"""Directions of the leg's axis to start from: at the crown nothing shows it beforehand."""
ROUNDS_OF_ALL_STARTS: Final = 4
"""Rounds after which the best of them goes on alone."""
MOST_DESCENT_ROUNDS: Final = 40
CONVERGED_STEP_SHARE: Final = 1e-5
"""Shares of a parameter's prior standard deviation: smaller steps end the search."""
_DIFFERENCE_STEP: Final = 1e-5

_RESIDUAL_SIGMAS: Final = (OUT_OF_ROUND_SIGMA,) * 4 + (WALL_DIRECTION_SIGMA,) * 2

_LEAST_AXIS_COMPONENT: Final = 1e-12
"""Of the tube's axis, where nothing points outwards, a search may pass by."""

# Per tube: shift along the normal, tilts of the normal up and along, turn of the axis, ln(1/r).
_PARAMETER_SCALE: Final = np.array(
    (WALL_SHIFT_SIGMA, WALL_TILT_SIGMA, WALL_TILT_SIGMA, WALL_TILT_SIGMA, BRACE_RADIUS_PRIOR[1])
)
_PRIOR_MASK: Final = np.array((1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0))
"""Parameters with a prior of their own; curvatures have theirs below, the leg's axis has none."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalWalls:
    """Walls of brace and leg beside the last section, by point, normal, axis and curvature.

    A wall is given by its point next to p2 or p4, its normal, its axis and its curvature: this
    stays well defined if the tube is so large, or so little seen, that its middle is anywhere.

    Parameters
    ----------
    feet, normals, across : ndarray, shape (..., 2, 3)
        A point on the wall, the outward normal there, the direction round the tube there.
    curvatures : ndarray, shape (..., 2)
        One over the radius, 1/m.
    """

    feet: Array
    normals: Array
    across: Array
    curvatures: Array

    def offsets_and_slopes(self, points: Array, tangents: Array) -> tuple[Array, Array]:
        """How far points lie outside their walls, and how tangents lead out of them.

        Parameters
        ----------
        points, tangents : ndarray, shape (..., 2, n, 3)
            On brace and leg; metres, and unit vectors.

        Returns
        -------
        distances, slopes : ndarray, shape (..., 2, n)
            Metres, and sines of the angle between tangent and wall.
        """
        # Rows: out of the wall, and round it.
        local = np.stack((self.normals, self.across), axis=-1)
        q = points @ local - (self.feet[..., None, :] @ local)
        t = tangents @ local
        h, c, k = q[..., 0], q[..., 1], self.curvatures[..., None]
        # sqrt((h + r)² + c²) - r, without the difference of large numbers.
        w = 2 * h + k * (h * h + c * c)
        root = np.sqrt(np.maximum(1 + k * w, _LEAST_AXIS_COMPONENT))
        slopes = ((1 + k * h) * t[..., 0] + k * c * t[..., 1]) / root
        return np.asarray(w / (1 + root)), np.asarray(slopes)


class LocalTubeFit:
    """Fit of both tubes to the recent sections: most likely parameters and their covariance.

    Parameters
    ----------
    track : RecentSections
        The sections.
    sigmas : ndarray, shape (6, n)
        Standard deviations of what they show, as of `RecentSections`.

    Attributes
    ----------
    theta : ndarray, shape (10,)
        The parameters, in units of their prior standard deviations.
    covariance : ndarray, shape (10, 10)
        Of `theta`.
    residuals : ndarray, shape (6, n)
        What the tubes leave of the sections: distances of p2 and p4, of p1 and p5 (metres),
        slopes of both tangents (radians).
    """

    def __init__(self, track: RecentSections, sigmas: Array) -> None:
        # What the parameters count from; rows are the foot, the direction along the tube (about),
        # the one round it, and the normal.
        self._bases, self._along = _wall_bases(track), track.along
        between = track.along[:, None] - track.along
        covariances = [
            Matern52(out, OUT_OF_ROUND_WAVELENGTH)(between) + np.diag(own**2)
            for out, own in zip(_RESIDUAL_SIGMAS, sigmas, strict=True)
        ]
        # Makes residuals white, channel by channel.
        self._whiten = np.array([np.linalg.inv(np.linalg.cholesky(C)) for C in covariances])

        def residuals(thetas: Array) -> Array:
            walls = self.walls(thetas)
            white = np.einsum("cmn,...cn->...cm", self._whiten, _off_tubes(walls, track))
            flat = white.reshape(*thetas.shape[:-1], -1)
            return np.concatenate((flat, _prior_residuals(walls, thetas)), axis=-1)

        self.theta, jacobian = _fit_from_starts(residuals, _initial_parameters())
        spread = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
        # Ten of the prior's and the sections' residuals are spent on the parameters.
        reduced_chi2 = float(np.sum(residuals(self.theta) ** 2)) / (6 * len(track.along) + 1)
        self.covariance = spread * max(1.0, reduced_chi2)
        lefts = _off_tubes(self.walls(with_small_steps(self.theta, _DIFFERENCE_STEP)), track)
        self.residuals = lefts[0]
        self._residual_jacobian = np.moveaxis((lefts[1:] - lefts[0]) / _DIFFERENCE_STEP, 0, -1)

    def walls(self, thetas: Array | None = None) -> LocalWalls:
        """Walls of the fitted tubes, or of other parameters, shape (..., 10)."""
        return _tube_walls(self._bases, self.theta if thetas is None else thetas)

    def seam_curvature(self) -> float:
        """Curvature of the seam beside the last section, 1/m."""
        walls = self.walls()
        n_1, n_2 = walls.normals
        along = cross(n_1, n_2)
        t = unit_vector(along)
        # A normal turns as the tube's curvature and the way round it ask for.
        turns = walls.curvatures * (walls.across @ t)
        d_1, d_2 = turns[:, None] * walls.across
        bent = cross(d_1, n_2) + cross(n_1, d_2)
        return float(np.linalg.norm(bent - (bent @ t) * t) / np.linalg.norm(along))

    def leave_one_out_residuals(self) -> tuple[Array, Array]:
        """Residuals of each section against what the others predict, shape (6, n).

        Also the standard deviations that this should have.
        """
        precision = np.swapaxes(self._whiten, 1, 2) @ self._whiten
        own = np.diagonal(precision, axis1=1, axis2=2)
        return np.einsum("cmn,cn->cm", precision, self.residuals) / own, 1 / np.sqrt(own)

    def expected_residuals_at(self, at: float) -> tuple[Array, Array, Array]:
        """Residuals expected at a place further along the groove, and their uncertainty.

        Returns
        -------
        values, sigmas : ndarray, shape (6,)
            As `residuals`, and how uncertain that is of itself, metres and radians.
        by_theta : ndarray, shape (6, 10)
            Derivatives of the values by `theta`: what is estimated of the tubes and what they
            leave are wrong together.
        """
        kernels = (Matern52(sigma, OUT_OF_ROUND_WAVELENGTH) for sigma in _RESIDUAL_SIGMAS)
        towards = np.array([kernel(self._along - at) for kernel in kernels])
        white = np.einsum("cmn,cn->cm", self._whiten, towards)
        weights = np.einsum("cmn,cm->cn", self._whiten, white)
        variances = np.array(_RESIDUAL_SIGMAS) ** 2 - np.sum(white**2, axis=1)
        return (
            np.sum(weights * self.residuals, axis=1),
            np.sqrt(np.maximum(variances, 0.0)),
            np.einsum("cn,cnp->cp", weights, self._residual_jacobian),
        )


def fit_tubes_to_sections(track: RecentSections) -> LocalTubeFit:
    """Most likely tubes for two or more sections, by Levenberg–Marquardt from several starts.

    Parameters
    ----------
    track : RecentSections
        The sections.

    Notes
    -----
    The sections' distances and slopes from the walls are Gaussian with the sections' own
    variances on the diagonal and, along the groove, the covariance of a smooth random function:
    real tubes are not quite round. What is then far from what its neighbours show was
    misread, and counts for no more than that.
    """
    sigmas = track.sigmas
    seam = LocalTubeFit(track, sigmas)
    for _ in range(MOST_WEIGHT_REVISIONS):
        off, expected = seam.leave_one_out_residuals()
        misread = np.abs(off) > MISREAD_SIGMAS * expected
        if not misread.any():
            break
        sigmas = np.where(misread, np.abs(off), sigmas)
        seam = LocalTubeFit(track, sigmas)
    return seam


def _off_tubes(walls: LocalWalls, track: RecentSections) -> Array:
    # Both of a wall's places at once; the tangents count at the first.
    n = len(track.along)
    distances, slopes = walls.offsets_and_slopes(
        np.concatenate((track.points, track.ends), axis=1),
        np.concatenate((track.tangents, track.tangents), axis=1),
    )
    return np.concatenate((distances[..., :n], distances[..., n:], slopes[..., :n]), axis=-2)


def with_small_steps(values: Array, step: float) -> Array:
    """Values, shape (n,), and below them n times the same with one a step larger: (n + 1, n)."""
    n = len(values)
    return np.asarray(values + np.concatenate((np.zeros((1, n)), step * np.eye(n))))


def _initial_parameters() -> Array:
    starts = np.zeros((LEG_AXIS_START_COUNT, 10))
    starts[:, 4] = -log(BRACE_RADIUS_PRIOR[0]) / _PARAMETER_SCALE[4]
    starts[:, 9] = -log(BRACE_RADIUS_PRIOR[0] * LEG_TO_BRACE_RADIUS_PRIOR[0]) / _PARAMETER_SCALE[4]
    starts[:, 8] = np.pi * np.arange(LEG_AXIS_START_COUNT) / LEG_AXIS_START_COUNT / WALL_TILT_SIGMA
    return starts


def _wall_bases(track: RecentSections) -> Array:
    chord = track.origins[-1] - track.origins[-2]
    down, out = track.tangents[:, -1]
    bases = np.empty((2, 4, 3))
    for k, (along, outward) in enumerate(((down, out), (out, -down))):
        normal = unit_vector(cross(chord, along))
        normal = normal if normal @ outward > 0 else -normal
        bases[k] = track.points[k, -1], along, cross(normal, along), normal
    return bases


def _tube_walls(bases: Array, thetas: Array) -> LocalWalls:
    """Walls of parameters, shape (..., 10)."""
    t = thetas.reshape(*thetas.shape[:-1], 2, 5, 1) * _PARAMETER_SCALE[:, None]
    foot, along, around, normal = (bases[:, i] for i in range(4))
    n = normal + t[..., 1, :] * along + t[..., 2, :] * around
    n = n / np.sqrt((n * n).sum(axis=-1, keepdims=True))
    c = np.cos(t[..., 3, :]) * around - np.sin(t[..., 3, :]) * along
    c = c - (c * n).sum(axis=-1, keepdims=True) * n
    c = c / np.sqrt((c * c).sum(axis=-1, keepdims=True))
    return LocalWalls(foot + t[..., 0, :] * n, n, c, np.exp(t[..., 4, 0]))


def _prior_residuals(walls: LocalWalls, thetas: Array) -> Array:
    """What joints of tubes are like, as residuals, shape (..., 14)."""
    axes = cross(walls.across, walls.normals)
    radii = 1 / walls.curvatures
    middles = walls.feet - walls.normals * radii[..., None]
    common = cross(axes[..., 0, :], axes[..., 1, :])
    sine = np.sqrt(np.sum(common**2, axis=-1) + _LEAST_AXIS_COMPONENT)
    apart = np.sum((middles[..., 0, :] - middles[..., 1, :]) * common, axis=-1) / sine
    shape = (
        np.log(radii[..., 0] / BRACE_RADIUS_PRIOR[0]) / BRACE_RADIUS_PRIOR[1],
        np.log(radii[..., 1] / radii[..., 0] / LEG_TO_BRACE_RADIUS_PRIOR[0])
        / LEG_TO_BRACE_RADIUS_PRIOR[1],
        np.sum(axes[..., 0, :] * axes[..., 1, :], axis=-1) / np.sin(AXES_LEAN_SIGMA),
        apart / (AXES_OFFSET_SIGMA * radii[..., 0]),
    )
    return np.concatenate((thetas * _PRIOR_MASK, np.stack(shape, axis=-1)), axis=-1)


def _fit_from_starts(residuals: Callable[[Array], Array], starts: Array) -> tuple[Array, Array]:
    """Levenberg–Marquardt from several starts side by side, soon from the best one alone.

    Returns
    -------
    theta : ndarray, shape (10,)
        Where it ends.
    jacobian : ndarray, shape (m, 10)
        Of the residuals there.
    """
    beside = with_small_steps(np.zeros(10), _DIFFERENCE_STEP)
    theta, damping = starts, np.full(len(starts), 1e-2)
    values = residuals(theta[:, None] + beside)
    cost = np.sum(values[:, 0] ** 2, axis=-1)
    for i in range(MOST_DESCENT_ROUNDS):
        if i == ROUNDS_OF_ALL_STARTS:
            best = slice(int(cost.argmin()), int(cost.argmin()) + 1)
            theta, damping, values, cost = theta[best], damping[best], values[best], cost[best]
        J = np.swapaxes(values[:, 1:] - values[:, :1], 1, 2) / _DIFFERENCE_STEP
        normal = np.swapaxes(J, 1, 2) @ J + damping[:, None, None] * np.eye(10)
        step = -np.linalg.solve(normal, (values[:, :1] @ J).swapaxes(1, 2))[..., 0]
        tried = residuals((theta + step)[:, None] + beside)
        tried_cost = np.sum(tried[:, 0] ** 2, axis=-1)
        better = tried_cost < cost
        theta = np.where(better[:, None], theta + step, theta)
        values = np.where(better[:, None, None], tried, values)
        cost = np.where(better, tried_cost, cost)
        damping = np.where(better, 0.1 * damping, 10 * damping)
        if i > ROUNDS_OF_ALL_STARTS and np.abs(step).max() < CONVERGED_STEP_SHARE:
            break
    return theta[0], (values[0, 1:] - values[0, 0]).T / _DIFFERENCE_STEP
