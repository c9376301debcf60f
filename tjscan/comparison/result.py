"""What a comparison found: it shows itself, as a table, a map and JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tjscan.comparison.alignment import Alignment
from tjscan.comparison.distance import DeviationDistances
from tjscan.comparison.shapes import Shape
from tjscan.core.display import Picture, rows_to_html, to_data_frame
from tjscan.uncertainty.summary import BudgetSummary


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
        if self.tolerance is None:
            return True
        corners = [d for d in self.deviations if d.kind.startswith("corners")]
        limit = 1e3 * self.tolerance
        return all(d.statistics.p95 <= limit for d in corners or self.deviations)

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
        return to_data_frame(
            {"kind": kinds, **places, "distance_mm": 1e3 * np.concatenate(distances)}
        )

    def plot(self) -> Picture:
        """Draw the map of deviations; raises as `maps.deviation_map_figure` does."""
        from tjscan.comparison.maps import deviation_map_figure

        deviation, tolerance = self.deviations[0], self.tolerance
        return Picture(deviation_map_figure(self.measured, self.reference, deviation, tolerance))

    def _repr_html_(self) -> str:
        return rows_to_html(f"{self.measured.name} and {self.reference.name}", self._rows())

    def _rows(self) -> Iterator[tuple[str, str]]:
        yield "frame", self.reference.stated.frame
        yield "alignment", self.alignment.method
        for d in self.deviations:
            s = d.statistics
            yield (
                f"{d.kind}, {len(d.distances)}",
                f"median {s.median:.4f}, p95 {s.p95:.4f}, max {s.max:.4f} mm",
            )
        if self.tolerance is not None:
            verdict = "within" if self.passed else "outside"
            yield "tolerance", f"{1e3 * self.tolerance:g} mm: p95 {verdict}"
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
                "mean_mm": d.statistics.mean,
                "rms_mm": d.statistics.rms,
                "median_mm": d.statistics.median,
                "p95_mm": d.statistics.p95,
                "max_mm": d.statistics.max,
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
            {
                "name": one.name,
                "evidence": one.evidence,
                "shared": one.shared,
                "corner_mm": one.corner_mm,
            }
            for one in budget.components
        ],
        "combined_corner_mm": budget.combined.corner_mm,
        "expanded_corner_mm": budget.expanded.corner_mm,
        "coverage_factor": budget.coverage_factor,
    }
