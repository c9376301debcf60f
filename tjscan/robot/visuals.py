"""The bodies of an arm's links, as its URDF draws them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, pose
from tjscan.robot.settings import Box, Capsule, Cylinder, Solid

if TYPE_CHECKING:
    import trimesh

DRAWN_CYLINDER_SIDES: Final = 24
"""Sides of a drawn cylinder."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkMesh:
    """What a link looks like.

    Parameters
    ----------
    link : str
        Its name in the URDF.
    vertices : ndarray, shape (n, 3)
        In the link's frame, metres.
    triangles : ndarray of int, shape (m, 3)
        Numbers of each one's corners.
    """

    link: str
    vertices: Array
    triangles: Any


def link_meshes(urdf: Path) -> Iterator[LinkMesh]:
    """Yield the body of each link that a URDF draws.

    Parameters
    ----------
    urdf : Path
        Its meshes are sought beside it; those named by ``package://`` are left out.

    Raises
    ------
    ConfigurationError
        If the file can't be read.
    """
    import trimesh

    try:
        root = ElementTree.parse(urdf).getroot()
        for link in root.iter("link"):
            parts = [_visual_mesh(visual, urdf.parent) for visual in link.iter("visual")]
            found = [part for part in parts if part is not None]
            if found:
                whole = trimesh.util.concatenate(found)
                yield LinkMesh(link.get("name", ""), whole.vertices, whole.faces)
    except (OSError, ElementTree.ParseError, ValueError, KeyError) as error:
        raise ConfigurationError(f"can't be drawn: {error}", file=urdf) from error


def solid_mesh(solid: Solid) -> trimesh.Trimesh:
    """Mesh of a solid, in the frame that its pose is given in."""
    import trimesh

    match solid.shape:
        case Box(size):
            mesh = trimesh.creation.box(size)
        case Cylinder(radius, length):
            mesh = trimesh.creation.cylinder(radius, length, sections=DRAWN_CYLINDER_SIDES)
        case Capsule(radius, length):
            sides = (DRAWN_CYLINDER_SIDES, DRAWN_CYLINDER_SIDES // 2)
            mesh = trimesh.creation.capsule(length, radius, count=sides)
            mesh.apply_translation((0, 0, -mesh.bounds.mean(axis=0)[2]))
    mesh.apply_transform(solid.T)
    return mesh


def _visual_mesh(visual: ElementTree.Element, beside: Path) -> trimesh.Trimesh | None:
    import trimesh

    shape = next(iter(visual.find("geometry") or ()), None)
    if shape is None:
        return None
    match shape.tag:
        case "box":
            mesh = trimesh.creation.box(_parse_numbers(shape.get("size", "")))
        case "cylinder":
            radius, length = float(shape.attrib["radius"]), float(shape.attrib["length"])
            mesh = trimesh.creation.cylinder(radius, length, sections=DRAWN_CYLINDER_SIDES)
        case "sphere":
            radius = float(shape.attrib["radius"])
            mesh = trimesh.creation.uv_sphere(radius, count=(12, DRAWN_CYLINDER_SIDES))
        case "mesh" if not shape.attrib["filename"].startswith("package://"):
            file = beside / shape.attrib["filename"].removeprefix("file://")
            mesh = trimesh.load(file, force="mesh")
            mesh.apply_scale(_parse_numbers(shape.get("scale", "1 1 1")))
        case _:
            return None
    if (origin := visual.find("origin")) is not None:
        turn = Rotation.from_euler("xyz", _parse_numbers(origin.get("rpy", "0 0 0")))
        mesh.apply_transform(pose(turn.as_matrix(), _parse_numbers(origin.get("xyz", "0 0 0"))))
    return mesh


def _parse_numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])
