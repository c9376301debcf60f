"""A groove as a weldx file: frames of the sections, and their points in them."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import inverse_pose, pose_from_rounded_matrix, transform_points
from tjscan.core.provenance import Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.result.document import build_sections_document

ROOTS = {"j": "joint", "b": "arm base"}
"""What the frame of the result is called in the tree of frames."""


def write_weldx(
    file: Path,
    sections: Sequence[MeasuredSection],
    provenance: Provenance,
    run: str,
    calibration: str,
) -> None:
    """Write section frames and points as a weldx file, with the JSON document beside them.

    Every section is a frame g below the joint (or the arm's base), with its five points as
    ``SpatialData`` in it. The document stands under ``groove``, the frames under
    ``coordinate_systems``.

    Parameters
    ----------
    file : Path
        The file to write.
    sections, provenance, run, calibration
        As of `tjscan.result.document.sections_to_json`.

    Raises
    ------
    ConfigurationError
        If the extra is not installed.
    """
    if find_spec("weldx") is None:
        raise ConfigurationError(
            "weldx files need an extra package: pip install 'tjscan[weldx]'", key="--to"
        )
    weldx: Any = import_module("weldx")
    unit = provenance.length
    per_metre = 1e3 if unit == "mm" else 1.0
    root = ROOTS.get(provenance.frame, provenance.frame)
    frames = weldx.CoordinateSystemManager(root, "groove")
    for k, section in enumerate(sections):
        T = pose_from_rounded_matrix(section.T_r_g)  # weldx is strict about rotations
        name = f"section {k}"
        where = weldx.LocalCoordinateSystem(T[:3, :3], weldx.Q_(per_metre * T[:3, 3], unit))
        frames.add_cs(name, root, where)
        points = per_metre * transform_points(inverse_pose(T), section.points)
        frames.assign_data(weldx.SpatialData(weldx.Q_(points, unit)), f"points of {name}", name)
    groove = build_sections_document(sections, provenance, run, calibration).model_dump(mode="json")
    with weldx.WeldxFile(tree={"groove": groove, "coordinate_systems": frames}, mode="rw") as made:
        made.write_to(file)
