"""The deviation map: where points of a section are drawn."""

from pathlib import Path

import numpy as np
import pytest

from tjscan.comparison.maps import CornerCurves
from tjscan.core.frames import Array
from tjscan.joint.edges import JointGrooveSections, feature_edges
from tjscan.joint.file import read_joint
from tjscan.joint.geometry import cylindrical_to_j

CAD = Path(__file__).parent.parent.parent / "cad"

CHORD = 1e-5
"""Metres: between two azimuths of the table the lines are taken for straight."""


@pytest.fixture(params=["tjoint-600x457", "yjoint-600x457-60deg"])
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def lines(name: str) -> CornerCurves:
    edges = feature_edges(read_joint(CAD / f"{name}.toml"))
    points = np.stack([line.points_j for line in (edges.p2, edges.p3, edges.p4)], axis=1)
    return CornerCurves(points, closed=True)


PHI = np.radians(np.arange(-179.7, 180, 7.0))


def test_the_way_along_a_section_is_its_arc_length_from_p3(name: str) -> None:
    s = JointGrooveSections(read_joint(CAD / f"{name}.toml"), PHI)
    bevel = np.linalg.norm(s.p2 - s.p3, axis=1)
    root = np.linalg.norm(s.p4 - s.p3, axis=1)

    def along(rz: Array) -> Array:
        return lines(name).positions_along_section(cylindrical_to_j(PHI, rz[:, 0], rz[:, 1]))

    np.testing.assert_allclose(along(s.p3), 0, atol=CHORD)
    np.testing.assert_allclose(along((s.p2 + s.p3) / 2), bevel / 2, atol=CHORD)
    np.testing.assert_allclose(along((s.p4 + s.p3) / 2), -root / 2, atol=CHORD)
    np.testing.assert_allclose(along(s.p2 + np.array((0, 0.03))), bevel + 0.03, atol=CHORD)


def test_points_on_the_leg_are_as_far_out_as_they_lie_from_p4(name: str) -> None:
    joint = read_joint(CAD / f"{name}.toml")
    s = JointGrooveSections(joint, PHI)
    out = joint.leg_surface.points_j(PHI, s.p4[:, 0] + 0.03)
    foot = cylindrical_to_j(PHI, s.p4[:, 0], s.p4[:, 1])
    root = np.linalg.norm(s.p4 - s.p3, axis=1)
    expected = -root - np.linalg.norm(out - foot, axis=1)
    np.testing.assert_allclose(lines(name).positions_along_section(out), expected, atol=CHORD)
