"""The budget in its file and in a few numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured import ORIGIN, a_section

from tjscan.core.errors import ConfigurationError
from tjscan.result.section import absent_corners
from tjscan.result.summary import read_budget, write_budget
from tjscan.uncertainty.budget import BudgetComponent, UncertaintyBudget, summarise_budget

COUNT = 7
SECTIONS = [a_section(seed) for seed in range(COUNT)]
MEASURES = np.array((1e-3, 2e-5, 3e-5, 5e-7))


def a_budget(seed: int = 0) -> UncertaintyBudget:
    rng = np.random.default_rng(seed)
    return UncertaintyBudget(
        tuple(
            BudgetComponent(
                name,
                "stated",
                shared,
                1e-4 * rng.normal(size=(COUNT, 5, 3, m)),
                MEASURES[:, None] * rng.normal(size=(COUNT, 4, m)),
            )
            for name, shared, m in (("reading", False, 10), ("hand", True, 6), ("places", True, 3))
        )
    )


def test_a_budget_is_read_as_it_was_written(tmp_path: Path) -> None:
    budget, file = a_budget(), tmp_path / "uncertainty.json"
    write_budget(file, budget, ORIGIN)
    found = read_budget(file, COUNT)
    assert found is not None
    for one, other in zip(budget.components, found.components, strict=True):
        assert (one.name, one.evidence, one.is_shared) == (
            other.name,
            other.evidence,
            other.is_shared,
        )
        np.testing.assert_allclose(one.points, other.points, atol=1e-9)
        np.testing.assert_allclose(one.measures, other.measures, rtol=1e-3, atol=1e-9)


def test_a_run_of_an_earlier_version_has_none(tmp_path: Path) -> None:
    assert read_budget(tmp_path / "uncertainty.json", COUNT) is None


@pytest.mark.parametrize("damage", ["sections", "text", "nothing"])
def test_a_budget_of_other_sections_or_a_damaged_one_is_refused(
    damage: str, tmp_path: Path
) -> None:
    file = tmp_path / "uncertainty.json"
    write_budget(file, a_budget(), ORIGIN)
    if damage == "text":
        file.write_bytes(file.read_bytes()[:-40])
    if damage == "nothing":
        file.write_text('{"provenance": null, "coverage_factor": 2.0, "components": []}')
    with pytest.raises(ConfigurationError):
        read_budget(file, COUNT + (damage == "sections"))


def test_squares_of_the_components_add_up_to_what_is_combined() -> None:
    found = summarise_budget(a_budget(), ~absent_corners(SECTIONS), ["the weather"])
    for name in ("corner_mm", "groove_angle_deg", "root_width_mm", "depth_mm", "area_mm2"):
        parts = [getattr(row, name) for row in found.components]
        combined = getattr(found.combined, name)
        assert combined == pytest.approx(np.sqrt(np.sum(np.square(parts))))
        assert getattr(found.expanded, name) == pytest.approx(2 * combined)
    assert found.left_out == ("the weather",)
    # About the middle of what corners have.
    traces = np.trace(a_budget().corner_covariances, axis1=-2, axis2=-1)
    low, high = 1e3 * np.sqrt(np.quantile(traces, (0.3, 0.7)))
    assert low < found.combined.corner_mm < high


def test_sections_carry_what_the_budget_says() -> None:
    budget = a_budget()
    for k, section in enumerate(budget.sections_with_covariances(SECTIONS)):
        np.testing.assert_allclose(section.covariances, budget.corner_covariances[k])
        own = budget.components[0].corner_covariances[k]
        np.testing.assert_allclose(
            section.own_corner_sigmas, np.sqrt(np.trace(own, axis1=1, axis2=2)), rtol=1e-9
        )
