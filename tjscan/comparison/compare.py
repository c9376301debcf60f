"""One comparison: what can be measured between two shapes, aligned as asked."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from tjscan.comparison.alignment import (
    NO_ALIGNMENT,
    Alignment,
    NearestOnReference,
    align_icp,
    nearest_point_finder_in_cloud,
)
from tjscan.comparison.distance import (
    DeviationDistances,
    corner_to_edge_distances,
    distances_to_cloud,
    median_point_spacing,
)
from tjscan.comparison.joint_alignment import align_joints
from tjscan.comparison.result import Comparison
from tjscan.comparison.shapes import Shape
from tjscan.comparison.surface import MeshDistance
from tjscan.core.errors import ConfigurationError
from tjscan.uncertainty.alignment import aligned_budget
from tjscan.uncertainty.summary import BudgetSummary, summarise_budget

AlignmentMethod = Literal["none", "joint", "icp"]

SMALLEST_REFERENCE, LARGEST_REFERENCE = 20e-3, 100.0
"""Diagonals of a reference in metres between which its units are accepted."""

LEAST_SIZE_RATIO, LARGEST_SIZE_RATIO = 3e-3, 30.0
"""Size of what was measured over that of the reference between which units are accepted: a
mistaken unit is off by 1000."""


def check_tolerance(tolerance: float | None) -> None:
    """Refuse a tolerance that nothing, or everything, could keep, as a ConfigurationError."""
    if tolerance is not None and not 0 < tolerance < np.inf:
        raise ConfigurationError("a tolerance is larger than zero", key="tolerance-mm")


def compare_shapes(
    measured: Shape,
    reference: Shape,
    align: AlignmentMethod = "none",
    tolerance: float | None = None,
) -> Comparison:
    """Compare what was measured with a reference.

    Parameters
    ----------
    measured : Shape
        A cloud, or a run with its cloud and corners.
    reference : Shape
        A mesh, a cloud, or edges.
    align : str
        ``none``: both are in the same frame. ``joint``: their tubes are found, and the frames
        that these make are brought together. ``icp``: they are nearly in the same frame, and
        the rest is found.
    tolerance : float, optional
        Metres.

    Raises
    ------
    ConfigurationError
        If the two can't be compared: other frames, other units, nothing in common.
    ComparisonRefused
        If the points do not hold an alignment.
    """
    check_tolerance(tolerance)
    if measured.points is None:
        raise ConfigurationError(
            f"{measured.name} holds no points: what is measured is a run directory or a cloud"
        )
    check_plausible_sizes(measured, reference)
    theirs, ours = reference.stated.frame, measured.stated.frame
    if align == "none" and theirs != ours:
        raise ConfigurationError(
            f"{measured.name} is in frame {ours}, {reference.name} in frame {theirs}: without "
            "alignment both must be in one. See --align"
        )
    surface = None
    if reference.mesh is not None:
        surface = MeshDistance(reference.mesh.vertices, reference.mesh.triangles)
    alignment = NO_ALIGNMENT
    if align == "icp":
        if surface is not None:
            partner: NearestOnReference = surface.nearest_points_and_normals
        elif reference.points is not None:
            partner = nearest_point_finder_in_cloud(reference.points)
        else:
            raise ConfigurationError(f"{reference.name} holds edges only: nothing to align to")
        alignment = align_icp(measured.points, partner)
    elif align == "joint":
        alignment = align_joints(measured, reference, surface)
    moved = measured.transformed(alignment.T, theirs)
    found = tuple(_deviations(moved, reference, surface, tolerance))
    if not found:
        raise ConfigurationError(
            f"{reference.name} holds edges only, and {measured.name} no corners to compare with "
            "them: name a run directory, or a mesh or cloud as the reference"
        )
    warnings = tuple(_warnings(moved, reference, surface))
    if alignment.note:
        warnings = (*warnings, alignment.note)
    uncertainty = _corner_uncertainty(moved, alignment, in_joint=measured.is_in_joint_frame)
    return Comparison(moved, reference, alignment, found, tolerance, warnings, uncertainty)


def _corner_uncertainty(
    measured: Shape, alignment: Alignment, *, in_joint: bool
) -> BudgetSummary | None:
    """How sure the aligned corners are: what the alignment takes back does no harm."""
    budget, corners, normals = measured.budget, measured.corners, measured.wall_normals
    if budget is None or corners is None:
        return None
    # What is in its joint's own frame was aligned when that was found.
    if alignment.method == "icp" or (alignment.method == "joint" and not in_joint):
        if normals is None:
            return None
        budget = aligned_budget(budget, corners, normals, by_tubes=alignment.method == "joint")
    absent = np.zeros((len(corners), 3), bool) if measured.absent is None else measured.absent
    return summarise_budget(budget, ~absent)


def check_plausible_sizes(measured: Shape, reference: Shape) -> None:
    """Refuse shapes that no joint has, or of sizes that don't belong together.

    Parameters
    ----------
    measured, reference : Shape
        Both in metres, as their stated units give them.

    Raises
    ------
    ConfigurationError
        Millimetres given as metres, or the reverse, end here.
    """
    ours, theirs = measured.extent, reference.extent
    sizes = "; ".join(
        f"{shape.name} is {shape.extent:.3g} m across in {shape.stated.unit}, "
        f"as {shape.stated.unit_source} says"
        for shape in (measured, reference)
    )
    if not SMALLEST_REFERENCE <= theirs <= LARGEST_REFERENCE:
        raise ConfigurationError(f"a reference of such a size is no joint: {sizes}", key="units")
    if not LEAST_SIZE_RATIO <= ours / theirs <= LARGEST_SIZE_RATIO:
        raise ConfigurationError(
            f"one of the two has the wrong unit, or they don't belong together: {sizes}",
            key="units",
        )


def _deviations(
    measured: Shape, reference: Shape, surface: MeshDistance | None, tolerance: float | None
) -> Iterator[DeviationDistances]:
    points, corners = measured.points, measured.corners
    if surface is not None and points is not None:
        yield DeviationDistances(
            "cloud to mesh",
            "from the nearest point of the surface, positive outside, negative inside",
            True,
            points,
            surface.signed_distances(points),
            tolerance,
        )
    if reference.points is not None and points is not None:
        yield DeviationDistances(
            "cloud to cloud",
            "from the nearest point of the reference, unsigned; its spacing of "
            f"{1e3 * median_point_spacing(reference.points):.3f} mm and its noise are in it",
            False,
            points,
            distances_to_cloud(points, reference.points),
            tolerance,
        )
    if corners is None:
        return
    middle = corners[:, 1:4].reshape(-1, 3)
    absent = np.zeros(len(middle), bool) if measured.absent is None else measured.absent.ravel()
    if reference.edges is not None:
        yield DeviationDistances(
            "corners to feature edges",
            "of p2, p3 and p4, each from its own edge, unsigned",
            False,
            middle,
            corner_to_edge_distances(corners, reference.edges, measured.absent).ravel(),
            tolerance,
        )
    if reference.points is not None:
        yield DeviationDistances(
            "corners to reference cloud",
            "of p2, p3 and p4 from the nearest point of the reference, unsigned: the measure of "
            "Cibicik et al. (2022), section 4",
            False,
            middle,
            np.where(absent, np.nan, distances_to_cloud(middle, reference.points)),
            tolerance,
        )


def _warnings(measured: Shape, reference: Shape, surface: MeshDistance | None) -> Iterator[str]:
    if surface is not None and not surface.watertight:
        yield (
            f"{reference.name} is not watertight: a sign shows the side of the nearest triangle, "
            "and outside is where its normal points"
        )
    for shape in (measured, reference):
        if shape.dropped:
            yield f"{shape.name}: {shape.dropped} points are no finite points, and were left out"
