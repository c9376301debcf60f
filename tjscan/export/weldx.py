"""A groove's document as a weldx file: frames of the sections, and their points in them."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import from_rounded, inverse, pose, transform
from tjscan.export.document import GrooveDocument

ROOTS = {"j": "joint", "b": "arm base"}
"""What the frame of the result is called in the tree of frames."""


def write_weldx(file: Path, document: GrooveDocument) -> None:
    """Write the frames as a weldx ``CoordinateSystemManager``, and the document beside it.

    Every section is a frame g below the joint (or the arm's base), with its five points as
    ``SpatialData`` in it. The document stands under ``groove``, the frames under
    ``coordinate_systems``.

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
    unit = document.units.length
    root = ROOTS.get(document.frame, document.frame)
    frames = weldx.CoordinateSystemManager(root, "groove")
    for section in document.sections:
        g = section.frame_g
        T = from_rounded(pose(np.array(g.axes).T, g.origin))
        name = f"section {section.index}"
        where = weldx.LocalCoordinateSystem(T[:3, :3], weldx.Q_(T[:3, 3], unit))
        frames.add_cs(name, root, where)
        points = transform(inverse(T), section.points)
        frames.assign_data(weldx.SpatialData(weldx.Q_(points, unit)), f"points of {name}", name)
    tree = {"groove": document.model_dump(mode="json"), "coordinate_systems": frames}
    with weldx.WeldxFile(tree=tree, mode="rw") as made:
        made.write_to(file)
