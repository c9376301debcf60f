"""Unit and frame of a file: as its sidecar states them, else the user, and never a guess."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tjscan.comparison.shapes import UnitAndFrame
from tjscan.core.config import validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import read_small_file
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import JointFile
from tjscan.laser.files.format import METRES_PER_UNIT

MOST_SIDECAR_BYTES: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class StatedUnitAndFrame:
    """Unit and frame that the user states for files that don't state them.

    Parameters
    ----------
    units : str, optional
        mm, um or m.
    frame : str, optional
        Letter or name of a frame.
    """

    units: str | None = None
    frame: str | None = None

    def __post_init__(self) -> None:
        if self.units is not None and self.units not in METRES_PER_UNIT:
            known = ", ".join(METRES_PER_UNIT)
            raise ConfigurationError(f"unknown unit {self.units!r}; one of {known}", key="units")


@dataclass(frozen=True, slots=True)
class Sidecar:
    """Sidecar file ``NAME.json`` beside ``NAME.stl``: its unit and frame, and the joint."""

    file: Path
    units: str | None = None
    frame: str | None = None
    joint: JointDefinition | None = None


def read_sidecar(file: Path) -> Sidecar:
    """Read a sidecar file.

    Raises
    ------
    ConfigurationError
        If it is no JSON object, its unit is unknown or its joint can't be built.
    """
    try:
        data: Any = json.loads(read_small_file(file, MOST_SIDECAR_BYTES, "a sidecar"))
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"is no JSON: {error}", file=file) from None
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    if not isinstance(data, dict):
        raise ConfigurationError("is no sidecar: it holds no table", file=file)
    units, frame, joint = data.get("units"), data.get("frame"), data.get("joint")
    if units is not None and (not isinstance(units, str) or units not in METRES_PER_UNIT):
        raise ConfigurationError(
            f"unknown unit {units!r}; one of {', '.join(METRES_PER_UNIT)}", file=file, key="units"
        )
    if frame is not None and not isinstance(frame, str):
        raise ConfigurationError("a frame is named by a word", file=file, key="frame")
    if joint is None:
        return Sidecar(file, units, frame)
    if not isinstance(joint, dict):
        raise ConfigurationError("a joint is a table", file=file, key="joint")
    # JSON holds lists, which the file's model takes for tuples.
    definition = validate_table(JointFile, joint, file).definition(file.stem)
    return Sidecar(file, units, frame, definition)


def find_sidecar(file: Path) -> Sidecar | None:
    """Find and read the sidecar beside a file; None if there is none."""
    beside = file.with_suffix(".json")
    return read_sidecar(beside) if beside != file and beside.is_file() else None


def resolve_unit_and_frame(
    file: Path,
    options: StatedUnitAndFrame,
    sidecar: Sidecar | None,
    own: tuple[str, str] | None = None,
) -> UnitAndFrame:
    """Decide the unit and frame of a file from what the user and the sidecar state.

    Parameters
    ----------
    file : Path
        The file.
    options : StatedUnitAndFrame
        What the user states.
    sidecar : Sidecar or None
        What is beside the file.
    own : (str, str), optional
        The unit that the file itself states, and where in it.

    Raises
    ------
    ConfigurationError
        If nothing states unit or frame, or two state different units.
    """
    beside = None
    if sidecar is not None and sidecar.units is not None:
        beside = (sidecar.units, f"the sidecar {sidecar.file.name}")
    if own is not None and beside is not None and own[0] != beside[0]:
        raise ConfigurationError(
            f"{own[1]} says {own[0]}, {beside[1]} says {beside[0]}", file=file, key="units"
        )
    asked = None if options.units is None else (options.units, "--units")
    unit = own or beside or asked
    if unit is None:
        raise ConfigurationError(
            "does not say what its numbers are: --units mm, um or m, or a sidecar "
            f'{file.stem}.json with "units"',
            file=file,
        )
    frame = (sidecar.frame if sidecar is not None else None) or options.frame
    if frame is None:
        raise ConfigurationError(
            "does not say in which frame it is: --frame NAME (j for the joint's own), or a sidecar "
            f'{file.stem}.json with "frame"',
            file=file,
        )
    return UnitAndFrame(*unit, frame)
