"""What is built from a joint's definition: STL, PLY, edges and a sidecar that explains them."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Literal

import numpy as np

from tjscan.core.config import StrictFileModel
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import FeatureEdges, JointGrooveSections, feature_edges
from tjscan.joint.file import JointFile
from tjscan.joint.mesh import TriangleMesh, build_joint_mesh, largest_chord_error

MM_PER_METRE = 1e3


class JointSidecar(StrictFileModel):
    """Content of ``NAME.json`` beside a joint's mesh: units, frame and dimensions.

    Every length is in millimetres, every angle in degrees, every point in frame j.
    """

    name: str
    units: Literal["mm"] = "mm"
    frame: Literal["j"] = "j"
    axes: str = (
        "z up the brace's axis, x along the leg (square to z, on the heel's side), "
        "origin where the axes cross, azimuth from x towards y"
    )
    joint: JointFile
    vertices: int
    triangles: int
    chord_error_mm: float
    edge_points: int
    intersection_length_mm: float
    dihedral_deg: tuple[float, float]
    root_width_mm: tuple[float, float]


def build_and_write_joint(definition: JointDefinition, directory: Path) -> JointSidecar:
    """Build a joint and write ``NAME.stl``, ``NAME.ply``, ``edges.csv`` and ``NAME.json``.

    No file is replaced before all of them are written.

    Raises
    ------
    ConfigurationError
        If the joint's parts don't join into one solid.
    RecordingError
        If the directory can't be written to.
    """
    mesh, edges = build_joint_mesh(definition), feature_edges(definition)
    sections = JointGrooveSections(definition, edges.phi)
    length = definition.leg_surface.arc_length(definition.brace_radius, 0, 2 * np.pi)
    sidecar = JointSidecar(
        name=definition.name,
        joint=JointFile.from_definition(definition),
        vertices=len(mesh.vertices),
        triangles=len(mesh.triangles),
        chord_error_mm=round(MM_PER_METRE * largest_chord_error(definition), 6),
        edge_points=len(edges.phi),
        intersection_length_mm=round(MM_PER_METRE * length, 3),
        dihedral_deg=_least_and_largest(np.rad2deg(sections.dihedral)),
        root_width_mm=_least_and_largest(MM_PER_METRE * sections.root_width),
    )
    with write_files_atomically(directory) as draft:
        _write_mesh(draft / definition.name, mesh)
        _write_edges(draft / "edges.csv", edges)
        text = sidecar.model_dump_json(indent=2) + "\n"
        (draft / f"{definition.name}.json").write_text(text, encoding="utf-8")
    return sidecar


def _write_mesh(stem: Path, mesh: TriangleMesh) -> None:
    import trimesh

    solid = trimesh.Trimesh(MM_PER_METRE * mesh.vertices, mesh.triangles, process=False)
    for kind in ("stl", "ply"):
        stem.with_name(f"{stem.name}.{kind}").write_bytes(solid.export(file_type=kind))


def _write_edges(file: Path, edges: FeatureEdges) -> None:
    azimuths = np.rad2deg(edges.phi)
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("edge", "azimuth_deg", "x_mm", "y_mm", "z_mm"))
        for name, line in (("p2", edges.p2), ("p3", edges.p3), ("p4", edges.p4)):
            rows = np.column_stack((azimuths, MM_PER_METRE * line.points_j))
            writer.writerows((name, *(f"{value:.4f}" for value in row)) for row in rows)


def _least_and_largest(values: Array) -> tuple[float, float]:
    return round(float(values.min()), 3), round(float(values.max()), 3)
