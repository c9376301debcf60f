"""``tjscan compare``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from cyclopts import Parameter

TOLERANCE_EXCEEDED: Final = 3
"""Exit code if the distances exceed the tolerance."""

LengthUnit = Literal["mm", "um", "m"]


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class StatedUnitOptions:
    """Units and frame of files that state none.

    Parameters
    ----------
    units
        Unit of files that state none, neither themselves nor in a sidecar NAME.json.
    reference_units
        The same for the reference, if it is another.
    frame
        Frame of files that state none: j for the joint's own, or any name.
    """

    units: LengthUnit | None = None
    reference_units: LengthUnit | None = None
    frame: str | None = None


def compare(
    measured: Path,
    reference: Path,
    *,
    align: Literal["none", "joint", "icp"] = "none",
    tolerance_mm: float | None = None,
    stated: StatedUnitOptions | None = None,
    plot: Path | None = None,
    json: bool = False,
) -> None:
    """Compare a run or a cloud with a mesh, a cloud or a joint.

    Parameters
    ----------
    measured
        A run directory, or a cloud: PLY, PCD, XYZ, CSV, E57.
    reference
        A joint's TOML, a mesh (STL, PLY, OBJ, 3MF, STEP), a cloud, or a joint's edges.csv.
    align
        none: both are given in one frame. joint: leg and brace are found in both and aligned.
        icp: both are nearly aligned already, and iterative closest points finds the rest.
    tolerance_mm
        Exit with 3 if the 95th percentile of the distances is larger: of a run's corners
        if they can be compared, else of the cloud.
    plot
        Draw the deviation, unwrapped over the azimuth, into this PNG.
    json
        Print the comparison as JSON on stdout.
    """
    from tjscan.cli.output.comparison import print_comparison
    from tjscan.cli.output.console import print_message, show_phase
    from tjscan.comparison.compare import compare_shapes
    from tjscan.comparison.maps import check_map_file, write_map
    from tjscan.comparison.sidecar import StatedUnitAndFrame
    from tjscan.result.shapes import read_shape

    if plot is not None:
        check_map_file(plot)
    o = stated or StatedUnitOptions()
    with show_phase("comparing"):
        ours = read_shape(measured, StatedUnitAndFrame(o.units, o.frame))
        theirs = read_shape(reference, StatedUnitAndFrame(o.reference_units or o.units, o.frame))
        tolerance = None if tolerance_mm is None else 1e-3 * tolerance_mm
        comparison = compare_shapes(ours, theirs, align, tolerance)
    print_comparison(comparison, json=json)
    for option, unit, shapes in (
        ("--units", o.units, (ours,) if o.reference_units else (ours, theirs)),
        ("--reference-units", o.reference_units, (theirs,)),
    ):
        if unit and all(shape.stated.unit_source != "--units" for shape in shapes):
            sources = "; ".join(
                f"{s.name} is in {s.stated.unit}, as {s.stated.unit_source} states" for s in shapes
            )
            print_message(f"{option} {unit} is not used: {sources}")
    if plot is not None:
        write_map(plot, comparison.plot().figure)
        print_message(f"drawn in {plot}")
    if not comparison.passed:
        raise SystemExit(TOLERANCE_EXCEEDED)
