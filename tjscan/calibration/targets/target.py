"""What every calibration target has in common: its profiles, their residuals, and its starts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from tjscan.calibration.noise import FlangeMoves, NoiseModel
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, PoseMatrix, array_dataclass
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.profile import Profile


@array_dataclass
class PosedProfile:
    """A profile of the calibration target, and the flange pose it was taken from.

    Parameters
    ----------
    name : str
        Name of the profile in reports.
    T_b_f : ndarray, shape (4, 4)
        Flange pose, as the arm read it.
    profile : Profile
        The profile that the laser took from there.
    q : ndarray, shape (joints,), or None
        Joint angles there, radians; None if they are not known.
    """

    name: str
    T_b_f: PoseMatrix
    profile: Profile
    q: Array | None = None


class ProfileFit(Protocol):
    """A line, a circle or a roof fitted to a profile."""

    def by_laser(self, profile: Profile, laser: LaserDeviation) -> Array:
        """Changes of the fit with m draws of the laser's deviation, shape (k, m)."""


Fit = TypeVar("Fit", bound=ProfileFit)


@array_dataclass
class PosedFit(Generic[Fit]):
    """The fit to a profile, and the flange pose that the profile was taken from.

    Parameters
    ----------
    name : str
        Name of the profile in reports.
    T_b_f : ndarray, shape (4, 4)
        Flange pose, as the arm read it.
    fit : LineFit, CircleFit or RoofFit
        Frame s.
    by_laser : ndarray, shape (k, m), or None
        How it changes with each draw of the laser's deviation, see `LineFit.by_laser`; None if
        no deviation is stated.
    by_arm : ndarray, shape (6, m), or None
        How the flange moves with each draw of the arm's geometry, see
        `ArmGeometryDeviation.flange_motion`; None if the arm's posture is not known.
    q : ndarray, shape (joints,), or None
        Joint angles there, radians; None if they are not known.
    """

    name: str
    T_b_f: Array
    fit: Fit
    by_laser: Array | None = None
    by_arm: Array | None = None
    q: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TargetStatement:
    """What is stated of a target before the sensor is calibrated on it.

    Parameters
    ----------
    flange_b : ndarray, shape (3,)
        About where the flange was, frame b, metres: on the side that a board is seen from.
    radius : float or None
        Of a ball, metres; None if it is unknown.
    touched : array_like, shape (m, 3), or None
        Points of a board that were touched, frame b, metres.
    plane : tuple of float or None
        A board A, B, C, D in frame b: A x + B y + C z + D = 0; D in millimetres.
    """

    flange_b: Array
    radius: float | None = None
    touched: ArrayLike | None = None
    plane: tuple[float, float, float, float] | None = None


def fit_profiles(
    profiles: Sequence[PosedProfile],
    fit: Callable[[Profile, NoiseModel], Fit],
    noise: NoiseModel,
    laser: LaserDeviation | None = None,
    flange_moves: FlangeMoves | None = None,
) -> tuple[list[PosedFit[Fit]], dict[str, CalibrationRefused]]:
    """Fit a target's curve to every profile, and keep the flange pose with it.

    Parameters
    ----------
    profiles : sequence of PosedProfile
        Of one target.
    fit : callable
        `fit_line`, `fit_circle` or `fit_roof`.
    noise : NoiseModel
        Range noise of a point.
    laser : LaserDeviation, optional
        Possible deviation of the laser.
    flange_moves : callable, optional
        How the arm's geometry error moves its flange, if its model is known.

    Returns
    -------
    samples : list of PosedFit
        Of the profiles that show the target.
    refused : dict of str to CalibrationRefused
        By name, why each of the others does not.
    """
    samples: list[PosedFit[Fit]] = []
    refused: dict[str, CalibrationRefused] = {}
    for shot in profiles:
        try:
            found = fit(shot.profile, noise)
        except CalibrationRefused as refusal:
            refused[shot.name] = refusal
            continue
        by_laser = None if laser is None else found.by_laser(shot.profile, laser)
        by_arm = None if flange_moves is None or shot.q is None else flange_moves(shot.q)
        samples.append(PosedFit(shot.name, shot.T_b_f, found, by_laser, by_arm, shot.q))
    return samples, refused


@dataclass(frozen=True, slots=True, eq=False)
class LinearisedModel:
    """Residuals of n profiles at a guess of sensor and target, with derivatives and covariance.

    Parameters
    ----------
    residuals : ndarray, shape (n, k)
        Zero if everything fits.
    by_pose : ndarray, shape (n, k, 6)
        Derivative by a step of T_f_s: translation and small rotation, both in the axes of f.
    by_target : ndarray, shape (n, k, m)
        Derivative by the target's parameters.
    by_arm : ndarray, shape (n, k, 6)
        Derivative by an error of the flange's pose: translation and small rotation about the
        flange's origin, both in the axes of b.
    own_covariance : ndarray, shape (n, k, k)
        Of the residuals, from the range noise alone.
    noise : NoiseModel
        For the arm's errors.
    by_laser : ndarray, shape (n, k, m), or None
        Derivative by independent standard normal draws of the laser's deviation, the same for all
        profiles; None if no deviation is stated.
    by_geometry : ndarray, shape (n, k, m), or None
        The same by draws of the arm's geometry, for an error of one metre, see
        `ArmGeometryDeviation.flange_motion`; None if the arm's postures are not known.
    """

    residuals: Array
    by_pose: Array
    by_target: Array
    by_arm: Array
    own_covariance: Array
    noise: NoiseModel
    by_laser: Array | None = None
    by_geometry: Array | None = None

    @property
    def covariance(self) -> Array:
        """Of the residuals, shape (n, k, k): range noise and the arm's pose noise."""
        scaled = self.by_arm * np.repeat((self.noise.position, self.noise.rotation), 3)
        return np.asarray(self.own_covariance + scaled @ scaled.transpose(0, 2, 1))


class TargetModel(Protocol):
    """Model of the residuals that profiles of a calibration target leave, at their flange poses."""

    @property
    def prior_information(self) -> Array:
        """Inverse covariance of the target's parameters about zero, shape (m, m)."""

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """Residuals at a guess of sensor and target, their derivatives and covariance.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (m,)
            The target's parameters.
        """

    def at_other_poses(self, T_b_f: Array) -> Self:
        """Return the same profiles, taken from other flange poses, shape (n, 4, 4)."""

    def is_behind(self, T_f_s: Array, target: Array) -> bool:
        """Whether the sensor would look at the target from behind: a mirror image."""
        return False  # an arc shows its side, and no two planes that meet fit a mirror image

    def result_fields(self, target: Array, covariance: Array) -> dict[str, Any]:
        """The estimated target as fields of `HandEyeCalibration`.

        Parameters
        ----------
        target : ndarray, shape (m,)
            The target's parameters.
        covariance : ndarray, shape (m, m)
            Of them.
        """


@dataclass(frozen=True, slots=True, eq=False)
class SeenTarget(ABC, Generic[Fit]):
    """Profiles of one target, and how to begin solving with them.

    Parameters
    ----------
    samples : sequence of PosedFit
        The fit to each profile.
    """

    samples: Sequence[PosedFit[Fit]]

    @property
    def names(self) -> list[str]:
        """Of the profiles."""
        return [sample.name for sample in self.samples]

    @property
    def T_b_f(self) -> Array:
        """Flange poses of the profiles, shape (n, 4, 4)."""
        return np.stack([sample.T_b_f for sample in self.samples])

    @property
    def fits(self) -> list[Fit]:
        """Line, circle or roof of each profile."""
        return [sample.fit for sample in self.samples]

    def with_poses(self, T_b_f: Array) -> Self:
        """The same profiles from other flange poses, shape (n, 4, 4)."""
        samples = [replace(s, T_b_f=T) for s, T in zip(self.samples, T_b_f, strict=True)]
        return replace(self, samples=samples)

    @property
    def by_laser(self) -> Array | None:
        """Responses of all fits to the laser's deviation, shape (n, k, m); None if one has none."""
        return _stack_if_known([sample.by_laser for sample in self.samples])

    @property
    def by_arm(self) -> Array | None:
        """Motions of all flange poses with the arm's geometry, shape (n, 6, m); None if unknown."""
        return _stack_if_known([sample.by_arm for sample in self.samples])

    @property
    @abstractmethod
    def kind(self) -> str:
        """The target in words: a part of the result's method."""

    @abstractmethod
    def starts(self) -> list[Array]:
        """Possible poses T_f_s of the sensor, shape (4, 4) each, from these profiles alone."""

    @abstractmethod
    def model_at_sensor_pose(self, T_f_s: Array) -> tuple[TargetModel, Array]:
        """Model and parameters, (m,), of the target if the sensor sits at T_f_s, shape (4, 4)."""


def _stack_if_known(each: Sequence[Array | None]) -> Array | None:
    """Stack arrays of all profiles; None if there is none, or one profile has none."""
    known = [one for one in each if one is not None]
    return np.stack(known) if known and len(known) == len(each) else None
