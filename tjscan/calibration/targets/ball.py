"""A ball as calibration target: its arcs in profiles, their residuals, and where solving begins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Self

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets import consensus
from tjscan.calibration.targets.line import offsets_from_fitted_line
from tjscan.calibration.targets.target import LinearisedModel, SeenTarget, TargetModel
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, Mask, array_dataclass, pose, readonly_copy, skew_matrix
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.profile import Profile

MIN_ARC_SHARE: Final = 0.15
"""At least this share of a profile's points is on the arc: a ball fills less than a board."""
MIN_ARC_ANGLE: Final = float(np.radians(30.0))
"""Radians; on a shorter arc radius and centre hardly come apart."""
MAX_ARC_RADIUS: Final = 1.0
"""Metres; a larger circle is a straight line."""
FALSE_ARC_PROBABILITY: Final = 1e-6
"""Probability to take a straight line for an arc: most profiles are of straight things."""
START_RADIUS_RATIO: Final = 1.05
"""An unknown ball starts this much larger than its largest arc."""


@array_dataclass
class CircleFit:
    """A circle fitted to the arc of points in a profile, frame s.

    Parameters
    ----------
    centre_s : ndarray, shape (3,)
        y = 0, in metres.
    radius : float
        Metres.
    covariance : ndarray, shape (3, 3)
        Of centre x, centre z and radius, square metres.
    scatter : float
        RMS distance of its points from it, in metres.
    inlier : ndarray of bool, shape (columns,)
        Which columns of the profile are on the arc.
    """

    centre_s: Array
    radius: float
    covariance: Array
    scatter: float
    inlier: Mask

    def by_laser(self, profile: Profile, laser: LaserDeviation) -> Array:
        """Changes of centre x, centre z and radius, metres, shape (3, m).

        Parameters
        ----------
        profile : Profile
            The profile that the circle was fitted to.
        laser : LaserDeviation
            Of m independent draws.
        """
        points = np.column_stack((profile.x_s[self.inlier], profile.z_s[self.inlier]))
        away = points - self.centre_s[[0, 2]]
        away /= np.hypot(*away.T)[:, None]
        outward = np.einsum("na,nam->nm", away, laser.displacements_at(points))
        J = np.column_stack((away, np.ones(len(away))))
        return np.asarray(np.linalg.lstsq(J, outward, rcond=None)[0])


def fit_circle(profile: Profile, noise: NoiseModel) -> CircleFit:
    """Fit the circle that most points of a profile are on.

    Parameters
    ----------
    profile : Profile
        Of a ball.
    noise : NoiseModel
        States the range noise of a point.

    Raises
    ------
    CalibrationRefused
        If too few points are on one circle, or their arc is too short.
    """
    points = consensus.valid_points(profile)
    if len(points) < consensus.MIN_CURVE_POINTS:
        raise CalibrationRefused(
            "no arc seen",
            f"the profile holds {len(points)} points, an arc needs {consensus.MIN_CURVE_POINTS}; "
            "bring the ball into the sensor's range",
        )
    circles = _circles_through(points[consensus.sample_index_sets(len(points), 3)])
    inlier = consensus.find_inliers(points, circles, _distances_from_circles, noise.range)
    if inlier.sum() >= consensus.MIN_CURVE_POINTS:
        inlier = consensus.refit_and_trim(
            lambda m: _distances_from_circle(points, _fit_algebraically(points[m])),
            inlier,
            noise.range,
        )
    if inlier.sum() < max(consensus.MIN_CURVE_POINTS, MIN_ARC_SHARE * len(points)):
        raise CalibrationRefused(
            "no arc seen",
            f"only {inlier.sum()} of {len(points)} points are on one circle within "
            f"{1e3 * consensus.OUTLIER_SIGMAS * consensus.MAX_SCATTER_RATIO * noise.range:.2f} mm; "
            "let the line cross the ball nearer to its middle",
        )
    _check_curvature(points, inlier, noise)
    return _describe_arc(profile, inlier, noise)


def _check_curvature(points: Array, inlier: Mask, noise: NoiseModel) -> None:
    """Refuse points that a straight line explains as well, by the ratio of the likelihoods.

    All points from one end of the arc to the other count, and those that are no part of either
    curve cost the same: an arc that was picked out of a line has left the line's points out.
    """
    at = np.flatnonzero(inlier)
    span = points[at[0] : at[-1] + 1]
    off_circle = _distances_from_circle(span, _fit_algebraically(points[inlier]))
    sigma = consensus.inlier_scatter(off_circle, noise.range)
    straight = consensus.refit_and_trim(
        lambda m: offsets_from_fitted_line(span, m), np.ones(len(span), dtype=bool), sigma
    )
    off_line = offsets_from_fitted_line(span, straight)
    circle_cost, line_cost = (
        np.minimum((off / sigma) ** 2, consensus.OUTLIER_SIGMAS**2).sum()
        for off in (off_circle, off_line)
    )
    # Neighbours err alike: n points count as fewer. The circle has one more unknown.
    gain = (line_cost - circle_cost) / noise.mean_variance_inflation
    if gain < float(chdtri(1, FALSE_ARC_PROBABILITY)):
        raise CalibrationRefused(
            "no arc seen",
            f"{len(span)} points are on a straight line as well as on a circle; let the line cross "
            "the ball nearer to its middle",
        )


def _circles_through(triples: Array) -> Array:
    """Circles (x, z, radius), shape (k, 3), through three points each; none larger."""
    # Circumcentre: both chords from the first point are bisected.
    chord = triples[:, 1:] - triples[:, :1]
    half = 0.5 * np.einsum("kij,kij->ki", chord, chord)
    twice_area = chord[:, 0, 0] * chord[:, 1, 1] - chord[:, 0, 1] * chord[:, 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (half[:, 0] * chord[:, 1, 1] - half[:, 1] * chord[:, 0, 1]) / twice_area
        z = (half[:, 1] * chord[:, 0, 0] - half[:, 0] * chord[:, 1, 0]) / twice_area
    radius = np.hypot(x, z)
    circles = np.column_stack((triples[:, 0] + np.column_stack((x, z)), radius))
    return np.asarray(circles[radius <= MAX_ARC_RADIUS])


def _distances_from_circles(points: Array, circles: Array) -> Array:
    """Signed distances of points, shape (n, 2), from circles, shape (k, 3)."""
    away = np.linalg.norm(points[None] - circles[:, None, :2], axis=2)
    return np.asarray(away - circles[:, 2:])


def _distances_from_circle(points: Array, circle: Array) -> Array:
    """Signed distances of points from a circle (x, z, radius)."""
    return np.asarray(np.hypot(*(points - circle[:2]).T) - circle[2])


def _fit_algebraically(points: Array) -> Array:
    """Circle (x, z, radius) by linear least squares (Kåsa 1976): a start, and quick."""
    middle = points.mean(axis=0)
    p = points - middle
    A = np.column_stack((2 * p, np.ones(len(p))))
    (x, z, c), *_ = np.linalg.lstsq(A, np.einsum("ij,ij->i", p, p), rcond=None)
    return np.array((x + middle[0], z + middle[1], np.sqrt(c + x * x + z * z)))


def _describe_arc(profile: Profile, inlier: Mask, noise: NoiseModel) -> CircleFit:
    kept = consensus.valid_points(profile)[inlier]

    def jacobian(circle: Array) -> Array:
        away = circle[:2] - kept
        return np.column_stack((away / np.hypot(*away.T)[:, None], -np.ones(len(kept))))

    found = least_squares(
        partial(_distances_from_circle, kept), _fit_algebraically(kept), jacobian, method="lm"
    )
    circle = found.x
    # The angle is zero on the sensor's side.
    angle = np.arctan2(kept[:, 0] - circle[0], (kept - circle[:2]) @ -np.array((0.0, 1.0)))
    if circle[2] > MAX_ARC_RADIUS or np.ptp(angle) < MIN_ARC_ANGLE:
        raise CalibrationRefused(
            "no arc seen",
            f"the arc spans {np.degrees(np.ptp(angle)):.0f}° of a circle of "
            f"{1e3 * circle[2]:.1f} mm, too little to fix its centre; "
            f"{np.degrees(MIN_ARC_ANGLE):.0f}° are needed",
        )
    J = jacobian(circle)
    scatter = float(np.sqrt(found.fun @ found.fun / (len(kept) - 3)))
    # Range errors act along z; steep flanks of the ball move less. Taking them as square to the
    # arc everywhere is on the safe side.
    variance = noise.mean_variance_inflation * max(noise.range, scatter) ** 2
    covariance = variance * np.asarray(np.linalg.inv(J.T @ J))
    centre = np.array((circle[0], 0.0, circle[1]))
    return CircleFit(
        centre,
        float(circle[2]),
        covariance,
        scatter,
        consensus.columns_of_points(profile, inlier),
    )


@dataclass(frozen=True, slots=True)
class SphereTarget:
    """A ball that stays at one place, unknown, in frame b.

    Parameters
    ----------
    radius : float, optional
        Metres; None if it is unknown.
    tolerance : float
        Standard deviation of a stated radius, metres. The default is an assumption: that of a
        ball from a bearing, painted matt.
    """

    radius: float | None = None
    tolerance: float = 10e-6

    def __post_init__(self) -> None:
        if self.radius is not None and not 0 < self.radius < np.inf:
            raise ValueError("a sphere's radius is positive and finite")
        if not 0 < self.tolerance < np.inf:
            raise ValueError("a radius has a tolerance, positive and finite")


@dataclass(frozen=True, slots=True, eq=False)
class SphereModel(TargetModel):
    """Residuals of arcs on a ball: its centre against each arc's, and the radius of the arc.

    The target's parameters are the centre in b and how much larger the ball is than stated (than
    nothing, if its radius is unknown); metres.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.
    centres_s : ndarray, shape (n, 3)
        Of the arcs, y = 0.
    radii : ndarray, shape (n,)
        Of the arcs.
    covariances : ndarray, shape (n, 3, 3)
        Of centre x, centre z and radius of each arc.
    sphere : SphereTarget
        The ball.
    noise : NoiseModel
        For the arm's errors.
    by_laser : ndarray, shape (n, 3, m), or None
        `CircleFit.by_laser` of each arc.
    """

    T_b_f: Array
    centres_s: Array
    radii: Array
    covariances: Array
    sphere: SphereTarget
    noise: NoiseModel
    by_laser: Array | None = None

    def at_other_poses(self, T_b_f: Array) -> Self:
        """Return the same arcs, taken from other flange poses, shape (n, 4, 4)."""
        return replace(self, T_b_f=T_b_f)

    def result_fields(self, target: Array, covariance: Array) -> dict[str, Any]:
        """Centre and radius of the ball."""
        radius = (self.sphere.radius or 0.0) + float(target[3])
        return {"centre_b": readonly_copy(target[:3]), "radius": radius}

    @property
    def prior_information(self) -> Array:
        """Of the stated radius; nothing is known of the centre; shape (4, 4)."""
        tolerance = self.sphere.tolerance if self.sphere.radius is not None else np.inf
        return np.diag((0.0, 0.0, 0.0, tolerance**-2))

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """Residuals in metres, k = 3: centre along x_s, along z_s, and the ball's radius.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (4,)
            Centre in b, and the radius less that stated, metres.
        """
        radius = (self.sphere.radius or 0.0) + float(target[3])
        R_b_f, p_b_f = self.T_b_f[:, :3, :3], self.T_b_f[:, :3, 3]
        R, n = T_f_s[:3, :3], len(self.radii)
        centre_f = np.einsum("nji,nj->ni", R_b_f, target[:3] - p_b_f)
        lever_f = centre_f - T_f_s[:3, 3]
        centre_s = lever_f @ R
        # The laser plane cuts the ball |y| from its centre: y² + r² = R².
        slant = np.hypot(centre_s[:, 1], self.radii)
        off_s = centre_s - self.centres_s
        residuals = np.column_stack((off_s[:, 0], off_s[:, 2], slant - radius))
        by_centre = np.zeros((n, 3, 3))
        by_centre[:, 0, 0] = by_centre[:, 1, 2] = 1.0
        by_centre[:, 2, 1] = centre_s[:, 1] / slant
        in_flange = by_centre @ R.T
        by_pose = np.concatenate((-in_flange, in_flange @ skew_matrix(lever_f)), axis=2)
        # An error of the flange's pose moves the ball in f.
        moved_b = in_flange @ R_b_f.transpose(0, 2, 1)
        by_arm = np.concatenate((-moved_b, moved_b @ skew_matrix(target[:3] - p_b_f)), axis=2)
        by_radius = np.zeros((n, 3, 1))
        by_radius[:, 2] = -1.0
        by_target = np.concatenate((moved_b, by_radius), axis=2)

        by_arc = np.zeros((n, 3, 3))
        by_arc[:, 0, 0] = by_arc[:, 1, 1] = -1.0
        by_arc[:, 2, 2] = self.radii / slant
        own = by_arc @ self.covariances @ by_arc.transpose(0, 2, 1)
        by_laser = None if self.by_laser is None else by_arc @ self.by_laser
        return LinearisedModel(residuals, by_pose, by_target, by_arm, own, self.noise, by_laser)


@dataclass(frozen=True, slots=True, eq=False)
class SeenBall(SeenTarget[CircleFit]):
    """Arcs on a ball.

    Parameters
    ----------
    samples : sequence of PosedFit
        The arcs.
    sphere : SphereTarget
        The ball.
    noise : NoiseModel
        Errors of profiles and poses.
    """

    sphere: SphereTarget
    noise: NoiseModel

    @property
    def kind(self) -> str:
        """``sphere of known radius`` or ``sphere of unknown radius``."""
        return f"sphere of {'un' if self.sphere.radius is None else ''}known radius"

    @property
    def model(self) -> SphereModel:
        """Of the arcs; the same for every pose of the sensor."""
        return SphereModel(
            self.T_b_f,
            np.stack([fit.centre_s for fit in self.fits]),
            np.array([fit.radius for fit in self.fits]),
            np.stack([fit.covariance for fit in self.fits]),
            self.sphere,
            self.noise,
            self.by_laser,
        )

    def starts(self) -> list[Array]:
        """One for each way to turn a cube.

        With the rotation given, the sensor's position and the ball's centre follow linearly from
        the arcs' centres.
        """
        model = self.model
        R_b_f, p_b_f = model.T_b_f[:, :3, :3], model.T_b_f[:, :3, 3]
        found = []
        for R in Rotation.create_group("O").as_matrix():
            axes_f = R[:, [0, 2]]  # x_s and z_s in f
            # axis · (R_b_f^T (C - p_b_f) - p_f_s) = centre of the arc along that axis
            by_centre = np.einsum("ia,nji->naj", axes_f, R_b_f)
            by_sensor = -np.broadcast_to(axes_f.T, (len(R_b_f), 2, 3))
            A = np.concatenate((by_centre, by_sensor), axis=2).reshape(-1, 6)
            known = np.einsum("naj,nj->na", by_centre, p_b_f) + model.centres_s[:, [0, 2]]
            x, *_ = np.linalg.lstsq(A, known.ravel(), rcond=None)
            found.append(pose(R, x[3:]))
        return found

    def model_at_sensor_pose(self, T_f_s: Array) -> tuple[SphereModel, Array]:
        """The ball about the centres of all arcs; the largest arc starts an unknown radius."""
        model = self.model
        centres_s = np.column_stack((model.centres_s, np.ones(len(model.radii))))
        centres = np.einsum("nij,nj->ni", (model.T_b_f @ T_f_s)[:, :3], centres_s)
        known = self.sphere.radius is not None
        larger = 0.0 if known else START_RADIUS_RATIO * model.radii.max()
        return model, np.append(centres.mean(axis=0), larger)
