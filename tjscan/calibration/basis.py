"""What a calibration rests on beside its residuals, as ``calibration.toml`` keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field

from tjscan.core.config import StrictFileModel
from tjscan.core.frames import Array, inverse_pose


class ViewEntry(StrictFileModel):
    """How the sensor looked at the target for one profile.

    `tilt_deg` is the angle of the sensor's z from z of the arm's base, from its opposite where most
    profiles look that way; `azimuth_deg` is the direction in which it leans. For a sensor that
    stands fixed, the flange's z counts.
    """

    name: str
    tilt_deg: float
    azimuth_deg: float


class ShrinkingEntry(StrictFileModel):
    """Standard uncertainty after so many lines, as the result has it."""

    lines: int = Field(ge=1)
    sigma_position_mm: float = Field(ge=0)
    sigma_rotation_deg: float = Field(ge=0)


class BasisEntry(StrictFileModel):
    """The table [basis]: target, poses, and what was left out before anything was solved.

    `caveats` are what to know before relying on the result, `poses_read_as` how the orientations
    of recorded poses were read.
    """

    target: str
    poses_read_as: Annotated[tuple[str, ...], Field(strict=False)] = ()
    left_out: Annotated[tuple[str, ...], Field(strict=False)] = ()
    caveats: Annotated[tuple[str, ...], Field(strict=False)] = ()
    views: Annotated[tuple[ViewEntry, ...], Field(strict=False)] = ()
    shrinking: Annotated[tuple[ShrinkingEntry, ...], Field(strict=False)] = ()


def views_of_poses(
    T_b_f: Mapping[str, Array], T_sensor: Array, *, sensor_is_fixed: bool = False
) -> tuple[ViewEntry, ...]:
    """How the sensor looked from flange poses.

    Parameters
    ----------
    T_b_f : mapping of str to ndarray, shape (4, 4)
        Flange poses by the names of their profiles.
    T_sensor : ndarray, shape (4, 4)
        T_f_s, or T_b_s of a sensor that stands fixed in the room.
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
