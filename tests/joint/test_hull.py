"""A hull joint's file, cross-section and course."""

from dataclasses import replace
from math import cos, pi, radians, sin, tan
from pathlib import Path

import numpy as np
import pytest
from hull_views import area_left_to_fill, top_edges
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.config import read_toml, table_to_dict, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.joint.hull import (
    BEAD_NODES,
    HullJoint,
    HullTack,
    WeldBead,
    hull_section,
    joint_line_pose,
    laser_offset,
    place_beside_joint,
)

NM2 = 1e-9 * 30e-3
"""Area in m² of a nanometre over a groove: what leaning faces leave."""

PASSES = (
    WeldBead(level=4e-3, crown=0.5e-3),
    WeldBead(level=9e-3, crown=-0.5e-3),
    WeldBead(level=14e-3, crown=0.8e-3, right=0.3),
    WeldBead(level=14e-3, crown=0.8e-3, left=0.1),
    WeldBead(level=20e-3, crown=2e-3, left=-1.1, right=1.1),
)


@given(
    angle=st.floats(40, 72),
    depth=st.floats(5e-3, 19e-3),
    face=st.floats(0, 4e-3),
    high_low=st.floats(-3e-3, 3e-3),
)
def test_area_of_empty_groove_is_that_of_its_formula(
    angle: float, depth: float, face: float, high_low: float
) -> None:
    joint = HullJoint(opening_angle=radians(angle), depth=depth, root_face=face, high_low=high_low)
    # Two trapezoids sheared by the high-low keep their area, and so does the strip below.
    found = area_left_to_fill(joint, hull_section(joint, 0.0))
    assert found == pytest.approx(joint.groove_area, abs=NM2)


def test_flat_fill_leaves_the_formula_of_a_smaller_groove() -> None:
    joint = HullJoint(beads=(WeldBead(level=15e-3),))
    left = area_left_to_fill(joint, hull_section(joint, 0.0, passes=1))
    at_level = joint.width - 2 * 5e-3 * tan(joint.opening_angle / 2)
    assert left == pytest.approx(0.5 * (joint.width + at_level) * 5e-3, abs=NM2)


def test_crown_adds_the_area_of_a_parabola() -> None:
    flat, crowned = (HullJoint(beads=(WeldBead(level=12e-3, crown=c),)) for c in (0.0, 1e-3))
    half = flat.root_opening / 2 + 12e-3 * tan(flat.opening_angle / 2)
    left = [
        area_left_to_fill(joint, hull_section(joint, 0.0, passes=1)) for joint in (flat, crowned)
    ]
    chords = 1 - 1 / (BEAD_NODES - 1) ** 2  # of a parabola's area that its chords enclose
    assert left[0] - left[1] == pytest.approx(chords * 4 / 3 * half * 1e-3, rel=1e-6)


def test_no_pass_lowers_the_surface_and_every_section_has_one_height_everywhere() -> None:
    joint = HullJoint(beads=PASSES, ripple=0.1e-3, high_low=1e-3)
    x = np.linspace(-0.04, 0.04, 801)
    before = np.full(len(x), -np.inf)
    for passes in range(len(PASSES) + 1):
        section = hull_section(joint, 0.123, passes)
        assert (np.diff(section[:, 0]) >= 0).all()
        now = np.interp(x, *section.T)
        assert (now >= before - 1e-9).all()
        before = now


def test_mirrored_joint_has_the_mirrored_section() -> None:
    joint = HullJoint(beads=PASSES, high_low=1.5e-3, root_face=2e-3)
    mirrored = replace(
        joint,
        high_low=-1.5e-3,
        beads=tuple(replace(b, left=-b.right, right=-b.left) for b in PASSES),
    )
    for passes in (0, 3, 5):
        one, other = hull_section(joint, 0.1, passes), hull_section(mirrored, 0.1, passes)
        np.testing.assert_allclose(one, other[::-1] * (-1, 1), atol=1e-9)


def test_tack_fills_the_root_over_its_length_only() -> None:
    joint = HullJoint(tacks=(HullTack(at=0.5, length=30e-3, height=6e-3),))
    deepest = [hull_section(joint, s)[:, 1].min() for s in (0.40, 0.487, 0.5, 0.513, 0.6)]
    assert deepest == pytest.approx([-20e-3, -18e-3, -14e-3, -18e-3, -20e-3], abs=1e-9)


def test_nothing_is_seen_through_a_root_opening_without_backing() -> None:
    joint = HullJoint(backing=False)
    assert joint.root_opening > 0
    assert hull_section(joint, 0.0)[:, 1].min() < -0.2
    closed = hull_section(replace(joint, beads=PASSES[:1]), 0.0, passes=1)
    assert closed[:, 1].min() == pytest.approx(-16e-3)


def test_top_edges_lie_on_the_section_about_its_middle() -> None:
    joint = HullJoint(high_low=2e-3)
    edges = top_edges(joint)
    np.testing.assert_allclose(edges.mean(axis=0), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.interp(edges[:, 0], *hull_section(joint, 0.0).T), edges[:, 1])


@given(
    radius=st.one_of(st.none(), st.floats(5, 100), st.floats(-100, -5)),
    along=st.floats(-2, 4),
    right=st.floats(-0.5, 0.5),
)
def test_place_beside_a_joint_is_the_inverse_of_going_there(
    radius: float | None, along: float, right: float
) -> None:
    joint = HullJoint(radius=radius)
    x, y, heading = joint_line_pose(joint, along)
    found = place_beside_joint(joint, x - right * sin(heading), y + right * cos(heading))
    assert found == pytest.approx((along, right), abs=1e-9)


@given(
    radius=st.one_of(st.none(), st.floats(5, 100), st.floats(-100, -5)),
    relative=st.floats(-0.3, 0.3),
    right=st.floats(-0.04, 0.04),
)
def test_laser_line_crosses_the_joint_where_it_is_said_to(
    radius: float | None, relative: float, right: float
) -> None:
    joint = HullJoint(radius=radius)
    px, py, direction = joint_line_pose(joint, 1.0)
    x, y = px - right * sin(direction), py + right * cos(direction)
    heading = direction + relative
    along, offset = laser_offset(joint, x, y, heading)
    crossing = x + offset * sin(heading), y - offset * cos(heading)
    assert crossing == pytest.approx(joint_line_pose(joint, along)[:2], abs=1e-9)
    assert offset * right >= 0


def test_an_arc_bends_to_the_side_of_its_sign() -> None:
    assert joint_line_pose(HullJoint(radius=10.0), 1.0)[1] > 0
    assert joint_line_pose(HullJoint(radius=-10.0), 1.0)[1] < 0
    assert joint_line_pose(HullJoint(radius=10.0), 5 * pi)[:2] == pytest.approx((10.0, 10.0))


def test_file_comes_back_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "joint.toml"
    file.write_text(
        "width_mm = 30.0\nopening_angle_deg = 70.0\nradius_m = -20.0\nlength_m = 3.0\n"
        "[[tacks]]\nat_m = 0.4\n[[beads]]\nlevel_mm = 5.0\ncrown_mm = 0.5\n"
    )
    joint = validate_table(HullJoint, read_toml(file), file)
    assert joint.radius == -20.0
    assert joint.tacks == (HullTack(at=0.4),)
    assert joint.opening_angle == pytest.approx(radians(70))
    assert validate_table(HullJoint, table_to_dict(joint)) == joint


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("width_m = 0.03", "width_mm"),
        ("width_mm = 20.0", "width_mm"),
        ("root_face_mm = 20.0", "root_face_mm"),
        ("radius_m = 0.0", "radius_m"),
        ("[[beads]]\nlevel_mm = 5.0\nleft = 1.0\nright = 0.0", "left"),
    ],
)
def test_joints_that_cannot_be_are_refused(tmp_path: Path, line: str, word: str) -> None:
    file = tmp_path / "joint.toml"
    file.write_text(line + "\n")
    with pytest.raises(ConfigurationError, match=word):
        validate_table(HullJoint, read_toml(file), file)
