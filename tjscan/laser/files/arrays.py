"""Arrays and clouds: heights or points, as NPY or PLY."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.mesh_files import read_mesh_file
from tjscan.laser.files.format import FileProfiles, ProfileFormat
from tjscan.laser.files.heights import (
    heights_from_sensor,
    metres_per_number,
    profile_of_columns,
    without_codes,
)

OFF_PLANE_TOLERANCE: Final = 1e-6
"""Metres that a point of a profile may be off the laser plane."""


def read_npy(file: Path, form: ProfileFormat) -> FileProfiles:
    """Heights, shape (n,) or (m, n), or points x and z, shape (n, 2) or (m, n, 2)."""
    try:
        # Mapped, an array has no more elements than its file holds.
        found = np.lib.format.open_memmap(file, mode="r")
    except OSError:
        raise
    except Exception as error:  # its header is read as Python, which stumbles over many things
        raise ConfigurationError(f"is no array of numbers: {error}", file=file) from None
    if not isinstance(found, np.ndarray) or found.dtype.kind not in "iuf" or found.size == 0:
        raise ConfigurationError("is no array of numbers", file=file)
    values, table = found.astype(float), FileProfiles()
    values[np.isinf(values)] = np.nan
    names = [f"row {i + 1}" for i in range(len(values))]
    if values.ndim == 1:
        add_matrix(file, table, [file.name], values[None], form)
    elif values.ndim == 2 and values.shape[1] != 2:
        add_matrix(file, table, names, values, form)
    elif values.ndim in (2, 3) and values.shape[-1] == 2:
        scale = metres_per_number(file, form.unit, "an array")
        several = values if values.ndim == 3 else values[None]
        z = heights_from_sensor(several[..., 1], scale, form, table)
        x = scale * without_codes(several[..., 0], form.invalid)
        for i, name in enumerate(names if values.ndim == 3 else [file.name]):
            table.profiles[name] = profile_of_columns(x[i], z[i])
    else:
        raise ConfigurationError(f"an array of shape {values.shape} is no profile", file=file)
    return table


def read_ply(file: Path, form: ProfileFormat) -> FileProfiles:
    """The profile that a PLY holds, its points in the plane y = 0.

    Raises
    ------
    ConfigurationError
        If it is no PLY with points, or they are off that plane.
    """
    scale = metres_per_number(file, form.unit, "a PLY")
    try:
        points, _ = read_mesh_file(file)
    except ConfigurationError:
        raise
    except Exception as error:  # trimesh raises whatever its parser stumbles on
        raise ConfigurationError(f"is no PLY with points: {error}", file=file) from None
    if len(points) and not np.nanmax(np.abs(scale * points[:, 1])) <= OFF_PLANE_TOLERANCE:
        raise ConfigurationError(
            "its points lie off the plane y = 0, so it is no profile in a sensor's frame", file=file
        )
    table = FileProfiles()
    z_s = heights_from_sensor(points[:, 2], scale, form, table)
    table.profiles[file.name] = profile_of_columns(scale * points[:, 0], z_s)
    return table


def add_matrix(
    file: Path, table: FileProfiles, names: Sequence[str], heights: Array, form: ProfileFormat
) -> None:
    """Add profiles of heights, shape (m, n), at columns a pitch apart, x = 0 in the middle."""
    scale = metres_per_number(file, form.unit, "a matrix of profiles")
    x = scale * places_of_columns(file, heights.shape[1], form, "a matrix of profiles")
    z = heights_from_sensor(heights, scale, form, table)
    for name, row in zip(names, z, strict=True):
        table.profiles[name] = profile_of_columns(x, row)


def places_of_columns(file: Path, count: int, form: ProfileFormat, what: str) -> Array:
    """X of columns a pitch apart, in the file's unit."""
    if form.pitch is None:
        raise ConfigurationError(
            f"{what} needs the distance of its columns: --pitch. If its rows are points, name "
            "the columns in a first line: x_mm,z_mm",
            file=file,
        )
    if not 0 < form.pitch < math.inf:
        raise ConfigurationError(f"must be a positive number (found {form.pitch})", key="--pitch")
    return np.asarray(form.pitch * (np.arange(count) - (count - 1) / 2))
