"""A groove beside a table of details."""

import numpy as np
from plates import half_v
from ringed_grooves import edges_of

from tjscan.core.frames import Array
from tjscan.planning.details import NO_DETAIL_TEXT, DetailStretch, find_stretches_off_details
from tjscan.planning.wps import JointDetail

COUNT, ANGLE, DEPTH = 9, 50.0, 25.4e-3
DIHEDRAL = np.radians(np.linspace(90, 130, COUNT))


def detail(name: str, dihedral: tuple[float, float], groove: tuple[float, float]) -> JointDetail:
    low, high = np.radians(groove)
    return JointDetail(
        name=name,
        dihedral=(np.radians(dihedral[0]), np.radians(dihedral[1])),
        groove_angle=(float(low), float(high)),
        root_opening=(2e-3, 6e-3),
        size=(20e-3, 30e-3),
    )


def compared(*details: JointDetail, dihedral: Array = DIHEDRAL) -> tuple[DetailStretch, ...]:
    flat = half_v(DEPTH, ANGLE)
    x = np.linspace(0, 0.4, COUNT)
    edges = edges_of(np.stack(np.broadcast_arrays(x[:, None], flat[:, 0], flat[:, 1]), axis=2))
    return find_stretches_off_details(edges, dihedral, np.full(COUNT, 1e-3), details)


def test_a_groove_within_one_detail_is_one_stretch() -> None:
    (one,) = compared(detail("side", (80, 140), (45, 55)))
    assert one.details == ("side",)
    assert not one.out_of_table
    np.testing.assert_allclose(one.dihedral, (DIHEDRAL[0], DIHEDRAL[-1]))
    np.testing.assert_allclose((one.begin, one.end), (0, 0.4), atol=1e-12)


def test_what_is_out_is_named_with_its_value_and_window() -> None:
    (one,) = compared(detail("side", (80, 140), (20, 49)))
    assert one.out_of_table == ("groove angle 50.0 to 50.0°, in the table 20 to 49",)


def test_where_two_details_overlap_the_better_one_is_told() -> None:
    narrow, wide = detail("side", (80, 115), (20, 49)), detail("toe", (105, 140), (45, 55))
    found = compared(narrow, wide)
    assert [one.details for one in found] == [("side",), ("side", "toe"), ("toe",)]
    assert [len(one.out_of_table) for one in found] == [1, 0, 0]


def test_an_angle_that_no_detail_holds_is_told() -> None:
    found = compared(detail("side", (80, 115), (45, 55)))
    assert found[-1].out_of_table == (NO_DETAIL_TEXT,)
