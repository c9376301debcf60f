"""One comparison: what can be measured between two shapes, and how it shows itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tjscan.comparison.alignment import (
    NO_ALIGNMENT,
    Alignment,
    NearestOnReference,
    align_icp,
    align_joints,
    nearest_point_finder_in_cloud,
)
from tjscan.comparison.distance import (
    DeviationDistances,
    MeshDistance,
    corner_to_edge_distances,
    distances_to_cloud,
    median_point_spacing,
)
from tjscan.comparison.shapes import Shape
from tjscan.core.display import Picture, rows_to_html, to_data_frame
from tjscan.core.errors import ConfigurationError
from tjscan.uncertainty.budget import BudgetSummary, aligned_budget, summarise_budget


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Result of a comparison: the aligned shapes, their distances and warnings.

    Parameters
    ----------
    measured, reference : Shape
        What was compared, the former aligned.
    alignment : Alignment
        How it was aligned.
    deviations : tuple of DeviationDistances
        At least one.
    tolerance : float or None
        Metres.
    warnings : tuple of str
        What limits the meaning of the distances.
    uncertainty : BudgetSummary or None
        How sure the corners are once they are aligned; None if that is not known.
    """

    measured: Shape
    reference: Shape
    alignment: Alignment
    deviations: tuple[DeviationDistances, ...]
    tolerance: float | None = None
    warnings: tuple[str, ...] = ()
    uncertainty: BudgetSummary | None = None

    @property
    def passed(self) -> bool:
        """Whether the 95th percentile of the distances that decide is within the tolerance.

        Corners decide if there are any, for they come from segments without ghosts and
        flyers; else every kind of distance does.
        """
        return self.tolerance is None or self.p95[0] <= 1e3 * self.tolerance

    @property
    def p95(self) -> tuple[float, str]:
        """The one 95th percentile that decides, in mm, and of what it is.

        Points of a profile include ghosts and flyers, which lie where no surface is.
        """
        corners = [d for d in self.deviations if d.kind.startswith("corners")]
        largest = max(corners or self.deviations, key=lambda d: d.statistics.p95)
        ghosts = "ghosts and flyers do not count" if corners else "ghosts and flyers count in it"
        return largest.statistics.p95, f"{largest.kind}; {ghosts}"

    def to_pandas(self) -> Any:
        """Table of all distances as a DataFrame of pandas: kind, place and distance in mm.

        Raises
        ------
        ConfigurationError
            If pandas is not installed.
        """
        points = 1e3 * np.concatenate([d.points.reshape(-1, 3) for d in self.deviations])
        distances = [d.distances.ravel() for d in self.deviations]
        kinds = np.repeat([d.kind for d in self.deviations], [len(one) for one in distances])
        places = dict(zip(("x_mm", "y_mm", "z_mm"), points.T, strict=True))
        millimetres = 1e3 * np.concatenate(distances)
        return to_data_frame({"kind": kinds, **places, "distance_mm": millimetres})

    def plot(self) -> Picture:
        """Draw the map of deviations; raises as `maps.deviation_map_figure` does."""
        from tjscan.comparison.maps import deviation_map_figure

        deviation, tolerance = self.deviations[0], self.tolerance
        return Picture(deviation_map_figure(self.measured, self.reference, deviation, tolerance))

    def _repr_html_(self) -> str:
        return rows_to_html(f"{self.measured.name} and {self.reference.name}", self._table_rows())

    def _table_rows(self) -> Iterator[tuple[str, str]]:
        yield "frame", self.reference.stated.frame
        yield "alignment", self.alignment.method
        for d in self.deviations:
            s = d.statistics
            figures = f"median {s.median:.4f}, p95 {s.p95:.4f}, max {s.max:.4f} mm"
            yield f"{d.kind}, {len(d.distances)}", figures
        if self.tolerance is not None:
            verdict = "within" if self.passed else "outside"
            yield "tolerance", f"{1e3 * self.tolerance:g} mm: p95 {verdict}"
        yield "p95", "{:.4f} mm, {}".format(*self.p95)
        yield from (("warning", warning) for warning in self.warnings)


def comparison_to_dict(comparison: Comparison) -> dict[str, Any]:
    """Convert a comparison to a dict for JSON, in mm and degrees; names carry the units."""
    c, a = comparison, comparison.alignment
    return {
        "measured": c.measured.name,
        "reference": c.reference.name,
        "frame": c.reference.stated.frame,
        "units": {
            s.name: {"unit": s.stated.unit, "stated_by": s.stated.unit_source}
            for s in (c.measured, c.reference)
        },
        "alignment": {
            "method": a.method,
            "T_mm": np.column_stack((a.T[:, :3], a.T[:, 3] * (1e3, 1e3, 1e3, 1))).tolist(),
            "moved_mm": 1e3 * a.moved,
            "turned_deg": float(np.degrees(a.rotation_angle)),
            "fitness": a.fitness,
            "residual_rms_mm": 1e3 * a.residual,
            "rounds": a.rounds,
            "note": a.note,
        },
        "tolerance_mm": None if c.tolerance is None else 1e3 * c.tolerance,
        "passed": c.passed,
        "deviations": [
            {
                "kind": d.kind,
                "meaning": d.meaning,
                "signed": d.signed,
                "count": len(d.distances),
                **{
                    f"{name}_mm": getattr(d.statistics, name)
                    for name in ("mean", "rms", "median", "p95", "max")
                },
                "share_within_tolerance": d.within,
            }
            for d in c.deviations
        ],
        "uncertainty": None if c.uncertainty is None else _uncertainty_to_dict(c.uncertainty),
        "warnings": list(c.warnings),
    }


def _uncertainty_to_dict(budget: BudgetSummary) -> dict[str, Any]:
    """Uncertainty of a corner's place, by its components."""
    return {
        "components": [
            {key: getattr(one, key) for key in ("name", "evidence", "shared", "corner_mm")}
            for one in budget.components
        ],
        "combined_corner_mm": budget.combined.corner_mm,
        "expanded_corner_mm": budget.expanded.corner_mm,
        "coverage_factor": budget.coverage_factor,
    }


AlignmentMethod = Literal["none", "joint", "icp"]

SMALLEST_REFERENCE, LARGEST_REFERENCE = 20e-3, 100.0
"""Diagonals of a reference in metres between which its units are accepted."""

LEAST_SIZE_RATIO, LARGEST_SIZE_RATIO = 3e-3, 30.0
"""Size of what was measured over the reference's between which units are accepted: a
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
        message = f"{measured.name} holds no points: what is measured is a run directory or a cloud"
        raise ConfigurationError(message)
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
    found = tuple(_measure_deviations(moved, reference, surface, tolerance))
    if not found:
        raise ConfigurationError(
            f"{reference.name} holds edges only, and {measured.name} no corners to compare with "
            "them: name a run directory, or a mesh or cloud as the reference"
        )
    warnings = tuple(_comparison_warnings(moved, reference, surface))
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
        f"as {shape.stated.unit_source} states"
        for shape in (measured, reference)
    )
    if not SMALLEST_REFERENCE <= theirs <= LARGEST_REFERENCE:
        raise ConfigurationError(f"a reference of such a size is no joint: {sizes}", key="units")
    if not LEAST_SIZE_RATIO <= ours / theirs <= LARGEST_SIZE_RATIO:
        message = f"one of the two has the wrong unit, or they don't belong together: {sizes}"
        raise ConfigurationError(message, key="units")


def _measure_deviations(
    measured: Shape, reference: Shape, surface: MeshDistance | None, tolerance: float | None
) -> Iterator[DeviationDistances]:
    points, corners, cloud = measured.points, measured.corners, reference.points
    if surface is not None and points is not None:
        meaning = "from the nearest point of the surface, positive outside, negative inside"
        distances = surface.signed_distances(points)
        yield DeviationDistances("cloud to mesh", meaning, True, points, distances, tolerance)
    if cloud is not None and points is not None:
        meaning = (
            "from the nearest point of the reference, unsigned; its spacing of "
            f"{1e3 * median_point_spacing(cloud):.3f} mm and its noise are in it"
        )
        distances = distances_to_cloud(points, cloud)
        yield DeviationDistances("cloud to cloud", meaning, False, points, distances, tolerance)
    if corners is None:
        return
    middle = corners[:, 1:4].reshape(-1, 3)
    absent = np.zeros(len(middle), bool) if measured.absent is None else measured.absent.ravel()
    if reference.edges is not None:
        kind = "corners to feature edges"
        meaning = "of p2, p3 and p4, each from its own edge, unsigned"
        distances = corner_to_edge_distances(corners, reference.edges, measured.absent).ravel()
        yield DeviationDistances(kind, meaning, False, middle, distances, tolerance)
    if cloud is not None:
        kind = "corners to reference cloud"
        meaning = (
            "of p2, p3 and p4 from the nearest point of the reference, unsigned: the measure of "
            "Cibicik et al. (2022), section 4"
        )
        distances = np.where(absent, np.nan, distances_to_cloud(middle, cloud))
        yield DeviationDistances(kind, meaning, False, middle, distances, tolerance)


def _comparison_warnings(
    measured: Shape, reference: Shape, surface: MeshDistance | None
) -> Iterator[str]:
    if surface is not None and not surface.facets.watertight:
        yield (
            f"{reference.name} is not watertight: a sign shows the side of the nearest triangle, "
            "and outside is where its normal points"
        )
    for shape in (measured, reference):
        if shape.dropped:
            yield f"{shape.name}: {shape.dropped} points are no finite points, and were left out"
