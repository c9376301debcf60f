from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.file import read_joint
from tjscan.joint.geometry import cylindrical_to_j

CAD = Path(__file__).parents[2] / "cad"
JOINTS = sorted(CAD.glob("?joint-*.toml"))
EXACT = 1e-12

PHI = np.linspace(0, 2 * np.pi, 73)
"""Every five degrees, heel, toe and saddles among them."""


@pytest.fixture(params=JOINTS, ids=lambda file: file.stem)
def joint(request: pytest.FixtureRequest) -> JointDefinition:
    return read_joint(request.param)


def bevel_point(joint: JointDefinition, phi: float, share: float) -> Array:
    """A point of the bevel in frame j, from the land's edge (0) to the outer wall (1)."""
    s = JointGrooveSections(joint, [phi])
    rho, z = (s.land + share * (s.p2 - s.land))[0]
    return cylindrical_to_j(phi, rho, z)


def measured_groove_angle(joint: JointDefinition, phi: float) -> float:
    """Cut the bevel with the plane square to the root line, and measure against the leg."""
    step, share = 1e-5, 1e-4
    root = bevel_point(joint, phi, 0)
    along = bevel_point(joint, phi + step, 0) - bevel_point(joint, phi - step, 0)

    def off_plane(azimuth: float) -> float:
        return float((bevel_point(joint, azimuth, share) - root) @ along)

    cut = brentq(off_plane, phi - 1e-3, phi + 1e-3, xtol=1e-15)
    up = bevel_point(joint, cut, share) - root
    return float(np.arcsin(up @ joint.leg_surface.normal(root) / np.linalg.norm(up)))


def test_groove_angle_in_the_normal_section_is_the_prescribed_one(joint: JointDefinition) -> None:
    for phi in np.linspace(0, np.pi, 13):
        prescribed = joint.groove_angle_for_dihedral(
            joint.leg_surface.dihedral_angle(phi, joint.brace_radius)
        )
        measured = measured_groove_angle(joint, float(phi))
        assert np.rad2deg(measured) == pytest.approx(np.rad2deg(float(prescribed)), abs=0.01)


def test_corners_lie_where_they_belong(joint: JointDefinition) -> None:
    s = JointGrooveSections(joint, PHI)

    def off_leg(rz: Array) -> Array:
        return joint.leg_surface.signed_distances(cylindrical_to_j(PHI, rz[:, 0], rz[:, 1]))

    np.testing.assert_allclose(s.p2[:, 0], joint.brace_radius, atol=EXACT)
    np.testing.assert_allclose(off_leg(s.p4), 0, atol=EXACT)
    np.testing.assert_allclose(off_leg(s.apex), 0, atol=EXACT)
    np.testing.assert_allclose(off_leg(s.land), joint.root_opening, atol=EXACT)
    np.testing.assert_allclose(off_leg(s.land_inner), joint.root_opening, atol=EXACT)
    np.testing.assert_allclose(np.linalg.norm(s.p3 - s.land, axis=1), joint.root_bead, atol=EXACT)
    np.testing.assert_allclose(s.p3, s.land + joint.root_bead * s.bevel, atol=EXACT)
    np.testing.assert_allclose(np.linalg.norm(s.bevel, axis=1), 1)


def test_the_bead_closes_the_groove_evenly(joint: JointDefinition) -> None:
    """The leg's curvature over the root is all that keeps it from perfect symmetry."""
    s = JointGrooveSections(joint, PHI)
    on_bevel = np.linalg.norm(s.p3 - s.apex, axis=1)
    on_leg = np.linalg.norm(s.p4 - s.apex, axis=1)
    np.testing.assert_allclose(on_leg, on_bevel, rtol=0.03)


def test_a_right_angled_joint_is_symmetric() -> None:
    joint = read_joint(CAD / "tjoint-600x457.toml")
    s = JointGrooveSections(joint, PHI)
    for mirrored in (-PHI, np.pi - PHI):
        m = JointGrooveSections(joint, mirrored)
        for name in ("p2", "p3", "p4"):
            np.testing.assert_allclose(getattr(m, name), getattr(s, name), atol=EXACT)


def test_the_papers_root_can_be_welded() -> None:
    """A root pass of 4 to 8 mm is what a welder lays in one go."""
    width = JointGrooveSections(read_joint(CAD / "tjoint-600x457.toml"), PHI).root_width
    assert 4e-3 < width.min() < width.max() < 8e-3


def test_a_groove_at_a_crown_is_plane_trigonometry() -> None:
    """Where both tubes are straight in the section, gap and angle alone make the root."""
    joint = read_joint(CAD / "tjoint-600x457.toml")
    s = JointGrooveSections(joint, [0.0])
    angle = float(s.groove_angle[0])
    side = joint.root_opening / np.sin(angle) + joint.root_bead
    assert s.root_width[0] == pytest.approx(2 * side * np.sin(angle / 2))
    depth = joint.brace_wall - joint.root_face
    assert s.bevel_length[0] == pytest.approx(depth / np.cos(angle))


def test_sections_are_read_only() -> None:
    s = JointGrooveSections(read_joint(CAD / "tjoint-600x457.toml"), [0.0])
    with pytest.raises(ValueError, match="read-only"):
        s.p2[0] = 0
