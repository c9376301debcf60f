"""An arm's deviations as ``calibration.toml`` holds them, in millimetres and degrees."""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np
from pydantic import Field, model_validator

from tjscan.core.config import StrictFileModel
from tjscan.core.frames import Array

JointRow = Annotated[tuple[float, float, float, float, float, float], Field(strict=False)]

_UNITS: Final = np.array((1e3, 1e3, 1e3, *np.full(3, 180 / np.pi)))
"""From metres and radians to the file's millimetres and degrees."""

LARGEST: Final = 5.0
"""Millimetres and degrees; an arm that deviates by more is of another model."""


class ArmKinematicsEntry(StrictFileModel):
    """The table [kinematics]: what a calibration found of the arm.

    A row of `deviations` is that of a joint: x, y, z in mm and the rotation vector in degrees of
    its frame, in axes whose z is the joint's. `covariance` is that of T_f_s and of all rows after
    it, in mm and degrees.
    """

    model: str
    deviations: Annotated[tuple[JointRow, ...], Field(strict=False)]
    covariance: Annotated[
        tuple[Annotated[tuple[float, ...], Field(strict=False)], ...], Field(strict=False)
    ]
    left_as_stated: Annotated[tuple[str, ...], Field(strict=False)]
    held_out_poses: int = Field(ge=1)
    held_out_before_mm: float = Field(ge=0)
    held_out_after_mm: float = Field(ge=0)

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> ArmKinematicsEntry:
        if not np.abs(self.deviations).max() <= LARGEST:
            raise ValueError(f"an arm deviates by less than {LARGEST:g} mm and degrees")
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
            What could not be found.
        held_out : tuple
            Poses that took no part; RMS without and with the deviations, metres.
        """
        units = np.tile(_UNITS, 1 + len(deviations))
        count, before, after = held_out
        return cls(
            model=model,
            deviations=tuple(map(tuple, (deviations * _UNITS).tolist())),
            covariance=tuple(map(tuple, (covariance * np.outer(units, units)).tolist())),
            left_as_stated=left_as_stated,
            held_out_poses=count,
            held_out_before_mm=1e3 * before,
            held_out_after_mm=1e3 * after,
        )

    @property
    def deviations_si(self) -> Array:
        """Deviations of the joints, shape (joints, 6), metres and radians."""
        return np.asarray(np.array(self.deviations) / _UNITS)

    @property
    def covariance_si(self) -> Array:
        """Covariance of T_f_s and the deviations, metres and radians."""
        units = np.tile(_UNITS, 1 + len(self.deviations))
        return np.array(self.covariance) / np.outer(units, units)
