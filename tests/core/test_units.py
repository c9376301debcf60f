"""Settings hold metres and radians; files hold the same numbers in their own units."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Annotated, Any

import numpy as np
import pytest
from annotated_types import Ge, Gt, Le
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.config import StrictFileModel, table_to_dict, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.units import (
    DEG,
    MM,
    MM2,
    NOT_IN_FILE,
    FileUnit,
    PoseSettings,
    Position,
    SettingsTable,
    pose_from_rows_mm,
    pose_to_rows_mm,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan(SettingsTable):
    step: Annotated[float, Ge(5), Le(300), MM] = 0.04
    angle: Annotated[float, Ge(-45), Le(45), DEG] = radians(10)
    length: Annotated[float | None, Gt(0), MM] = None
    centre: Position = (0.0, 0.0, 0.0)
    count: int = 3
    secret: Annotated[float, NOT_IN_FILE] = 1.5

    def __post_init__(self) -> None:
        if self.length is not None and self.length < self.step:
            raise ValueError("length_mm must not be smaller than step_mm")


class Job(StrictFileModel):
    plan: Plan = Plan()
    other: Plan | None = None


DECIMALS = st.decimals(
    min_value=-10_000, max_value=10_000, places=9, allow_nan=False, allow_infinity=False
).map(float)


@pytest.mark.parametrize("unit", [MM, MM2, DEG, FileUnit("s")])
@given(value=DECIMALS)
def test_what_a_file_holds_is_written_again_to_the_last_digit(unit: FileUnit, value: float) -> None:
    assert unit.to_file(unit.to_si(value)) == value
    assert unit.to_file(unit.to_si((value, value))) == (value, value)


@pytest.mark.parametrize("unit", [MM, MM2, DEG])
@given(value=st.floats(min_value=-1e5, max_value=1e5))
def test_what_is_written_is_read_as_the_same(unit: FileUnit, value: float) -> None:
    inside = unit.to_si(value)
    assert unit.to_si(unit.to_file(inside)) == pytest.approx(inside, rel=3e-16)


def test_a_key_ends_in_its_unit_and_is_converted_once() -> None:
    table = {"step_mm": 20, "angle_deg": 30.0, "length_mm": 560, "centre_mm": [1.0, 2, 3.5]}
    plan = validate_table(Plan, table)
    assert plan.step == 0.02
    assert plan.angle == radians(30)
    assert plan.length == 0.56
    assert plan.centre == pytest.approx((0.001, 0.002, 0.0035))
    assert table_to_dict(plan) == {**table, "count": 3}
    assert table_to_dict(Plan()) == {
        "step_mm": 40.0,
        "angle_deg": 10.0,
        "centre_mm": [0.0, 0.0, 0.0],
        "count": 3,
    }


@pytest.mark.parametrize(
    ("table", "key", "words"),
    [
        ({"step_mm": 0.04}, "plan.step_mm", r"greater than or equal to 5 \(found 0.04\)"),
        ({"step": 0.04}, "plan.step", "unknown key; did you mean: step_mm"),
        ({"step_mm": "40"}, "plan.step_mm", "number"),
        ({"step_mm": float("nan")}, "plan.step_mm", "finite"),
        ({"centre_mm": [0, 0]}, "plan.centre_mm.2", "required"),
        ({"length_mm": 10}, "plan", "must not be smaller"),
        ({"secret": 2.0}, "plan.secret", "unknown key"),
        ([], "plan", "must be a table"),
    ],
)
@pytest.mark.parametrize("name", ["plan", "other"])
def test_a_wrong_value_is_named_by_its_key_in_the_unit_of_the_file(
    table: Any, key: str, words: str, name: str
) -> None:
    with pytest.raises(ConfigurationError, match=words) as caught:
        validate_table(Job, {name: table})
    assert caught.value.key == key.replace("plan", name, 1)


def test_poses_are_read_and_written_as_controllers_show_them() -> None:
    table = {"position_mm": [800.0, 0.1, 300.0], "euler_zyx_deg": [0.3, 90.0, -180.0]}
    pose = validate_table(PoseSettings, table)
    assert pose.T[:3, 3] == pytest.approx((0.8, 0.0001, 0.3))
    assert table_to_dict(pose) == table


def test_rows_of_a_pose_are_kept_to_the_last_digit() -> None:
    rows = ((1.0, 0.0, 0.0, -0.749), (0.0, 1.0, 0.0, -114.845), (0.0, 0.0, 1.0, 167.616))
    T = pose_from_rows_mm((*rows, (0.0, 0.0, 0.0, 1.0)))
    assert T[:3, 3] == pytest.approx(np.array((-0.749, -114.845, 167.616)) * 1e-3)
    assert pose_to_rows_mm(T) == (*rows, (0.0, 0.0, 0.0, 1.0))
