"""How lines and arcs answer to a laser's own deviation: as when they are fitted again."""

from __future__ import annotations

import numpy as np
from calibration_stage import EXACT_HAND, NOISE, WINDOW, looking

from tjscan.calibration.circle_fit import fit_dominant_circle
from tjscan.calibration.laser_error import circle_by_laser, line_by_laser
from tjscan.calibration.line_fit import fit_line
from tjscan.core.frames import Array
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.profile import Profile

LASER = LaserDeviation.in_window(
    2e-6, near=WINDOW.near, far=WINDOW.far, apex_z=WINDOW.apex_z, half_angle=WINDOW.half_angle
)
"""So small that squares of it do not count."""


def bent(profile: Profile) -> list[Profile]:
    """The profile as each draw of the deviation has it."""
    xz = np.column_stack((profile.x_s, profile.z_s))
    return [Profile(*(xz + by).T) for by in np.moveaxis(LASER.at(xz), 2, 0)]


def test_a_line_moves_as_it_does_when_fitted_again() -> None:
    profile = EXACT_HAND.profile(looking(12.0, 25.0, shift=(0.004, 0.01)), np.random.default_rng(0))
    line = fit_line(profile, NOISE)
    across = np.array((-line.direction_s[2], 0.0, line.direction_s[0]))

    def change(other: Profile) -> tuple[float, float]:
        again = fit_line(other, NOISE)
        return float((again.point_s - line.point_s) @ across), float(again.direction_s @ across)

    found = np.array([change(other) for other in bent(profile)]).T
    np.testing.assert_allclose(line_by_laser(line, profile, LASER), found, atol=2e-9)


def test_an_arc_moves_as_it_does_when_fitted_again() -> None:
    angle = np.linspace(-0.7, 0.9, 300)
    profile = Profile(0.01 + 0.03 * np.sin(angle), 0.26 - 0.03 * np.cos(angle))
    arc = fit_dominant_circle(profile, NOISE)

    def numbers(other: Profile) -> Array:
        again = fit_dominant_circle(other, NOISE)
        return np.array((again.centre_s[0], again.centre_s[2], again.radius))

    found = np.array([numbers(other) - numbers(profile) for other in bent(profile)]).T
    np.testing.assert_allclose(circle_by_laser(arc, profile, LASER), found, atol=2e-9)


def test_the_middle_of_the_window_is_in_the_middle() -> None:
    """Odd terms leave it alone: a scale and a tilt are none there."""
    middle = np.array([[0.0, 0.5 * (WINDOW.near + WINDOW.far)]])
    by_x = LASER.at(middle)[0, 0]
    assert np.count_nonzero(np.abs(by_x) > 1e-12) == 2  # of second degree: x x and z z
