"""Profiles of a file or a folder: columns, a profile per row, NPY, PLY, Gocator's export."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.files import check_file_size
from tjscan.laser.files.format import (
    METRES_PER_UNIT,
    FileProfiles,
    ProfileFormat,
    check_scale,
    check_unit,
)
from tjscan.laser.files.tables import read_npy, read_ply_profile, read_text
from tjscan.laser.files.text import read_text_table
from tjscan.laser.profile import Profile

PROFILE_SUFFIXES: Final = (".csv", ".txt", ".tsv", ".dat", ".npy", ".ply")
"""Files of a folder that are read."""

MOST_BYTES: Final = 100_000_000
"""A larger file is no profile; it would fill the memory."""


def read_profiles(file: Path, form: ProfileFormat) -> FileProfiles:
    """Read every profile in a file, or in the files of a folder; what is bad is named.

    Parameters
    ----------
    file : Path
        Text whose first line names columns x and z (and profile, if there are many); text
        with a profile per row, with or without a line of column numbers; NPY with either; PLY
        with points in the x-z plane; or a Gocator's exported recording. Text is separated by
        commas, semicolons, tabs or blanks.
    form : ProfileFormat
        What the file does not state.

    Raises
    ------
    ConfigurationError
        If the file is missing, too large, not text, or lacks a unit, a pitch or a column; or if
        its numbers can only be of another unit.
    """
    if form.unit is not None and form.unit not in METRES_PER_UNIT:
        known = ", ".join(METRES_PER_UNIT)
        raise ConfigurationError(f"unknown unit {form.unit!r}; one of {known}", key="units")
    for key, value in (("--z-scale", form.z_scale), ("--z-offset", form.z_offset or 0.0)):
        if not math.isfinite(value) or (key == "--z-scale" and value == 0):
            raise ConfigurationError(f"must be a number (found {value})", key=key)
    if file.is_dir():
        return _read_folder(file, form)
    table = _read_file(file, form)
    check_unit(file, table.profiles.values())
    check_scale(file, table.profiles.values())
    return table


def flip_heights(profile: Profile) -> Profile:
    """The profile that heights of the other sign would have given, as far from the sensor."""
    low, high = np.nanmin(profile.z_s), np.nanmax(profile.z_s)
    return Profile(profile.x_s, low + high - profile.z_s, profile.intensity, profile.time)


def _read_folder(folder: Path, form: ProfileFormat) -> FileProfiles:
    """The profiles of all files in a folder, by name."""
    together = FileProfiles()
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in PROFILE_SUFFIXES:
            continue
        try:
            table = read_profiles(file, form)
        except ConfigurationError as error:
            together.bad.append(f"{file.name}: {error.message}")
            continue
        for name, profile in table.profiles.items():
            own = file.name if name == file.name else f"{file.name} {name}"
            together.profiles[own] = profile
        together.bad += [f"{file.name}: {bad}" for bad in table.bad]
        together.notes += [note for note in table.notes if note not in together.notes]
    if not together.profiles:
        known = ", ".join(PROFILE_SUFFIXES)
        why = f" ({together.bad[0]})" if together.bad else ""
        raise ConfigurationError(f"holds no profile in a file {known}{why}", file=folder)
    return together


def _read_file(file: Path, form: ProfileFormat) -> FileProfiles:
    try:
        check_file_size(file, MOST_BYTES, "profiles")
        suffix = file.suffix.lower()
        if suffix == ".mcap":
            raise ConfigurationError(
                "is a recording, not a table of profiles; to read the profiles of a scan again: "
                f"tjscan reprocess {file.parent}",
                file=file,
            )
        if suffix == ".ply":
            return read_ply_profile(file, form)
        if suffix == ".npy":
            return read_npy(file, form)
        return read_text(file, read_text_table(file), form)
    except FileNotFoundError:
        near = nearest_word(file.name, [f.name for f in file.parent.glob("*")][:1000])
        raise ConfigurationError(f"there is no such file; near it: {near}", file=file) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f"is no table of numbers: {error}", file=file) from None
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
