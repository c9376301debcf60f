"""``tjscan compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

TOLERANCE_EXCEEDED = 3
"""Exit code where the distances exceed the tolerance."""


def compare(
    measured: Path,
    reference: Path,
    *,
    align: Literal["none", "joint", "icp"] = "none",
    tolerance_mm: float | None = None,
    units: Literal["mm", "um", "m"] | None = None,
    reference_units: Literal["mm", "um", "m"] | None = None,
    frame: str | None = None,
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
        Exit with 3 where the 95th percentile of the distances is larger: that of a run's corners
        where they can be compared, else that of the cloud.
    units
        Unit of files that state none, neither themselves nor in a sidecar NAME.json.
    reference_units
        The same for the reference, where it is another.
    frame
        Frame of files that state none: j for the joint's own, or any name.
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
    with show_phase("comparing"):
        ours = read_shape(measured, StatedUnitAndFrame(units, frame))
        theirs = read_shape(reference, StatedUnitAndFrame(reference_units or units, frame))
        tolerance = None if tolerance_mm is None else 1e-3 * tolerance_mm
        comparison = compare_shapes(ours, theirs, align, tolerance)
    print_comparison(comparison, json=json)
    for option, shapes in (
        (units and f"--units {units}", (ours,) if reference_units else (ours, theirs)),
        (reference_units and f"--reference-units {reference_units}", (theirs,)),
    ):
        if option and all(shape.stated.unit_source != "--units" for shape in shapes):
            said = "; ".join(
                f"{s.name} is in {s.stated.unit}, as {s.stated.unit_source} says" for s in shapes
            )
            print_message(f"{option} is not used: {said}")
    if plot is not None:
        write_map(plot, comparison.plot().figure)
        print_message(f"drawn in {plot}")
    if not comparison.passed:
        raise SystemExit(TOLERANCE_EXCEEDED)
