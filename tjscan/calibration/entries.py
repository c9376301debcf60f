"""Tables of ``calibration.toml``, in millimetres and degrees."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field, model_validator

from tjscan.core.config import StrictFileModel
from tjscan.core.frames import Array, inverse_pose

Row6 = Annotated[tuple[float, float, float, float, float, float], Field(strict=False)]
NumberTable = Annotated[
    tuple[Annotated[tuple[float, ...], Field(strict=False)], ...], Field(strict=False)
]
Words = Annotated[tuple[str, ...], Field(strict=False)]

FILE_UNITS_PER_SI: Final = np.array((1e3, 1e3, 1e3, *np.full(3, 180 / np.pi)))
"""From metres and radians to the file's millimetres and degrees: a pose or a joint's frame."""

MAX_DEVIATION: Final = 5.0
"""Millimetres and degrees; an arm that deviates by more is of another model."""


def in_file_units(values: Array, axes: int = 1) -> tuple[Any, ...]:
    """Rows of a table in millimetres and degrees.

    Parameters
    ----------
    values : ndarray, shape (6 k, n)
        Rows are translations (metres) and rotations (radians) in turn.
    axes : int
        2 if the columns are so too: a covariance.
    """
    units = np.tile(FILE_UNITS_PER_SI, len(values) // 6)
    scaled = values * (np.outer(units, units) if axes == 2 else units[:, None])
    return tuple(map(tuple, scaled.tolist()))


def covariance_from_file_units(rows: tuple[tuple[float, ...], ...]) -> Array:
    """Covariance in metres and radians, shape (6 k, 6 k), from a file's rows."""
    units = np.tile(FILE_UNITS_PER_SI, len(rows) // 6)
    return np.array(rows) / np.outer(units, units)


class ResidualEntry(StrictFileModel):
    """Residual of one line in the file; see `tjscan.calibration.result.SampleResidual`."""

    name: str
    used: bool
    offset_mm: float
    tilt_deg: float | None = None
    misfit: float
    shift_mm: float
    turn_deg: float


class VerificationEntry(StrictFileModel):
    """Result of the fresh line in the file; see `tjscan.calibration.result.Verification`."""

    offset_mm: float
    sigma_offset_mm: float
    tilt_deg: float
    sigma_tilt_deg: float
    misfit: float
    limit: float


class BallEntry(StrictFileModel):
    """A ball in the file: its radius as stated and as measured; see `MeasuredRadius`."""

    stated_radius_mm: float | None = None
    measured_radius_mm: float
    sigma_radius_mm: float


class ArmKinematicsEntry(StrictFileModel):
    """The table [kinematics]: the deviations of the arm's joints.

    A row of `deviations` is that of a joint: x, y, z in mm and the rotation vector in degrees of
    its frame, in axes whose z is the joint's. `covariance` is that of T_f_s and of all rows after
    it, in mm and degrees.
    """

    model: str
    deviations: Annotated[tuple[Row6, ...], Field(strict=False)]
    covariance: NumberTable
    left_as_stated: Words
    held_out_poses: int = Field(ge=1)
    held_out_before_mm: float = Field(ge=0)
    held_out_after_mm: float = Field(ge=0)

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> ArmKinematicsEntry:
        if not np.abs(self.deviations).max() <= MAX_DEVIATION:
            raise ValueError(f"an arm deviates by less than {MAX_DEVIATION:g} mm and degrees")
        n = 6 + 6 * len(self.deviations)
        covariance = np.array([row for row in self.covariance if len(row) == n])
        if covariance.shape != (n, n) or not np.allclose(covariance, covariance.T):
            raise ValueError(f"its covariance is not one: it must be symmetric, {n} by {n}")
        return self

    @classmethod
    def from_si(
        cls,
        model: str,
        deviations: Array,
        covariance: Array,
        left_as_stated: tuple[str, ...],
        held_out: tuple[int, float, float],
    ) -> ArmKinematicsEntry:
        """Make the entry from metres and radians.

        Parameters
        ----------
        model : str
            The arm's model, as the job names it.
        deviations : ndarray, shape (joints, 6)
            Of the joints.
        covariance : ndarray, shape (6 + 6 joints, 6 + 6 joints)
            Of T_f_s and the deviations.
        left_as_stated : tuple of str
            The deviations that the profiles do not determine.
        held_out : tuple
            Poses that took no part; RMS without and with the deviations, metres.
        """
        count, before, after = held_out
        return cls(
            model=model,
            deviations=tuple(map(tuple, (deviations * FILE_UNITS_PER_SI).tolist())),
            covariance=in_file_units(covariance, axes=2),
            left_as_stated=left_as_stated,
            held_out_poses=count,
            held_out_before_mm=1e3 * before,
            held_out_after_mm=1e3 * after,
        )

    @property
    def deviations_si(self) -> Array:
        """Deviations of the joints, shape (joints, 6), metres and radians."""
        return np.asarray(np.array(self.deviations) / FILE_UNITS_PER_SI)

    @property
    def covariance_si(self) -> Array:
        """Covariance of T_f_s and the deviations, metres and radians."""
        return covariance_from_file_units(self.covariance)


class LaserResponseEntry(StrictFileModel):
    """The table [laser_response]: the effect of the laser's deviation on the calibration.

    `by_draws` is by how much T_f_s, and the deviations of the arm's joints after it, are off
    with each standard normal draw of the laser's deviation, see `LaserDeviation.at`; rows in the
    order of the covariance, in mm and degrees. The covariance holds it already.
    """

    linearity_mm: float = Field(gt=0)
    by_draws: NumberTable

    @model_validator(mode="after")
    def _is_a_table(self) -> LaserResponseEntry:
        if len({len(row) for row in self.by_draws}) != 1 or len(self.by_draws) % 6:
            raise ValueError("a response has six rows a pose and joint, all of the same length")
        return self

    @property
    def by_draws_si(self) -> Array:
        """The response in metres and radians, shape (6 k, m)."""
        units = np.tile(FILE_UNITS_PER_SI, len(self.by_draws) // 6)
        return np.asarray(np.array(self.by_draws) / units[:, None])


class ViewEntry(StrictFileModel):
    """Direction from which the sensor looked at the target for one profile.

    `tilt_deg` is the angle of the sensor's z from z of the arm's base, from its opposite if most
    profiles look that way; `azimuth_deg` is the direction in which it leans. For a sensor that
    is fixed in the room, the flange's z counts.
    """

    name: str
    tilt_deg: float
    azimuth_deg: float


class ShrinkingEntry(StrictFileModel):
    """Standard uncertainty of the result after so many lines."""

    lines: int = Field(ge=1)
    sigma_position_mm: float = Field(ge=0)
    sigma_rotation_deg: float = Field(ge=0)


class BasisEntry(StrictFileModel):
    """The table [basis]: target, poses, and the profiles left out before anything was solved.

    `caveats` are warnings before relying on the result, `poses_read_as` how the orientations
    of recorded poses were read.
    """

    target: str
    poses_read_as: Words = ()
    left_out: Words = ()
    caveats: Words = ()
    views: Annotated[tuple[ViewEntry, ...], Field(strict=False)] = ()
    shrinking: Annotated[tuple[ShrinkingEntry, ...], Field(strict=False)] = ()


def views_of_poses(
    T_b_f: Mapping[str, Array], T_sensor: Array, *, sensor_is_fixed: bool = False
) -> tuple[ViewEntry, ...]:
    """Directions in which the sensor looked from flange poses.

    Parameters
    ----------
    T_b_f : mapping of str to ndarray, shape (4, 4)
        Flange poses by the names of their profiles.
    T_sensor : ndarray, shape (4, 4)
        T_f_s, or T_b_s of a sensor that is fixed in the room.
    sensor_is_fixed : bool
        Which of the two it is.
    """
    looks = [
        ((inverse_pose(T) if sensor_is_fixed else T) @ T_sensor)[:3, 2] for T in T_b_f.values()
    ]
    side = np.copysign(1.0, np.sum([z for _, _, z in looks]))
    return tuple(
        ViewEntry(
            name=name,
            tilt_deg=float(np.degrees(np.arctan2(np.hypot(x, y), side * z))),
            azimuth_deg=float(np.degrees(np.arctan2(y, x))),
        )
        for name, (x, y, z) in zip(T_b_f, looks, strict=True)
    )
