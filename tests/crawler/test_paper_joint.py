"""The paper's reading of the joint, and what it is worth."""

import numpy as np
import pytest
from hull_views import ARC_20, DEFAULT, EXACT, mirrored, see
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.crawler.paper_joint import PaperJointReader, polygon_barycentre, read_joint_as_paper
from tjscan.joint.hull import HullJoint
from tjscan.laser.profile import Profile
from tjscan.laser.section_laser import SectionLaserModel, SectionLaserPose

ONE_COLUMN = 0.3e-3
"""Metres between columns: what an edge is good to."""

corners = st.tuples(st.floats(-0.1, 0.1), st.floats(0.1, 0.2))


@given(a=corners, b=corners, c=corners)
def test_barycentre_of_a_triangle_is_the_mean_of_its_corners(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]
) -> None:
    triangle = np.array((a, b, c))
    edges = triangle[1:] - triangle[0]
    if abs(np.linalg.det(edges)) < 1e-4:
        return
    np.testing.assert_allclose(polygon_barycentre(triangle), triangle.mean(axis=0), atol=1e-9)


def test_line_has_no_barycentre() -> None:
    with pytest.raises(GrooveNotFound):
        polygon_barycentre(np.array([(0.0, 0.1), (0.01, 0.1), (0.02, 0.1)]))


@given(offset=st.floats(-5e-3, 5e-3))
def test_clean_profile_is_read_to_a_column(offset: float) -> None:
    profile = see(HullJoint(), np.random.default_rng(0), EXACT, SectionLaserPose(offset=offset))
    edges, barycentre = read_joint_as_paper(profile)
    assert barycentre[0] == pytest.approx(-offset, abs=ONE_COLUMN)
    # Smoothing rounds the edges off over its window.
    np.testing.assert_allclose(edges[:, 0], (-15e-3 - offset, 15e-3 - offset), atol=1.5e-3)
    _, other = read_joint_as_paper(mirrored(profile))
    np.testing.assert_allclose(other * (-1, 1), barycentre, atol=1e-9)


def test_the_papers_method_takes_the_barycentre_for_the_joint() -> None:
    pose = SectionLaserPose(offset=2e-3)
    profile = see(HullJoint(), np.random.default_rng(0), EXACT, pose)
    placement = PaperJointReader().read(profile, 0.0)
    assert placement.centre == read_joint_as_paper(profile)[1][0]
    assert placement.hull_z == pytest.approx(profile.z_s.min(), abs=0.5e-3)
    assert placement.roll == pytest.approx(0.0, abs=0.03)


def errors(joint: HullJoint, model: SectionLaserModel) -> Array:
    rng = np.random.default_rng(1)
    found = []
    for _ in range(60):
        try:
            found.append(read_joint_as_paper(see(joint, rng, model))[1][0])
        except GrooveNotFound:
            found.append(np.nan)
    return np.array(found)


def test_barycentre_is_good_to_a_tenth_of_a_millimetre_without_arc_light() -> None:
    assert np.abs(errors(HullJoint(), DEFAULT)).max() < 0.1e-3


def test_high_low_and_arc_light_move_it() -> None:
    assert abs(np.mean(errors(HullJoint(high_low=2e-3), DEFAULT))) > 0.05e-3
    lost = ~(np.abs(errors(HullJoint(), ARC_20)) < 1e-3)
    assert lost.mean() > 0.5


def test_bare_plate_is_refused() -> None:
    x = np.linspace(-0.04, 0.04, 290)
    with pytest.raises(GrooveNotFound):
        read_joint_as_paper(Profile(x, np.full(290, 0.149)))
    with pytest.raises(GrooveNotFound):
        read_joint_as_paper(Profile(x, np.full(290, np.nan)))
