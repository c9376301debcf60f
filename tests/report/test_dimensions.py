"""Sections are dimensioned by what was measured, and held against what is drawn and allowed."""

from dataclasses import replace
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest

from tjscan.core.frames import Array, pose
from tjscan.groove.measured import MeasuredSection
from tjscan.joint.definition import FitUpTolerance, JointDefinition
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.file import read_joint
from tjscan.joint.geometry import cylindrical_to_j, radial_direction, tangential_direction
from tjscan.report.dimensions import Dimension, section_dimensions

CAD = Path(__file__).parent.parent.parent / "cad" / "tjoint-600x457.toml"
PAPER = read_joint(CAD)
OPEN = replace(
    PAPER,
    imperfections=replace(
        PAPER.imperfections, root=replace(PAPER.imperfections.root, is_open=True)
    ),
)
EXACT = 1e-6
SIGMA = 0.05
"""Of each corner in each direction, mm."""


def designed_section(joint: JointDefinition, phi: float) -> MeasuredSection:
    """The designed groove as if it was measured square to the wall at an azimuth."""
    groove = JointGrooveSections(joint, np.array([phi]))
    rz = (groove.p2[0], groove.p3[0], groove.p4[0])
    p2, p3, p4 = (cylindrical_to_j(phi, *one) for one in rz)
    p1 = p2 + np.array((0, 0, 30e-3))
    out = groove.p4[0, 0] + 40e-3
    p5 = cylindrical_to_j(phi, out, joint.leg_surface.height(phi, out))
    axes = np.column_stack((-tangential_direction(phi), (0, 0, 1), radial_direction(phi)))
    axes[:, 0] = np.cross(axes[:, 1], axes[:, 2])
    foot = cylindrical_to_j(phi, joint.brace_radius, p4[2])
    width = float(groove.root_width[0])
    return MeasuredSection(
        index=3,
        station="1",
        azimuth=phi,
        T_r_g=pose(axes, foot),
        points=np.array((p1, p2, p3, p4, p5)),
        covariances=np.array([(1e-3 * SIGMA) ** 2 * np.eye(3)] * 3),
        measures=np.array((float(groove.groove_angle[0]), width, 20e-3, 4e-4)),
        measure_covariance=np.diag(np.array((1e-3, 2e-5, 3e-5, 5e-7)) ** 2),
        work_angle=0.0,
        rms=0.0,
        root_opening=width if joint.imperfections.root.is_open else nan,
    )


def named(section: MeasuredSection, joint: JointDefinition | None) -> dict[str, Dimension]:
    return {one.name: one for one in section_dimensions([section], joint)[0]}


@pytest.mark.parametrize("phi", [0.0, 0.7, 2.5])
def test_a_joint_as_drawn_has_the_drawn_root_face_and_no_high_low(phi: float) -> None:
    found = named(designed_section(OPEN, phi), OPEN)
    assert found["root face"].value == pytest.approx(1.5, abs=EXACT)
    assert found["root face"].sigma == pytest.approx(SIGMA)
    assert found["root opening"].value == pytest.approx(found["root opening"].designed, abs=1e-3)
    for side in ("brace", "leg"):
        assert found[f"high-low, {side}"].value == pytest.approx(0.0, abs=EXACT)


def test_high_low_and_root_face_follow_the_brace_outwards() -> None:
    section = designed_section(OPEN, 0.7)
    points: Array = section.points.copy()
    points[:3] += 0.4e-3 * radial_direction(0.7)
    found = named(replace(section, points=points), OPEN)
    assert found["high-low, brace"].value == pytest.approx(0.4, abs=1e-3)
    assert found["root face"].value == pytest.approx(1.9, abs=1e-3)


def test_a_root_face_under_a_bead_is_not_seen() -> None:
    found = named(designed_section(PAPER, 0.7), PAPER)
    assert found["root face"].text == "not seen"
    assert found["root face"].designed_text == "1.5"
    assert "root bead" in found


def test_without_a_joint_nothing_is_designed() -> None:
    found = named(designed_section(PAPER, 0.7), None)
    assert list(found) == ["groove angle", "root bead", "depth"]
    assert [one.designed_text for one in found.values()] == ["", "", ""]


def test_a_buried_root_keeps_its_angle_alone() -> None:
    found = named(replace(designed_section(OPEN, 0.7), absent=("p3", "p4")), OPEN)
    seen = {name for name, one in found.items() if one.text != "not seen"}
    assert seen == {"groove angle", "high-low, brace"}


@pytest.mark.parametrize(
    ("off", "sigma", "tolerance", "verdict"),
    [
        (0.5, 0.1, 1.0, "within"),
        (-0.9, 0.1, 1.0, "unsure"),
        (1.1, 0.1, 1.0, "unsure"),
        (-1.3, 0.1, 1.0, "outside"),
        (9.9, 0.1, inf, ""),
        (nan, 0.1, 1.0, ""),
    ],
)
def test_a_verdict_counts_the_uncertainty(
    off: float, sigma: float, tolerance: float, verdict: str
) -> None:
    assert Dimension("depth", "mm", 20.0 + off, sigma, 20.0, tolerance).verdict == verdict


def test_tolerances_are_those_of_the_drawing() -> None:
    tight = replace(OPEN, tolerance=FitUpTolerance(groove_angle=np.radians(5.0), depth=2e-3))
    found = named(designed_section(OPEN, 0.7), tight)
    assert found["groove angle"].tolerance == pytest.approx(5.0)
    assert found["depth"].tolerance == pytest.approx(2.0)
    assert found["root face"].tolerance == inf


def test_a_text_has_the_digits_that_its_uncertainty_allows() -> None:
    assert Dimension("depth", "mm", 21.4444, 0.04).text == "21.44 ± 0.08"
    assert Dimension("depth", "mm", -0.4444, 0.2).text == "−0.4 ± 0.4"
    assert Dimension("groove angle", "°", 50.04, 0.1, 50.0, 5.0).designed_text == "50.0° ± 5"
