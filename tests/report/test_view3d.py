"""The view that turns draws what was measured, where it was measured."""

import json
from base64 import b64decode
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tjscan.joint.edges import feature_edges
from tjscan.joint.file import read_joint
from tjscan.report.data import ReportData
from tjscan.report.view3d import groove_view_data
from tjscan.result.wireframe import joint_ghost_mesh

CAD = Path(__file__).parent.parent.parent / "cad" / "tjoint-600x457.toml"

AS_SEEN = 0.05
"""Millimetres: a hundredth of a pixel of a view of a metre would be 0.01 mm."""

CHORD = 60e-6
"""Metres by which a chord over 2.5° leaves a circle of 228.6 mm."""


@pytest.fixture(scope="module")
def scene(data: ReportData) -> dict[str, Any]:
    return groove_view_data(data)


def decoded(text: str) -> np.ndarray[Any, np.dtype[np.int16]]:
    return np.frombuffer(b64decode(text), dtype="<i2")


def test_corners_and_points_stand_where_they_were_measured(
    data: ReportData, scene: dict[str, Any]
) -> None:
    for section, drawn in zip(data.sections, scene["sections"], strict=True):
        np.testing.assert_allclose(drawn["corners"], 1e3 * section.points, atol=1e-3)
    points = decoded(scene["points"]["at"]).reshape(-1, 3) * scene["points"]["unit"]
    points = points + scene["points"]["middle"]
    assert data.shape.points is not None
    assert data.comparison is not None
    assert len(points) == len(data.shape.points)  # without ghosts all lie near the groove
    np.testing.assert_allclose(points, 1e3 * data.shape.points, atol=AS_SEEN)
    np.testing.assert_allclose(
        decoded(scene["points"]["micrometres"]),
        1e6 * data.comparison.deviations[0].distances,
        atol=1,
    )


def test_every_quantity_has_a_value_for_each_section_and_json_holds_all(
    data: ReportData, scene: dict[str, Any]
) -> None:
    json.dumps(scene, allow_nan=False)
    names = [one["name"] for one in scene["quantities"]]
    assert names == [
        "corners to feature edges",
        "groove angle",
        "root width",
        "depth",
        "standard deviation of the corners",
        "deviation, cloud to mesh",
    ]
    angles = [np.degrees(section.measures[0]) for section in data.sections]
    np.testing.assert_allclose(scene["quantities"][1]["values"], angles, atol=1e-4)


def test_a_buried_root_has_no_width_but_an_angle(data: ReportData) -> None:
    one = replace(data.sections[2], conditions=("tack",), absent=("p3", "p4"))
    sections = (*data.sections[:2], one, *data.sections[3:])
    scene = groove_view_data(replace(data, sections=sections))
    by_name = {quantity["name"]: quantity["values"] for quantity in scene["quantities"]}
    assert by_name["root width"][2] is None
    assert by_name["groove angle"][2] is not None
    assert scene["sections"][2]["seen"] == [True, True, False, False, True]


def test_no_groove_is_drawn_where_none_was_seen(data: ReportData, scene: dict[str, Any]) -> None:
    assert scene["joined"] == [[0, 1], [1, 2], [2, 3], [3, 4]]
    far = data.sections[4]
    moved = far.T_r_g.copy()
    moved[:3, 3] += 0.5
    gappy = (*data.sections[:4], replace(far, T_r_g=moved))
    assert groove_view_data(replace(data, sections=gappy))["joined"] == [[0, 1], [1, 2], [2, 3]]


def test_the_designed_joint_lies_on_its_edges() -> None:
    joint = read_joint(CAD)
    vertices, triangles = joint_ghost_mesh(joint)
    assert triangles.min() == 0
    assert triangles.max() == len(vertices) - 1
    edges = feature_edges(joint)
    groove = vertices[np.hypot(vertices[:, 0], vertices[:, 1]) < joint.brace_radius - 1e-6]
    groove = groove[np.abs(joint.leg_surface.signed_distances(groove)) < 30e-3]
    assert len(groove) >= 144
    assert edges.distances(groove).min(axis=1).max() < CHORD
