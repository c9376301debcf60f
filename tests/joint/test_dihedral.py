"""The dihedral angle between fitted tubes, against the joint's own surface."""

from pathlib import Path

import numpy as np
import pytest

from tjscan.joint.file import read_joint
from tjscan.joint.geometry import cylindrical_to_j
from tjscan.joint.tubes.cylinder import Cylinder
from tjscan.joint.tubes.fit import FittedTubes, dihedral_angles, dihedral_sigmas

CAD = Path(__file__).parent.parent.parent / "cad"


def tubes(angle: float, brace: float = 0.2, leg: float = 0.3) -> tuple[Cylinder, Cylinder]:
    """Brace along z, leg in the plane of x and z."""
    axis = np.array((np.sin(angle), 0.0, np.cos(angle)))
    upright = np.array((0.0, 0.0, 1.0))
    return Cylinder(np.zeros(3), upright, brace), Cylinder(np.zeros(3), axis, leg)


@pytest.mark.parametrize("file", ["tjoint-600x457.toml", "yjoint-600x457-60deg.toml"])
def test_it_is_the_angle_that_the_joint_s_surface_makes_with_the_brace(file: str) -> None:
    joint = read_joint(CAD / file)
    phi = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    surface = joint.leg_surface
    rho = np.full(len(phi), joint.brace_radius)
    points = cylindrical_to_j(phi, rho, surface.height(phi, rho))
    legs = [
        Cylinder(
            np.zeros(3),
            np.array((sign * np.sin(joint.angle), 0, np.cos(joint.angle))),
            joint.leg_radius,
        )
        for sign in (1, -1)
    ]
    brace = Cylinder(np.zeros(3), np.array((0.0, 0.0, 1.0)), joint.brace_radius)
    leg = min(legs, key=lambda one: float(np.abs(one.signed_distances(points)).max()))
    np.testing.assert_allclose(
        dihedral_angles(brace, leg, points), surface.dihedral_angle(phi, rho), atol=1e-9
    )


def test_a_t_joint_has_90_degrees_at_its_crowns_and_most_at_its_saddles() -> None:
    brace, leg = tubes(np.radians(90))
    crown, saddle = np.array((0.2, 0, 0.3)), np.array((0, 0.2, np.sqrt(0.3**2 - 0.2**2)))
    found = np.degrees(dihedral_angles(brace, leg, np.array((crown, saddle))))
    assert found == pytest.approx((90, 90 + np.degrees(np.arcsin(0.2 / 0.3))))


def test_its_standard_deviation_is_that_of_drawn_tubes() -> None:
    brace, leg = tubes(np.radians(60))
    rng = np.random.default_rng(0)
    root = 1e-3 * rng.standard_normal((10, 10))
    fitted = FittedTubes(brace, leg, root @ root.T, 1.0, 0.0)
    points = np.array(((0.2, 0, 0.35), (0.1, 0.17, 0.3)))
    drawn = [
        dihedral_angles(brace.boxplus(step[:5]), leg.boxplus(step[5:]), points)
        for step in (root @ rng.standard_normal((10, 1500))).T
    ]
    np.testing.assert_allclose(dihedral_sigmas(fitted, points), np.std(drawn, axis=0), rtol=0.08)
