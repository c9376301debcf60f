"""A finished weld against limits: known shapes give known values, with place, length and sigma."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from weld_grooves import v_groove

from tjscan.core.frames import Array
from tjscan.welding.inspection import (
    InspectionRow,
    LimitTable,
    inspect_weld,
    measure_weld,
    read_limits,
)
from tjscan.welding.look import UNSEEN_SIGMA
from tjscan.welding.state import WeldState
from tjscan.welding.target import WeldTarget

EXAMPLE = Path(__file__).parents[2] / "examples" / "iso5817-example.toml"
EVERYWHERE = np.ones(41, dtype=bool)
SIGMA = np.full(41, 0.02e-3)


def capped(height: float) -> WeldState:
    """A groove that is full, under a cap that rises so high over the line of its toes."""
    state = v_groove()
    top = WeldTarget.over(state, height)
    return replace(state, w=np.where(top.between, top.top, state.w))


def rows_of(
    state: WeldState, w: Array, *, butt: bool = True
) -> dict[tuple[str, str], InspectionRow]:
    measures = measure_weld(state, state.u, w, SIGMA, EVERYWHERE, butt=butt)
    found = inspect_weld(measures, read_limits(EXAMPLE), 12e-3)
    return {(row.limit.imperfection, row.limit.level): row for row in found}


def test_cap_has_its_height_and_its_toe_angle() -> None:
    state = capped(2e-3)
    rows = rows_of(state, state.w)
    assert rows["excess", "B"].value == pytest.approx(2e-3, abs=0.06e-3)
    assert rows["excess", "B"].state == "within"  # 1 mm + 0.1 b, of b 17 mm
    assert rows["sag", "B"].value < 0.05e-3
    assert rows["undercut", "B"].value == pytest.approx(0, abs=1e-9)
    # The toe's slope is 4 h / b, less what the line beside it flattens.
    width = np.diff(state.toe_points[:, :, 0], axis=1)[:, 0]
    least = np.pi - np.arctan(4 * 2e-3 / width.min())
    assert rows["toe angle", "B"].value == pytest.approx(least, abs=0.12)
    assert rows["misalignment", "B"].value == pytest.approx(0, abs=1e-9)


def test_what_is_beyond_a_limit_has_its_place_and_its_length() -> None:
    state = capped(2e-3)
    dug = state.w.copy()
    beside = (state.u > state.toe_points[:, 1, :1] + 0.3e-3) & (
        state.u < state.toe_points[:, 1, :1] + 1.5e-3
    )
    dug[10:16] -= 0.7e-3 * beside[10:16]
    row = rows_of(state, dug)["undercut", "B"]
    assert row.value == pytest.approx(0.7e-3, abs=1e-6)
    assert row.state == "beyond"
    assert 10 <= round(row.s / 2e-3) <= 15
    assert row.length == row.longest_in_window == pytest.approx(12e-3)
    assert row.sigma == pytest.approx(np.hypot(0.02e-3, 0.03e-3))


def test_value_near_its_limit_is_undecided_and_unread_stretches_are_counted() -> None:
    state = capped(2e-3)
    low = state.w - 0.51e-3 * (state.w > state.base + 1e-9)
    target = WeldTarget.over(state, 0.0)
    flat = np.where(target.between, target.top - 0.52e-3, state.w)
    row = rows_of(replace(state, w=np.maximum(flat, state.base)), flat)["sag", "B"]
    assert row.value == pytest.approx(0.52e-3, abs=0.03e-3)
    assert row.state == "undecided"
    read = EVERYWHERE.copy()
    read[:5] = False
    measures = measure_weld(state, state.u, low, SIGMA, read, butt=True)
    (first, *_) = inspect_weld(measures, read_limits(EXAMPLE), 12e-3)
    assert first.unseen == pytest.approx(10e-3)


def test_a_tee_has_a_throat_and_no_misalignment() -> None:
    state = capped(2e-3)
    measures = measure_weld(state, state.u, state.w, SIGMA, EVERYWHERE, butt=False)
    assert "misalignment" not in measures.values
    height = 2e-3 + state.toe_points[:, 0, 1]
    assert (measures.values["throat"] <= height + 1e-6).all()
    table = LimitTable.model_validate(
        {"name": "t", "limit": [{"imperfection": "throat", "least_mm": 20.0}]}
    )
    (row,) = inspect_weld(measures, table, 12e-3)
    assert row.state == "beyond"


def test_a_measure_has_the_sigma_of_the_columns_it_is_made_of() -> None:
    state = capped(2e-3)
    sigma = np.full(state.w.shape, 0.02e-3)
    sigma[:, :3] = UNSEEN_SIGMA  # of the plate's margin: no measure is made of it
    found, one_sigma = (
        measure_weld(state, state.u, state.w, each, EVERYWHERE, butt=True)
        for each in (sigma, SIGMA)
    )
    for name, values in one_sigma.values.items():
        assert found.values[name] == pytest.approx(values, abs=1e-12)
        assert found.sigmas[name] == pytest.approx(one_sigma.sigmas[name], rel=1e-6)
    toe = state.toe_points[:, 0, :1]
    beside = (state.u > toe - 1.5e-3) & (state.u < toe + 1.5e-3)
    unsure = measure_weld(
        state, state.u, state.w, np.where(beside, 0.1e-3, 0.02e-3), EVERYWHERE, butt=True
    )
    assert unsure.sigmas["excess"] == pytest.approx(one_sigma.sigmas["excess"])
    outside = (state.u > toe - 1.5e-3) & (state.u < toe)
    unseen = measure_weld(
        state, state.u, state.w, np.where(outside, UNSEEN_SIGMA, 0.02e-3), EVERYWHERE, butt=True
    )
    assert np.isnan(unseen.values["undercut"]).all()  # what no profile shows is not measured
    assert unseen.sigmas["excess"] == pytest.approx(one_sigma.sigmas["excess"])
