"""Laws of a carrier's axes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.carrier.kinematics import AxisSettings, CarrierKinematics
from tjscan.core.config import validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import inverse_pose, pose, pose_from_euler_zyx, rot_z

TRACK = AxisSettings(name="x", kind="linear", direction=(2.0, 0.0, 0.0), limits=(-1.0, 3.0))
TURN = AxisSettings(
    name="turn",
    kind="rotary",
    direction=(0.0, 0.0, 1.0),
    point=(0.4, -0.2, 5.0),
    angular_limits=(-np.pi, np.pi),
)
ZERO = pose_from_euler_zyx((0.3, 0.8, 1.7), (0.2, -0.4, 2.0))
EXACT = 1e-12

values = st.tuples(st.floats(-1.0, 3.0), st.floats(-np.pi, np.pi))


@given(values)
def test_a_chain_of_axes_moves_what_the_axes_before_carry(v: tuple[float, float]) -> None:
    both = CarrierKinematics((TRACK, TURN), ZERO, carries_joint=False)
    about = pose(p=(0.4, -0.2, 0.0)) @ pose(rot_z(v[1])) @ pose(p=(-0.4, 0.2, 0.0))
    np.testing.assert_allclose(both.T_w_b(v), pose(p=(v[0], 0, 0)) @ about @ ZERO, atol=EXACT)
    np.testing.assert_allclose(both.T_w_b((0.0, 0.0)), ZERO, atol=EXACT)


@given(values)
def test_to_turn_the_joint_is_to_turn_the_base_the_other_way(v: tuple[float, float]) -> None:
    table = CarrierKinematics((TURN,), ZERO, carries_joint=True)
    slewed = CarrierKinematics((TURN,), ZERO, carries_joint=False)
    np.testing.assert_allclose(table.T_w_b(v[1:]), slewed.T_w_b((-v[1],)), atol=EXACT)


@given(values, values)
def test_there_and_back_leads_to_the_same_base(
    v: tuple[float, float], other: tuple[float, float]
) -> None:
    for joint in (False, True):
        carrier = CarrierKinematics((TRACK, TURN), ZERO, joint)
        there = inverse_pose(carrier.T_w_b(v)) @ carrier.T_w_b(other)
        back = inverse_pose(carrier.T_w_b(other)) @ carrier.T_w_b(v)
        np.testing.assert_allclose(there @ back, np.eye(4), atol=EXACT)


LINEAR = {"name": "x", "kind": "linear", "direction": [1.0, 0.0, 0.0], "limits_mm": [0.0, 900.0]}


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"limits_mm": None}, "axis 'x' has no limits: write limits_mm"),
        ({"limits_mm": None, "limits_deg": [0.0, 90.0]}, "write limits_mm = .* no limits_deg"),
        ({"limits_mm": [900.0, 0.0]}, "the least comes first"),
        ({"direction": [0.0, 0.0, 0.0]}, "direction: axis 'x' has none"),
        ({"point_mm": [0.0, 0.0, 0.0]}, "it goes through no point"),
        ({"kind": "rotary", "limits_mm": None, "limits_deg": [0.0, 90.0]}, "state a point"),
    ],
)
def test_an_axis_that_is_not_described_is_refused_by_name(
    changed: dict[str, Any], why: str
) -> None:
    table = {key: value for key, value in (LINEAR | changed).items() if value is not None}
    with pytest.raises(ConfigurationError, match=why):
        validate_table(AxisSettings, table)


def test_values_beyond_a_limit_are_refused_by_the_axis() -> None:
    both = CarrierKinematics((TRACK, TURN), ZERO, carries_joint=False)
    both.check_values((3.0, -np.pi))
    with pytest.raises(ConfigurationError, match=r"axis turn at 190 is beyond .*-180 to 180 deg"):
        both.check_values((0.0, np.radians(190)))
    with pytest.raises(ConfigurationError, match="has 1 values; the axes are x, turn"):
        both.check_values((0.0,))
