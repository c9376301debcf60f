"""Laws of where two sides meet: what is given lies on both; what nearly touches is none."""

from __future__ import annotations

from hypothesis import assume, given
from hypothesis import strategies as st

from tjscan.groove.sides import CubicCurve, intersect_curves

LENGTHS = st.floats(-0.01, 0.01)
BENDS = st.floats(-40.0, 40.0)


@given(LENGTHS, st.floats(-1.0, 1.0), BENDS, BENDS, LENGTHS)
def test_what_is_given_lies_on_both_curves(
    x: float, slope: float, bend: float, other: float, start: float
) -> None:
    a = CubicCurve(0.0, 0.23, 1.0, 0.0, c1=slope, c2=bend)
    b = CubicCurve(x, 0.231, 1.0, 0.0, c2=other)
    found = intersect_curves(a, b, start)
    assume(found is not None)
    assert found is not None
    heights = (curve.height_and_slope(s)[0] for curve, s in zip((a, b), found, strict=True))
    (_, z_a), (_, z_b) = (
        (curve.cx + s, curve.cz - height)
        for curve, s, height in zip((a, b), found, heights, strict=True)
    )
    assert abs(z_a - z_b) < 1e-8


def test_curves_that_nearly_touch_do_not_meet() -> None:
    line = CubicCurve(0.0, 0.23, 1.0, 0.0)
    for gap in (1e-6, 1e-5, 1e-4):
        bow = CubicCurve(0.0, 0.23 - gap, 1.0, 0.0, c2=20.0)
        assert intersect_curves(line, bow, 3e-3) is None
