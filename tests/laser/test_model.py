"""A laser model can be what a sensor can be, and nothing else."""

import math
from typing import Any

import pytest

from tjscan.core.config import validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.laser.model import EXTENDED_Z_RANGE, LaserModel


@pytest.mark.parametrize("columns", range(80, 641, 80))
def test_every_resolution_of_the_sensor_is_a_model(columns: int) -> None:
    assert LaserModel(columns=columns).columns == columns


def test_the_extended_range_is_a_model() -> None:
    near, far = EXTENDED_Z_RANGE
    assert LaserModel(near=near, far=far).far == far


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("noise_mm", -1e-3),
        ("noise_mm", math.nan),
        ("noise_correlation_points", math.inf),
        ("bias_mm", -1e-3),
        ("dropout", 1.1),
        ("missing", -0.1),
        ("ghosts", 1.5),
        ("flyers", -0.5),
        ("resolution_mm", -5e-3),
    ],
)
def test_an_impossible_value_is_refused_by_name(key: str, value: Any) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        validate_table(LaserModel, {key: value})
    assert refusal.value.key == key


def test_the_ideal_sensor_has_only_the_faults_it_is_given() -> None:
    model = LaserModel.without_faults(noise=1e-5)
    faults = (model.bias, model.dropout, model.missing, model.ghosts, model.flyers, model.step)
    assert faults == (0, 0, 0, 0, 0, 0)
    assert model.noise == 1e-5
