"""What is compared: points, meshes and edges, in metres, with their unit and frame as stated.

A file's sidecar states them, else the user; nothing is guessed.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.comparison.distance import IndexArray
from tjscan.core.config import validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import read_small_file
from tjscan.core.frames import Array, Mask, readonly_copy, transform_points
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import FeatureEdges
from tjscan.joint.file import JointFile
from tjscan.laser.files.format import METRES_PER_UNIT
from tjscan.uncertainty.budget import UncertaintyBudget


@dataclass(frozen=True, slots=True)
class UnitAndFrame:
    """Unit and frame of a shape's file, and what states them.

    Parameters
    ----------
    unit : str
        mm, um or m; what the file's numbers are.
    unit_source : str
        What states it, for instance ``the sidecar plate.json``.
    frame : str
        Letter or name of the frame.
    """

    unit: str
    unit_source: str
    frame: str


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A surface of triangles.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        Metres.
    triangles : ndarray of int, shape (m, 3)
        Counter-clockwise seen from outside.
    """

    vertices: Array
    triangles: IndexArray


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Shape to compare, from a file or a run: mesh, cloud, corners or joint.

    Parameters
    ----------
    name : str
        What to call it.
    stated : UnitAndFrame
        Its unit and frame.
    points : ndarray, shape (n, 3), optional
        A cloud, metres.
    corners : ndarray, shape (k, 5, 3), optional
        The five points of each section of a run, metres.
    absent : ndarray of bool, shape (k, 3), optional
        Which of p2, p3 and p4 were not seen.
    mesh : Mesh, optional
        Its surface.
    edges : FeatureEdges, optional
        The edges of a joint's groove, in frame j.
    dropped : int
        How many points of the file were no finite points, and left out.
    is_in_joint_frame : bool
        Whether its frame is its joint's own: by definition, or as found in its own data.
    budget : UncertaintyBudget, optional
        Of the corners of a run.
    wall_normals : ndarray, shape (k, 2, 3), optional
        Out of the brace's wall and the leg at each section of a run.
    """

    name: str
    stated: UnitAndFrame
    points: Array | None = None
    corners: Array | None = None
    absent: Mask | None = None
    mesh: Mesh | None = None
    edges: FeatureEdges | None = None
    dropped: int = 0
    is_in_joint_frame: bool = False
    budget: UncertaintyBudget | None = None
    wall_normals: Array | None = None

    @property
    def extent(self) -> float:
        """Size of the shape: diagonal of a box about it, in metres, without a cloud's outliers."""
        if self.mesh is not None:
            return float(np.linalg.norm(np.ptp(self.mesh.vertices, axis=0)))
        if self.points is not None:
            low, high = np.percentile(self.points, (1, 99), axis=0)
            return float(np.linalg.norm(high - low))
        if self.edges is not None:
            return float(np.linalg.norm(np.ptp(self.edges.p2.points_j, axis=0)))
        return float("nan")

    def transformed(self, T: Array, frame: str) -> Shape:
        """The same shape in another frame.

        Parameters
        ----------
        T : ndarray, shape (4, 4)
            Pose of this shape's frame in the other one.
        frame : str
            Name of the other one.
        """
        return Shape(
            self.name,
            UnitAndFrame(self.stated.unit, self.stated.unit_source, frame),
            None if self.points is None else readonly_copy(transform_points(T, self.points)),
            None if self.corners is None else readonly_copy(transform_points(T, self.corners)),
            self.absent,
            dropped=self.dropped,
            budget=None if self.budget is None else self.budget.rotated_budget(T[:3, :3]),
            wall_normals=None if self.wall_normals is None else self.wall_normals @ T[:3, :3].T,
        )


MOST_SIDECAR_BYTES: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class UserUnitAndFrame:
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
class ShapeSidecar:
    """Sidecar file ``NAME.json`` beside ``NAME.stl``: its unit and frame, and the joint."""

    file: Path
    units: str | None = None
    frame: str | None = None
    joint: JointDefinition | None = None


def read_sidecar(file: Path) -> ShapeSidecar:
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
        message = f"unknown unit {units!r}; one of {', '.join(METRES_PER_UNIT)}"
        raise ConfigurationError(message, file=file, key="units")
    if frame is not None and not isinstance(frame, str):
        raise ConfigurationError("a frame is named by a word", file=file, key="frame")
    if joint is None:
        return ShapeSidecar(file, units, frame)
    if not isinstance(joint, dict):
        raise ConfigurationError("a joint is a table", file=file, key="joint")
    # JSON holds lists, which the file's model takes for tuples.
    definition = validate_table(JointFile, joint, file).definition(file.stem)
    return ShapeSidecar(file, units, frame, definition)


def find_sidecar(file: Path) -> ShapeSidecar | None:
    """Find and read the sidecar beside a file; None if there is none."""
    beside = file.with_suffix(".json")
    return read_sidecar(beside) if beside != file and beside.is_file() else None


def resolve_unit_and_frame(
    file: Path,
    options: UserUnitAndFrame,
    sidecar: ShapeSidecar | None,
    own: tuple[str, str] | None = None,
) -> UnitAndFrame:
    """Decide the unit and frame of a file from what the user and the sidecar state.

    Parameters
    ----------
    file : Path
        The file.
    options : UserUnitAndFrame
        What the user states.
    sidecar : ShapeSidecar or None
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
        message = f"{own[1]} states {own[0]}, {beside[1]} states {beside[0]}"
        raise ConfigurationError(message, file=file, key="units")
    asked = None if options.units is None else (options.units, "--units")
    unit = own or beside or asked
    if unit is None:
        raise ConfigurationError(
            "does not state what its numbers are: --units mm, um or m, or a sidecar "
            f'{file.stem}.json with "units"',
            file=file,
        )
    frame = (sidecar.frame if sidecar is not None else None) or options.frame
    if frame is None:
        raise ConfigurationError(
            "does not state in which frame it is: --frame NAME (j for the joint's own), or a "
            f'sidecar {file.stem}.json with "frame"',
            file=file,
        )
    return UnitAndFrame(*unit, frame)
