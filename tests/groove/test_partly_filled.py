"""A groove with weld in it: what is left of it is read, not what lies under the weld."""

import numpy as np
import pytest
from grooves import MM, Groove, Noise, arc, draw, seen, turned

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.read import read_groove
from tjscan.groove.root import ROOT_NOT_SEEN, WELD_IN_GROOVE

GROOVE = Groove(curvature=1.5)
NOISE = Noise(0.03 * MM)


def filled(groove: Groove, share: float, bow: float = 0.0, beads: int = 1) -> list[Array]:
    """The outline with weld up to a share of the bevel, and as far out on the leg.

    `bow` is the height of each bead over its chord, as a share of it; positive is convex.
    """
    p2, p3, p4 = groove.corners
    rise = share * groove.bevel
    leg = groove.outline()[3]
    toe = p3 + rise * (p2 - p3) / groove.bevel
    other = arc(p4, groove.directions[3], groove.curvature, rise)[-1]
    beyond = leg[(leg - p4) @ groove.directions[3] > rise]
    s = np.linspace(0, 1, 60 * beads + 1)
    chord = other - toe
    towards = turned(chord, np.pi / 2)
    towards *= np.sign(-towards[1])
    height = bow / beads * 4 * (s * beads % 1) * (1 - s * beads % 1)
    surface = toe + s[:, None] * chord + height[:, None] * towards
    return [groove.outline()[0], np.array([p2, toe]), surface, np.vstack((other, beyond))]


def area_left(groove: Groove, sides: list[Array]) -> float:
    """Of the polygon of p2, the weld's surface, and where the tangents of wall and leg meet."""
    surface, leg = sides[2], sides[3][1] - sides[3][0]
    down, p2 = groove.directions[0], groove.corners[0]
    along = np.linalg.solve(np.column_stack((down, -leg)), surface[-1] - p2)[0]
    x, z = np.vstack((p2, surface, p2 + along * down)).T
    return 0.5 * abs(float(x @ np.roll(z, -1) - z @ np.roll(x, -1)))


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("bow", [-0.06, 0.0, 0.12])
def test_the_area_of_what_is_left_is_measured(share: float, bow: float) -> None:
    sides = filled(GROOVE, share, bow)
    for seed in range(4):
        section = read_groove(seen(sides, NOISE, seed))
        assert section.area == pytest.approx(area_left(GROOVE, sides), rel=0.015, abs=0.8e-6)
        assert ROOT_NOT_SEEN not in section.conditions


@pytest.mark.parametrize("beads", [2, 3])
def test_valleys_between_beads_are_no_corners(beads: int) -> None:
    sides = filled(GROOVE, 0.5, 0.15, beads)
    for seed in range(4):
        section = read_groove(seen(sides, NOISE, seed))
        assert section.area == pytest.approx(area_left(GROOVE, sides), rel=0.03)
        toes = section.points_s[2:4, [0, 2]] - np.array((sides[2][0], sides[2][-1]))
        sigmas = np.sqrt(np.trace(section.corner_covariances_s[1:], axis1=1, axis2=2))
        assert (np.linalg.norm(toes, axis=1) < 4 * sigmas).all()


@pytest.mark.parametrize("bow", [-0.06, 0.0, 0.12])
def test_the_weld_is_named_and_its_toes_are_the_corners(bow: float) -> None:
    sides = filled(GROOVE, 0.6, bow)
    section = read_groove(seen(sides, NOISE))
    assert WELD_IN_GROOVE in section.conditions
    assert not section.absent
    corners = np.array((GROOVE.corners[0], sides[2][0], sides[2][-1]))
    assert np.abs(section.points_s[1:4, [0, 2]] - corners).max() < 0.15 * MM


def test_an_empty_groove_has_no_weld_in_it() -> None:
    assert not read_groove(draw(GROOVE, NOISE)).conditions


def test_a_full_groove_is_refused() -> None:
    with pytest.raises(GrooveNotFound):
        read_groove(seen(filled(GROOVE, 0.97), NOISE))


def test_the_stated_error_of_the_area_is_as_large_as_errors_are() -> None:
    sides = filled(GROOVE, 0.5, 0.1)
    truth = area_left(GROOVE, sides)
    found = [read_groove(seen(sides, NOISE, seed)) for seed in range(40)]
    scaled = [((section.area - truth) / section.area_sigma) ** 2 for section in found]
    assert 0.02 < float(np.mean(scaled)) < 2
