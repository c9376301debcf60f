"""What is compared: points, meshes and edges, in metres, with what their files state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tjscan.comparison.surface import IndexArray
from tjscan.core.frames import Array, readonly_copy, transform_points
from tjscan.joint.edges import FeatureEdges
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
    absent: NDArray[np.bool_] | None = None
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
            budget=None if self.budget is None else self.budget.rotated(T[:3, :3]),
            wall_normals=None if self.wall_normals is None else self.wall_normals @ T[:3, :3].T,
        )
