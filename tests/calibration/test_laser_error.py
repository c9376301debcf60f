"""How lines and arcs answer to a laser's own deviation: as when they are fitted again."""

from __future__ import annotations

import numpy as np
from _targets import calibrate_on_plane
from calibration_stage import (
    EXACT_HAND,
    NOISE,
    WINDOW,
    circle,
    looking,
    shots,
    target,
)

from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.targets.ball import fit_circle
from tjscan.calibration.targets.line import fit_line
from tjscan.calibration.targets.target import PosedProfile, fit_profiles
from tjscan.core.frames import Array
from tjscan.core.pose_vector import boxminus
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.profile import Profile

LASER = LaserDeviation.for_window(2e-6, WINDOW)
"""So small that squares of it do not count."""


POSES = circle(25)


def bent(profile: Profile) -> list[Profile]:
    """The profile as each draw of the deviation has it."""
    xz = np.column_stack((profile.x_s, profile.z_s))
    return [Profile(*(xz + by).T) for by in np.moveaxis(LASER.displacements_at(xz), 2, 0)]


def test_a_line_moves_as_it_does_when_fitted_again() -> None:
    profile = EXACT_HAND.profile(looking(12.0, 25.0, shift=(0.004, 0.01)), np.random.default_rng(0))
    line = fit_line(profile, NOISE)
    across = np.array((-line.direction_s[2], 0.0, line.direction_s[0]))

    def change(other: Profile) -> tuple[float, float]:
        again = fit_line(other, NOISE)
        return float((again.point_s - line.point_s) @ across), float(again.direction_s @ across)

    found = np.array([change(other) for other in bent(profile)]).T
    np.testing.assert_allclose(line.by_laser(profile, LASER), found, atol=2e-9)


def test_an_arc_moves_as_it_does_when_fitted_again() -> None:
    angle = np.linspace(-0.7, 0.9, 300)
    profile = Profile(0.01 + 0.03 * np.sin(angle), 0.26 - 0.03 * np.cos(angle))
    arc = fit_circle(profile, NOISE)

    def numbers(other: Profile) -> Array:
        again = fit_circle(other, NOISE)
        return np.array((again.centre_s[0], again.centre_s[2], again.radius))

    found = np.array([numbers(other) - numbers(profile) for other in bent(profile)]).T
    np.testing.assert_allclose(arc.by_laser(profile, LASER), found, atol=2e-9)


def test_the_middle_of_the_window_is_in_the_middle() -> None:
    """Odd terms leave it alone: a scale and a tilt are none there."""
    middle = np.array([[0.0, 0.5 * (WINDOW.near + WINDOW.far)]])
    by_x = LASER.displacements_at(middle)[0, 0]
    assert np.count_nonzero(np.abs(by_x) > 1e-12) == 2  # of second degree: x x and z z


def calibrated(profiles: list[Profile]) -> HandEyeCalibration:
    taken = [
        PosedProfile(f"line {k}", T, profile)
        for k, (T, profile) in enumerate(zip(POSES, profiles, strict=True))
    ]
    samples, _ = fit_profiles(taken, fit_line, NOISE, LASER)
    return calibrate_on_plane(samples, target(), NOISE)


def test_a_calibration_is_off_as_it_says_with_a_laser_that_deviates() -> None:
    profiles = shots(POSES, EXACT_HAND, np.random.default_rng(0))
    exact = calibrated(profiles)
    assert exact.by_laser is not None
    each = [bent(profile) for profile in profiles]
    for draw in (0, 4, 11, 17):
        off = boxminus(calibrated([one[draw] for one in each]).T_f_s, exact.T_f_s)
        np.testing.assert_allclose(off, exact.by_laser[:6, draw], rtol=0.02, atol=3e-8)


def test_what_the_laser_deviates_by_is_part_of_the_covariance() -> None:
    found = calibrated(shots(POSES, EXACT_HAND, np.random.default_rng(0)))
    assert found.by_laser is not None
    rest = found.joint_covariance - found.by_laser @ found.by_laser.T
    assert np.linalg.eigvalsh(rest / np.sqrt(np.outer(np.diag(rest), np.diag(rest))))[0] > 0
