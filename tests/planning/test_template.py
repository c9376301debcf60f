"""Beads in a section: their areas, that they do not overlap, and how they scale and mirror."""

import importlib
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from plates import half_v, sheared_groove

from tjscan.planning.template import SectionTemplate

COUNTS = (1, 2, 3, 4)
EXACT = 1e-12


def equal_areas(template: SectionTemplate, n: int = sum(COUNTS)) -> np.ndarray:
    return np.repeat(template.area[:, None] / n, n, axis=1)


grooves = st.builds(
    sheared_groove,
    root=st.floats(3e-3, 9e-3),
    depth=st.floats(10e-3, 40e-3),
    opening=st.floats(0.5, 1.2),
    slope=st.floats(-0.5, 0.5),
    tilt=st.floats(-0.3, 0.3),
)


@settings(max_examples=60, deadline=None)
@given(grooves, st.floats(0, 3e-3))
def test_beads_have_the_areas_asked_for_and_fill_the_groove(
    corners: np.ndarray, cap: float
) -> None:
    template = SectionTemplate(corners[None], cap)
    assert template.sections_are_convex.all()
    area = shapely.Polygon(corners).area
    np.testing.assert_allclose(template.groove_area, area, rtol=EXACT)
    wanted = equal_areas(template)
    if wanted[0, 0] * COUNTS[-1] <= template.cap_area[0]:
        return
    cells = template.cut_into_beads(COUNTS, wanted)
    np.testing.assert_allclose(cells.areas, wanted, rtol=1e-9)
    reinforcement = 2 / 3 * cap * np.linalg.norm(corners[2] - corners[3])
    np.testing.assert_allclose(cells.areas.sum(), area + reinforcement, rtol=EXACT)


@settings(max_examples=25, deadline=None)
@given(grooves)
def test_beads_neither_overlap_nor_leave_gaps(corners: np.ndarray) -> None:
    template = SectionTemplate(corners[None], 1.5e-3)
    wanted = equal_areas(template)
    if wanted[0, 0] * COUNTS[-1] <= template.cap_area[0]:
        return
    outlines = template.cut_into_beads(COUNTS, wanted).outlines(0, points=400)
    beads = [shapely.Polygon(outline) for outline in outlines]
    assert all(bead.is_valid for bead in beads)
    union, whole = shapely.union_all(beads).area, sum(bead.area for bead in beads)
    assert whole - union < 1e-6 * union
    assert union == pytest.approx(template.area[0], rel=1e-4)  # the parabola is drawn in chords
    for bead, area in zip(beads, wanted[0], strict=True):
        assert bead.area == pytest.approx(area, rel=1e-4)


@settings(max_examples=30, deadline=None)
@given(grooves, st.floats(0.3, 4))
def test_a_groove_scaled_has_the_same_template_and_areas_that_scale_by_its_square(
    corners: np.ndarray, scale: float
) -> None:
    one, other = (
        SectionTemplate(corners[None], 1e-3),
        SectionTemplate(scale * corners[None], scale * 1e-3),
    )
    np.testing.assert_allclose(other.area, scale**2 * one.area, rtol=1e-12)
    if equal_areas(one)[0, 0] * COUNTS[-1] <= one.cap_area[0]:
        return
    first = one.cut_into_beads(COUNTS, equal_areas(one))
    second = other.cut_into_beads(COUNTS, equal_areas(other))
    np.testing.assert_allclose(second.w, first.w, atol=1e-9)
    for a, b in zip(first.u, second.u, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
    heights = [cells.template.layer_heights(cells.w) for cells in (first, second)]
    np.testing.assert_allclose(heights[1], scale * heights[0], rtol=1e-8)


def test_a_groove_turned_inside_out_is_no_template() -> None:
    corners = half_v()
    assert not SectionTemplate(corners[None, ::-1], 0.0).sections_are_convex[0]
    assert not SectionTemplate(corners[None, [0, 2, 1, 3]], 0.0).sections_are_convex[0]


def test_the_area_of_a_plate_s_groove_is_what_its_drawing_says() -> None:
    """A half V of 25.4 mm, 50°, with a gap of 6 mm."""
    t, gap = 25.4e-3, 6e-3
    area = gap * t + 0.5 * t**2 * np.tan(np.radians(50))
    template = SectionTemplate(half_v()[None], 0.0)
    assert template.area[0] == pytest.approx(area, rel=1e-12)
    assert 1e6 * area == pytest.approx(536.8, abs=0.05)


def v_groove(thickness: float, angle: float, gap: float) -> np.ndarray:
    lean = thickness * np.tan(np.radians(angle) / 2)
    return np.array([(0.0, 0.0), (gap, 0.0), (gap + lean, thickness), (-lean, thickness)])


@pytest.mark.parametrize(
    ("kind", "angle_key", "angle", "corners"),
    [
        ("HVGroove", "bevel_angle", 50.0, half_v()),
        ("VGroove", "groove_angle", 60.0, v_groove(25.4e-3, 60.0, 6e-3)),
    ],
)
def test_weldx_has_the_same_area_and_speed_of_a_plate(
    kind: str, angle_key: str, angle: float, corners: np.ndarray
) -> None:
    weldx: Any = pytest.importorskip("weldx", reason="the extra tjscan[weldx] is not installed")
    util: Any = importlib.import_module("weldx.welding.util")
    Q_ = weldx.Q_
    sizes = {"workpiece_thickness": 25.4, "root_gap": 6, "root_face": 0}
    given = {key: Q_(value, "mm") for key, value in sizes.items()}
    groove = weldx.get_groove(groove_type=kind, **given, **{angle_key: Q_(angle, "deg")})
    area = SectionTemplate(corners[None], 0.0).area[0]
    theirs = groove.cross_sect_area.to("m**2").magnitude
    assert area == pytest.approx(float(theirs), rel=1e-6)
    speed = util.compute_welding_speed(groove, Q_(9, "m/min"), Q_(1.2, "mm")).to("m/s").magnitude
    ours = 0.25 * np.pi * 1.2e-3**2 * (9 / 60) / area
    assert ours == pytest.approx(float(speed), rel=1e-6)
