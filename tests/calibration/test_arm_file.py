"""What ``calibration.toml`` keeps of an arm."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from tjscan.calibration.file import FILE_UNITS_PER_SI, ArmKinematicsEntry, rows_in_file_units


def entry(**changes: object) -> ArmKinematicsEntry:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((42, 42))
    deviations = 1e-4 * rng.standard_normal((6, 6)) * FILE_UNITS_PER_SI
    made = ArmKinematicsEntry(
        model="ur10e",
        deviations=tuple(map(tuple, deviations.tolist())),
        covariance=rows_in_file_units(1e-8 * root @ root.T, axes=2),
        left_as_stated=("joint 1: offset not separable from where the target is",),
        held_out_poses=10,
        held_out_before_mm=0.3,
        held_out_after_mm=0.08,
    )
    return ArmKinematicsEntry.model_validate(made.model_dump() | changes)


def test_deviations_and_covariance_come_back_in_metres_and_radians() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((42, 42))
    np.testing.assert_allclose(entry().covariance_si, 1e-8 * root @ root.T, rtol=1e-12)
    assert entry().deviations_si.shape == (6, 6)
    np.testing.assert_allclose(entry().deviations_si, 1e-4 * rng.standard_normal((6, 6)))
    assert entry().held_out_before_mm == pytest.approx(0.3)


@pytest.mark.parametrize(
    "changes",
    [
        {"deviations": [[0.0] * 6] * 5},
        {"deviations": [[9.0] * 6] * 6},
        {"covariance": [[1.0] * 41] * 42},
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        entry(**changes)
