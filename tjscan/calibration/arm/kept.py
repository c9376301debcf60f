"""What a calibration of the arm leaves in ``calibration.toml``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tjscan.calibration.arm.entry import ArmKinematicsEntry
from tjscan.calibration.arm.estimate import without_each_profile
from tjscan.calibration.arm.result import ArmCalibration, list_undetermined
from tjscan.calibration.result import HandEyeCalibration, SampleResidual
from tjscan.core.frames import Array

METHOD = "ball, with the arm's kinematics"
"""What `HandEyeCalibration.method` says of it."""


def as_hand_eye_calibration(found: ArmCalibration, names: Sequence[str]) -> HandEyeCalibration:
    """The sensor's part of a calibration of the arm on a ball.

    Parameters
    ----------
    found : ArmCalibration
        What was found.
    names : sequence of str
        Of all profiles, those held out as well.
    """
    estimate = found.estimate
    return HandEyeCalibration(
        found.T_f_s,
        found.covariance,
        METHOD,
        _residuals(found, names),
        _condition(found.covariance[:6, :6]),
        estimate.chi2,
        estimate.dof,
        estimate.sigma_scale,
        centre_b=estimate.target[:3],
        radius=float(estimate.target[3]),
        by_laser=found.by_laser,
    )


def kinematics_entry(found: ArmCalibration, model: str) -> ArmKinematicsEntry:
    """The arm's part, for an arm whose kinematics are called `model`."""
    check = found.cross_check
    return ArmKinematicsEntry.from_si(
        model,
        found.deviations,
        found.covariance,
        tuple(list_undetermined(found.undetermined)),
        (check.count, check.before, check.after),
    )


def _residuals(found: ArmCalibration, names: Sequence[str]) -> tuple[SampleResidual, ...]:
    estimate, stacked = found.estimate, found.estimate.stacked
    falls, steps = without_each_profile(estimate)
    residuals = []
    for i, name in enumerate(names):
        if found.held_out[i]:
            continue
        own = stacked.profile == i
        lengths = stacked.residuals[own & stacked.is_length]
        residuals.append(
            SampleResidual(
                name,
                bool(estimate.used[i]),
                float(np.linalg.norm(lengths)),
                None,
                float(np.sqrt(falls[i] / own.sum())),
                float(np.linalg.norm(steps[i, :3])),
                float(np.linalg.norm(steps[i, 3:])),
            )
        )
    return tuple(residuals)


def _condition(covariance: Array) -> float:
    """Of the sensor's pose, each number of it in units of its own certainty."""
    sigma = np.sqrt(np.diag(covariance))
    return float(np.sqrt(np.linalg.cond(covariance / np.outer(sigma, sigma))))
