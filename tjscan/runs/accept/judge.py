"""What looks at a certified ball say of arm, laser and calibration; nothing moves here.

Looks leave residuals: of each arc's centre along x_s and z_s, and of the ball's radius. What these
may be is stated: noise of each look, and what all looks share, which is where the sensor sits, the
arm's geometry, and the laser's linearity and range bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.linalg import block_diag

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.solve.refine import StackedResiduals, stack_residuals
from tjscan.calibration.targets.ball import CircleFit, SeenBall, SphereTarget, fit_circle
from tjscan.calibration.targets.target import PosedFit, PosedProfile, fit_profiles
from tjscan.core.errors import AcceptanceRefused
from tjscan.core.frames import Array, array_dataclass
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.model import MeasuringRange
from tjscan.robot.arm import ArmState
from tjscan.robot.deviations import deviation_jacobian
from tjscan.robot.kinematics import Kinematics

FAILING_SIGMAS: Final = 3.0
"""A row fails where it is beyond its limit by more standard uncertainties: non-conformity is then
proven, as ISO 14253-1 has it."""

LINEARITY_UNIT: Final = 1e-4
"""Metres: largest deviation of the laser whose draws the residuals are stated for."""

MOST_RANGE_BIAS_SLOPE: Final = 5.0
"""Tangent of the incidence from which the range bias grows no more."""

FEWEST_LOOKS: Final = 8
"""For a row."""

SHAPE_DEGREE: Final = 3
"""Of the polynomial along an arc that is the lens', and no noise."""

EXPECTED_DRAWS: Final = 4000
"""Of returns, whose RP is the one to expect."""

SPEED_SPAN: Final = 0.05
"""Seconds over which the speed at a stop is taken."""

SOLVE_ROUNDS: Final = 4
"""Of Gauss and Newton, from a place that is known to a centimetre."""


Lengths = tuple[float, float, float | None]


@dataclass(frozen=True, slots=True)
class AcceptanceRow:
    """Something that was measured in an acceptance, and what it may be.

    Parameters
    ----------
    key, what : str
        Its name in comparisons, and in words.
    unit : str
        Of the numbers.
    measured, sigma : float
        With its standard uncertainty.
    limit : float or None
        How far from `nominal` it may be; None if it is only compared with earlier ones.
    source : str
        Where the limit comes from.
    nominal : float
        What it should be.
    drift : float or None
        Since an earlier acceptance, in standard uncertainties of the difference.
    """

    key: str
    what: str
    unit: str
    measured: float
    sigma: float
    limit: float | None
    source: str
    nominal: float = 0.0
    drift: float | None = None

    @classmethod
    def of_length(
        cls, key: str, what: str, numbers: Lengths, source: str, nominal: float = 0.0
    ) -> AcceptanceRow:
        """Row of a length, its standard uncertainty and its limit, all in metres."""
        measured, sigma, limit = numbers
        limit = None if limit is None else 1e3 * limit
        return cls(key, what, "mm", 1e3 * measured, 1e3 * sigma, limit, source, 1e3 * nominal)

    @property
    def passes(self) -> bool:
        """Whether it is not proven to be beyond its limit."""
        beyond = abs(self.measured - self.nominal) - FAILING_SIGMAS * self.sigma
        return self.limit is None or bool(beyond <= self.limit)

    @property
    def has_drifted(self) -> bool:
        """Whether it is proven to differ from what it was."""
        return self.drift is not None and abs(self.drift) > FAILING_SIGMAS

    def compared_with(self, earlier: AcceptanceRow) -> AcceptanceRow:
        """The same with its drift; of what has a certificate, against what it certifies."""
        change = (self.measured - self.nominal) - (earlier.measured - earlier.nominal)
        sigma = max(float(np.hypot(self.sigma, earlier.sigma)), np.finfo(float).tiny)
        return replace(self, drift=change / sigma)


@array_dataclass
class StatedErrors:
    """What a job states of its cell's errors, in SI.

    Parameters
    ----------
    kinematics : Kinematics
        Of the arm, as its poses are reported.
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange.
    covariance : ndarray, shape (6 + 6 joints, 6 + 6 joints)
        Of `T_f_s` and of the joints' deviations.
    noise : NoiseModel
        Of range, and of what the arm does not repeat.
    window : MeasuringRange
        Of the laser.
    linearity, range_bias : float
        Of the laser, metres; see `tjscan.job.devices.LaserUncertaintySettings`.
    """

    kinematics: Kinematics
    T_f_s: Array
    covariance: Array
    noise: NoiseModel
    window: MeasuringRange
    linearity: float
    range_bias: float


@dataclass(frozen=True, slots=True, eq=False)
class BallLooks:
    """Arcs on one ball, or on both of a ball bar, and where the balls are taken to be.

    Parameters
    ----------
    arcs : tuple of tuple of PosedFit
        Of each ball.
    profiles : tuple of tuple of PosedProfile
        That they were fitted to.
    stated : StatedErrors
        What they may be off by.
    target : ndarray, shape (4 balls,)
        Centre in b and radius of each ball, metres.
    """

    arcs: tuple[tuple[PosedFit[CircleFit], ...], ...]
    profiles: tuple[tuple[PosedProfile, ...], ...]
    stated: StatedErrors
    target: Array

    @classmethod
    def of_profiles(
        cls, balls: Sequence[Sequence[PosedProfile]], stated: StatedErrors, start: Array, least: int
    ) -> BallLooks:
        """Fit the arcs.

        Parameters
        ----------
        balls : sequence of sequence of PosedProfile
            Profiles of each ball, with joint angles.
        stated : StatedErrors
            What they may be off by.
        start : ndarray, shape (4 balls,)
            About where the balls are, and their radii.
        least : int
            Profiles of each ball that have to show it.

        Raises
        ------
        AcceptanceRefused
            If fewer do.
        """
        laser = LaserDeviation.for_window(LINEARITY_UNIT, stated.window)
        arcs, shown = [], []
        for number, shots in enumerate(balls):
            found, refused = fit_profiles(shots, fit_circle, stated.noise, laser)
            if len(found) < least:
                why = f"; {next(iter(refused.values())).evidence}" if refused else ""
                where = ", ".join(f"{1e3 * x:.0f}" for x in start[4 * number : 4 * number + 3])
                raise AcceptanceRefused(
                    "the ball is not seen",
                    f"{len(found)} of {len(shots)} profiles show a ball about {where} mm in the "
                    f"arm's base, {least} are needed{why}",
                )
            by_name = {shot.name: shot for shot in shots}
            arcs.append(tuple(found))
            shown.append(tuple(by_name[arc.name] for arc in found))
        return cls(tuple(arcs), tuple(shown), stated, start)

    def solved(self, stated: StatedErrors | None = None) -> BallLooks:
        """The same arcs with the balls that fit them best, where other errors are stated, too."""
        looks = self if stated is None else replace(self, stated=stated)
        for _ in range(SOLVE_ROUNDS):
            looks = replace(looks, target=looks.target + looks.estimate()[0])
        return looks

    def linearise(self) -> tuple[StackedResiduals, Array, Array, Array]:
        """Residuals at the target, by whom they come.

        Returns
        -------
        stacked : StackedResiduals
            See there.
        by_target : ndarray, shape (N, 4 balls)
            Derivative by the target.
        own : ndarray, shape (N, N)
            Covariance by noise of each look.
        shared : ndarray, shape (N, N)
            Covariance by what all looks share, but the laser's linearity.
        """
        stated = self.stated
        values, vectors = np.linalg.eigh(stated.covariance)
        draws = vectors * np.sqrt(np.maximum(values, 0.0))
        parts, each = [], np.split(self.target, len(self.arcs))
        for arcs, shots, own in zip(self.arcs, self.profiles, each, strict=True):
            model = SeenBall(arcs, SphereTarget(), stated.noise).model
            found = model.linearise(stated.T_f_s, own)
            moved = np.array([_flange_motion(stated.kinematics, shot) for shot in shots])
            by_stated = np.concatenate((found.by_pose, found.by_arm @ moved), axis=2) @ draws
            bias = [
                _by_range_bias(arc.fit, shot, own[3], stated.range_bias)
                for arc, shot in zip(arcs, shots, strict=True)
            ]
            by_stated = np.concatenate((by_stated, np.array(bias)[:, :, None]), axis=2)
            parts.append(replace(found, by_pose=by_stated))
        stacked, m = stack_residuals(parts), len(draws) + 1
        by_shared, by_target = stacked.jacobian[:, :m], stacked.jacobian[:, m:]
        own_covariance = stacked.covariance - _square(stacked.by_laser)
        return stacked, by_target, own_covariance, _square(by_shared)

    def estimate(self) -> tuple[Array, Array]:
        """Step to the most probable target, and its covariance, by all that is stated."""
        stacked, J, _, _ = self.linearise()
        W_J = np.linalg.solve(self.covariance, J)
        covariance = np.linalg.inv(J.T @ W_J)
        return -covariance @ (W_J.T @ stacked.residuals), covariance

    @property
    def covariance(self) -> Array:
        """Of the residuals, by all that is stated, shape (N, N)."""
        stacked, _, own, shared = self.linearise()
        return own + shared + self._linearity_scale**2 * _square(stacked.by_laser)

    @property
    def _linearity_scale(self) -> float:
        return self.stated.linearity / LINEARITY_UNIT

    def centre_sigmas(self) -> Array:
        """Of a ball's centre in b by noise of the looks alone, shape (3,), metres."""
        _, J, own, _ = self.linearise()
        gain = self.estimate()[1] @ np.linalg.solve(self.covariance, J).T
        return np.sqrt(np.diag(gain @ own @ gain.T))[:3]

    def distance(self) -> tuple[float, float]:
        """Between two balls' centres, and its standard uncertainty, metres."""
        apart = self.target[4:7] - self.target[:3]
        distance = float(np.linalg.norm(apart))
        along = np.concatenate((-apart, (0.0,), apart, (0.0,))) / distance
        return distance, float(np.sqrt(along @ self.estimate()[1] @ along))

    @property
    def count(self) -> int:
        """Number of looks."""
        return sum(map(len, self.arcs))

    def noise(self) -> tuple[float, float]:
        """Range noise of a point, metres, and its standard uncertainty.

        What is left of arcs without a smooth polynomial along each.
        """
        squares = weight = points = 0.0
        for arc, shot in zip(self.arcs[0], self.profiles[0], strict=True):
            away, off = _points_off_arc(arc.fit, shot)
            along = 2 * (away[:, 0] - away[:, 0].min()) / np.ptp(away[:, 0]) - 1
            V = legvander(along, SHAPE_DEGREE)
            left = off - V @ np.linalg.lstsq(V, off, rcond=None)[0]
            squares += float(left @ left) * len(off) / (len(off) - SHAPE_DEGREE - 1)
            weight += float((away[:, 1] ** 2).sum())
            points += len(off)
        found = np.sqrt(squares / weight)
        return found, found * np.sqrt(self.stated.noise.mean_variance_inflation / (2 * points))

    def repeatability(self) -> tuple[float, float, float]:
        """RP of ISO 9283 at one pose, its standard uncertainty, and what is to be expected, metres.

        That is with the repeatability and the noise that are stated.
        """
        model = SeenBall(self.arcs[0], SphereTarget(), self.stated.noise).model
        found = model.linearise(self.stated.T_f_s, self.target[:4])
        R, r = float(self.target[3]), model.radii
        y = np.sqrt(np.maximum(R**2 - r**2, 0.0))
        seen = np.column_stack((model.centres_s[:, 0], y, model.centres_s[:, 2]))
        measured, spread = _mean_and_three_sigmas(seen)
        scale = np.diag((1.0, 1.0, R / max(float(y.mean()), 0.1 * R)))
        C = scale @ found.covariance.mean(axis=0) @ scale
        drawn = np.random.default_rng(0).standard_normal((EXPECTED_DRAWS, 3))
        expected, _ = _mean_and_three_sigmas(drawn @ np.linalg.cholesky(C).T)
        n = len(seen)
        sigma = spread * np.sqrt(1 / n + 9 / (2 * (n - 1)))
        return measured, sigma, expected

    def linearity(self) -> tuple[float, float]:
        """Largest deviation of the laser in its window, metres, and its standard uncertainty.

        The variance component of its smooth deviations by the minimum norm quadratic unbiased
        estimator (Rao 1971) at the stated value; the uncertainty is that at the stated value.
        """
        stacked, J, own, shared = self.linearise()
        K = _square(stacked.by_laser)
        start = self._linearity_scale
        W = np.linalg.inv(own + shared + start**2 * K)
        P = W - W @ J @ np.linalg.solve(J.T @ W @ J, J.T @ W)
        PK = P @ K
        information = float(np.trace(PK @ PK))
        score = float(stacked.residuals @ PK @ P @ stacked.residuals) - float(np.trace(PK))
        found = float(np.sqrt(max(start**2 + score / information, 0.0)))
        spread = np.sqrt(2 / information)
        sigma = np.sqrt(spread) if start == 0 else min(spread / (2 * start), np.sqrt(spread))
        return LINEARITY_UNIT * found, LINEARITY_UNIT * float(sigma)

    def scatter(self) -> tuple[float, float, float]:
        """Scatter of the ball's centre in b: RMS, its standard uncertainty, and the RMS to expect.

        Metres, along x and z of the sensor together; the uncertainty is that of what is expected.
        """
        stacked, J, own, _ = self.linearise()
        W = np.linalg.inv(own)
        M = np.eye(len(J)) - J @ np.linalg.solve(J.T @ W @ J, J.T @ W)
        S = self.covariance
        centre = np.arange(len(J)) % 3 < 2  # of x, z and radius by turns
        left, expected = (M @ stacked.residuals)[centre], (M @ S @ M.T)[np.ix_(centre, centre)]
        mean, n = float(np.trace(expected)), self.count
        freedom = mean**2 / float(np.sum(expected**2))
        rms = np.sqrt(mean / n)
        return float(np.sqrt(left @ left / n)), float(rms / np.sqrt(2 * freedom)), float(rms)


def _square(A: Array | None) -> Array:
    if A is None:
        raise ValueError("the laser's deviation is stated for every arc")
    return np.asarray(A @ A.T)


def _mean_and_three_sigmas(places: Array) -> tuple[float, float]:
    """RP of places, shape (n, 3), and the standard deviation of distances from their middle."""
    distances = np.linalg.norm(places - places.mean(axis=0), axis=1)
    spread = float(distances.std(ddof=1))
    return float(distances.mean()) + 3 * spread, spread


def _flange_motion(kinematics: Kinematics, shot: PosedProfile) -> Array:
    """Motion of the flange by the joints' deviations, in the axes of b, shape (6, 6 joints)."""
    R = shot.T_b_f[:3, :3]
    in_f = deviation_jacobian(kinematics, np.asarray(shot.q)).reshape(6, -1)
    return np.asarray(block_diag(R, R) @ in_f)


def _points_off_arc(fit: CircleFit, shot: PosedProfile) -> tuple[Array, Array]:
    """Directions to the points of an arc, shape (n, 2), and how far they are off it."""
    points = np.column_stack((shot.profile.x_s[fit.inlier], shot.profile.z_s[fit.inlier]))
    away = points - fit.centre_s[[0, 2]]
    distance = np.linalg.norm(away, axis=1)
    return away / distance[:, None], distance - fit.radius


def _by_range_bias(fit: CircleFit, shot: PosedProfile, radius: float, bias: float) -> Array:
    """Residuals by ranges that are too long by the bias times the tangent of the incidence."""
    away, _ = _points_off_arc(fit, shot)
    slope = np.abs(away[:, 0] / np.minimum(away[:, 1], -1e-3))
    outward = away[:, 1] * bias * np.minimum(slope, MOST_RANGE_BIAS_SLOPE)
    J = np.column_stack((away, np.ones(len(away))))
    x, z, r = np.linalg.lstsq(J, outward, rcond=None)[0]
    return np.array((-x, -z, fit.radius / radius * r))


def stopping(states: Sequence[ArmState], ordered: int) -> tuple[float, float, float]:
    """How far an arm went on after a stop was ordered.

    All of the way since the last state before counts: a driver may be silent while it stops.

    Parameters
    ----------
    states : sequence of ArmState
        From before the stop until the arm rests.
    ordered : int
        The one that was read just before the stop was ordered.

    Returns
    -------
    distance, sigma, speed : float
        Of the flange: metres, its standard uncertainty by the time between two states, and metres
        per second when the stop was ordered.
    """
    times = np.array([state.time for state in states])
    places = np.array([state.T_b_f[:3, 3] for state in states])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    before = int(np.searchsorted(times, times[ordered] - SPEED_SPAN))
    seconds = times[ordered] - times[before]
    speed = float(steps[before:ordered].sum() / seconds) if seconds > 0 else 0.0
    gaps = np.diff(times[: ordered + 1])
    sigma = (
        speed * float(gaps.max(initial=0.0, where=times[:ordered] >= times[before])) / np.sqrt(12)
    )
    return float(steps[ordered:].sum()), sigma, speed


def clock_drift(first: tuple[float, float, float], last: tuple[float, float, float]) -> Array:
    """By how much the laser's clock runs faster than the arm's, as a share, and its sigma.

    Parameters
    ----------
    first, last : tuple of float
        Stamp of the laser, by how much the arm's clock is ahead there, and its standard
        deviation, seconds.
    """
    (t0, offset0, sigma0), (t1, offset1, sigma1) = first, last
    return np.array((offset0 - offset1, np.hypot(sigma0, sigma1))) / (t1 - t0)
