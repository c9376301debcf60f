"""A laser model can be what a sensor can be, and nothing else."""

import math
from typing import Any

import pytest

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
        ("columns", 0),
        ("columns", 100),
        ("columns", 720),
        ("near", 0.0),
        ("near", 0.3),
        ("emitter_z", 0.2),
        ("detector_z", 0.2),
        ("half_angle", 0.0),
        ("half_angle", math.pi / 2),
        ("noise", -1e-6),
        ("noise", math.nan),
        ("noise_correlation", math.inf),
        ("bias", -1e-6),
        ("bias_limit", -1e-6),
        ("dropout", 1.1),
        ("dropout_end", math.radians(50)),
        ("dropout_end", math.radians(91)),
        ("missing", -0.1),
        ("missing_run", (0, 3)),
        ("ghosts", 1.5),
        ("ghost_share", 1.5),
        ("ghost_run", (5, 4)),
        ("ghost_intensity", 2.0),
        ("flyers", -0.5),
        ("flyer_overshoot", -1e-3),
        ("flyer_crease", 0.0),
        ("flyer_jump", 0.0),
        ("step", -5e-6),
    ],
)
def test_an_impossible_value_is_refused_by_name(key: str, value: Any) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        LaserModel(**{key: value})
    assert refusal.value.key == key


def test_the_ideal_sensor_has_only_the_faults_it_is_given() -> None:
    model = LaserModel.without_faults(noise=1e-5)
    faults = (model.bias, model.dropout, model.missing, model.ghosts, model.flyers, model.step)
    assert faults == (0, 0, 0, 0, 0, 0)
    assert model.noise == 1e-5
