"""``calibration.toml``: a calibration in millimetres and degrees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Final, cast

import numpy as np
import tomli_w
from pydantic import Field, model_validator

from tjscan.calibration.noise import NoiseModel
from tjscan.core.config import StrictFileModel, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import Array, inverse_pose
from tjscan.core.provenance import Provenance
from tjscan.core.units import PoseRows, pose_from_rows_mm

Row6 = Annotated[tuple[float, float, float, float, float, float], Field(strict=False)]
NumberTable = Annotated[
    tuple[Annotated[tuple[float, ...], Field(strict=False)], ...], Field(strict=False)
]
Words = Annotated[tuple[str, ...], Field(strict=False)]

FILE_UNITS_PER_SI: Final = np.array((1e3, 1e3, 1e3, *np.full(3, 180 / np.pi)))
"""From metres and radians to the file's millimetres and degrees: a pose or a joint's frame."""

MAX_JOINT_DEVIATION: Final = 5.0
"""Millimetres and degrees; an arm that deviates by more is of another model."""


def rows_in_file_units(values: Array, axes: int = 1) -> tuple[Any, ...]:
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
    """Result of the fresh line in the file; see `checks.FreshLineVerification`."""

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
        if not np.abs(self.deviations).max() <= MAX_JOINT_DEVIATION:
            raise ValueError(f"an arm deviates by less than {MAX_JOINT_DEVIATION:g} mm and degrees")
        n = 6 + 6 * len(self.deviations)
        covariance = np.array([row for row in self.covariance if len(row) == n])
        if covariance.shape != (n, n) or not np.allclose(covariance, covariance.T):
            raise ValueError(f"its covariance is not one: it must be symmetric, {n} by {n}")
        return self

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
    with each standard normal draw of the laser's deviation, see `LaserDeviation.displacements_at`;
    rows in the order of the covariance, in mm and degrees. The covariance holds it already.
    """

    linearity_mm: float = Field(gt=0)
    by_draws: NumberTable

    @model_validator(mode="after")
    def _refuse_uneven_response(self) -> LaserResponseEntry:
        if len({len(row) for row in self.by_draws}) != 1 or len(self.by_draws) % 6:
            raise ValueError("a response has six rows a pose and joint, all of the same length")
        return self

    @property
    def response_si(self) -> Array:
        """The response in metres and radians, shape (6 k, m)."""
        units = np.tile(FILE_UNITS_PER_SI, len(self.by_draws) // 6)
        return np.asarray(np.array(self.by_draws) / units[:, None])


class ViewDirectionEntry(StrictFileModel):
    """Direction from which the sensor looked at the target for one profile.

    `tilt_deg` is the angle of the sensor's z from z of the arm's base, from its opposite if most
    profiles look that way; `azimuth_deg` is the direction in which it leans. For a sensor that
    is fixed in the room, the flange's z counts.
    """

    name: str
    tilt_deg: float
    azimuth_deg: float


class UncertaintyAfterLinesEntry(StrictFileModel):
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
    views: Annotated[tuple[ViewDirectionEntry, ...], Field(strict=False)] = ()
    shrinking: Annotated[tuple[UncertaintyAfterLinesEntry, ...], Field(strict=False)] = ()


def views_of_poses(
    T_b_f: Mapping[str, Array], T_sensor: Array, *, sensor_is_fixed: bool = False
) -> tuple[ViewDirectionEntry, ...]:
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
        ViewDirectionEntry(
            name=name,
            tilt_deg=float(np.degrees(np.arctan2(np.hypot(x, y), side * z))),
            azimuth_deg=float(np.degrees(np.arctan2(y, x))),
        )
        for name, (x, y, z) in zip(T_b_f, looks, strict=True)
    )


MIN_SENSOR_OFFSET_MM: Final = 5.0
"""A sensor's origin is further than this from the middle of the flange it is bolted to."""


class CalibrationFile(StrictFileModel):
    """Content of ``calibration.toml``: one calibration.

    `covariance` is that of (x, y, z, rotation vector) in the flange's axes, in mm and degrees;
    `geometry_mm` is the arm's geometry error that it allows for. A sensor that is fixed in
    the room has `T_b_s_mm` in place of `T_f_s_mm`, and the base's axes. `kinematics` holds the
    arm's deviations found with it: then T_f_s holds for the arm with these deviations alone;
    `laser_response` the part of the covariance that comes from the laser's own deviation.
    """

    arm: str
    laser: str
    date: datetime
    method: str
    lines: int = Field(ge=1)
    T_f_s_mm: PoseRows | None = None
    T_b_s_mm: PoseRows | None = None
    covariance: Annotated[tuple[Row6, Row6, Row6, Row6, Row6, Row6], Field(strict=False)]
    sigma_position_mm: float = Field(ge=0)
    sigma_rotation_deg: float = Field(ge=0)
    condition: float = Field(gt=0)
    excess: float = Field(ge=1)
    geometry_mm: float = Field(default=0.0, ge=0)
    ball: BallEntry | None = None
    noise: NoiseModel
    verification: VerificationEntry | None = None
    kinematics: ArmKinematicsEntry | None = None
    laser_response: LaserResponseEntry | None = None
    basis: BasisEntry | None = None
    residuals: Annotated[tuple[ResidualEntry, ...], Field(strict=False)]

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> CalibrationFile:
        covariance = np.array(self.covariance)
        if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] <= 0:
            raise ValueError("its covariance is not one: it must be symmetric and positive")
        halves = covariance[:3, :3], covariance[3:, 3:]  # translation and rotation
        sigmas = [float(np.sqrt(np.trace(half))) for half in halves]
        stated = (self.sigma_position_mm, self.sigma_rotation_deg)
        if not np.allclose(sigmas, stated, rtol=0.02):
            raise ValueError("its sigmas do not follow from its covariance: it was edited")
        if (self.T_f_s_mm is None) == (self.T_b_s_mm is None):
            raise ValueError("needs either T_f_s_mm or, for a fixed sensor, T_b_s_mm")
        if self.laser_response is not None:
            held = covariance if self.kinematics is None else self.kinematics.covariance
            if len(self.laser_response.by_draws) != len(held):
                raise ValueError("its laser_response has not as many rows as its covariance")
        offset_mm = max(abs(v) for row in self.sensor_pose_rows[:3] for v in row[3:])
        if not offset_mm >= MIN_SENSOR_OFFSET_MM:
            raise ValueError("its sensor sits in the flange: are these metres, not millimetres?")
        return self

    @property
    def sensor_pose_rows(self) -> PoseRows:
        """Pose of the sensor, on the flange or, fixed, in the base; rows in millimetres."""
        return cast("PoseRows", self.T_f_s_mm or self.T_b_s_mm)

    @property
    def T_f_s(self) -> Array:
        """Pose of the sensor in the flange frame, shape (4, 4), metres.

        Raises
        ------
        ConfigurationError
            If the sensor is fixed in the room.
        """
        if self.T_f_s_mm is None:
            raise ConfigurationError(
                "is of a sensor that is fixed in the room (T_b_s_mm): no arm carries it",
                key="T_f_s_mm",
            )
        return pose_from_rows_mm(self.T_f_s_mm)

    @property
    def covariance_si(self) -> Array:
        """Covariance of T_f_s, shape (6, 6): translation and small rotation in axes of f, SI."""
        return covariance_from_file_units(self.covariance)


@dataclass(frozen=True, slots=True)
class SavedCalibration:
    """A calibration and the file it was written to.

    Parameters
    ----------
    file : Path
        ``calibration.toml``.
    calibration : CalibrationFile
        Its content.
    caveats : tuple of str
        Warnings before relying on it.
    """

    file: Path
    calibration: CalibrationFile
    caveats: tuple[str, ...]


def write_calibration(file: Path, calibration: CalibrationFile, provenance: Provenance) -> None:
    """Write ``calibration.toml``, whole or not at all.

    Parameters
    ----------
    file : Path
        Replaced if it exists.
    calibration : CalibrationFile
        The content.
    provenance : Provenance
        Written at its head, in lines of comment.

    Raises
    ------
    RecordingError
        If it can't be written; an earlier file is then kept.
    """
    text = provenance.comment_lines("#") + tomli_w.dumps(calibration.model_dump(exclude_none=True))
    with write_files_atomically(file.parent) as draft:
        (draft / file.name).write_text(text, encoding="utf-8")


def read_calibration(
    file: Path, *, arm: str | None = None, laser: str | None = None
) -> CalibrationFile:
    """Read ``calibration.toml``.

    Parameters
    ----------
    file : Path
        The file.
    arm, laser : str, optional
        The devices at hand; a calibration of others is refused.

    Raises
    ------
    ConfigurationError
        If the file can't be read, or belongs to another arm or laser.
    """
    calibration = validate_table(CalibrationFile, read_toml(file), file)
    for key, wanted in (("arm", arm), ("laser", laser)):
        found = getattr(calibration, key)
        if wanted is not None and wanted != found:
            raise ConfigurationError(
                f"was calibrated on {found!r}, but this cell has {wanted!r}: a calibration holds "
                "for one sensor on one hand; calibrate again",
                file=file,
                key=key,
            )
    return calibration
