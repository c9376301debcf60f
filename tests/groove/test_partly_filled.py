"""A groove with weld in it: what is left of it is read, not what lies under the weld."""

from dataclasses import replace

import numpy as np
import pytest
from grooves import MM, Groove, Noise, arc, draw, seen, turned

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.read import read_groove
from tjscan.groove.root import ROOT_NOT_SEEN, WELD_IN_GROOVE
from tjscan.laser.profile import Profile

GROOVE = Groove(curvature=1.5)
NOISE = Noise(0.03 * MM)


def filled(
    groove: Groove, share: float, bow: float = 0.0, beads: int = 1, out: float = 1.0
) -> list[Array]:
    """The outline with weld up to a share of the bevel, and `out` times as far out on the leg.

    `bow` is the height of each bead over its chord, as a share of it; positive is convex.
    """
    p2, p3, p4 = groove.corners
    rise = share * groove.bevel
    leg = groove.outline()[3]
    toe = p3 + rise * (p2 - p3) / groove.bevel
    other = arc(p4, groove.directions[3], groove.curvature, out * rise)[-1]
    beyond = leg[(leg - p4) @ groove.directions[3] > out * rise]
    s = np.linspace(0, 1, 60 * beads + 1)
    chord = other - toe
    towards = turned(chord, np.pi / 2)
    towards *= np.sign(-towards[1])
    height = bow / beads * 4 * (s * beads % 1) * (1 - s * beads % 1)
    surface = toe + s[:, None] * chord + height[:, None] * towards
    return [groove.outline()[0], np.array([p2, toe]), surface, np.vstack((other, beyond))]


def area_left(groove: Groove, sides: list[Array]) -> float:
    """Of the polygon of p2, the weld's surface, and where the tangents of wall and leg meet.

    What stands out over both counts as less than nothing.
    """
    surface, leg = sides[2], sides[3][1] - sides[3][0]
    down, p2 = groove.directions[0], groove.corners[0]
    along = np.linalg.solve(np.column_stack((down, -leg)), surface[-1] - p2)[0]
    x, z = np.vstack((p2, surface, p2 + along * down)).T
    side = np.sign(leg[0] * down[1] - leg[1] * down[0])
    return 0.5 * float(side * (z @ np.roll(x, -1) - x @ np.roll(z, -1)))


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("bow", [-0.06, 0.0, 0.12])
def test_the_area_of_what_is_left_is_measured(share: float, bow: float) -> None:
    sides = filled(GROOVE, share, bow)
    for seed in range(4):
        section = read_groove(seen(sides, NOISE, seed))
        assert section.area == pytest.approx(area_left(GROOVE, sides), rel=0.015, abs=0.8e-6)
        assert ROOT_NOT_SEEN not in section.conditions


def test_the_area_of_what_is_left_is_as_certain_as_stated() -> None:
    """Top and tangent of a bent wall err together: apart they would explain too little."""
    groove = replace(GROOVE, wall_curvature=0.5)
    sides = filled(groove, 0.5)
    sections = [read_groove(seen(sides, NOISE, seed)) for seed in range(60)]
    variances = np.array([section.measure_covariance[3, 3] for section in sections])
    errors = np.array([section.area for section in sections]) - area_left(groove, sides)
    assert np.mean(errors**2 / variances) == pytest.approx(1, abs=0.3)


@pytest.mark.parametrize(
    ("share", "out"), [(0.6, 1.0), (0.6, 1.6), (0.7, 1.0), (0.75, 1.0), (0.6, 2.0), (0.75, 1.3)]
)
def test_a_weld_may_reach_out_over_the_leg_beyond_the_wall(share: float, out: float) -> None:
    """What it leaves beside the bevel counts, less what stands out beyond the wall."""
    sides = filled(GROOVE, share, out=out)
    truth = area_left(GROOVE, sides)
    for seed in range(3):
        if truth > 0:
            section = read_groove(seen(sides, NOISE, seed))
            assert section.area == pytest.approx(truth, rel=0.01, abs=1e-6)
        else:
            with pytest.raises(GrooveNotFound, match="nothing is left to fill"):
                read_groove(seen(sides, NOISE, seed))


@pytest.mark.parametrize(("share", "out"), [(0.5, 0.2), (0.6, 0.2), (0.7, 0.2), (0.7, 0.3)])
def test_a_weld_on_one_side_turns_little_from_the_bevel(share: float, out: float) -> None:
    """By 21 to 26 degrees: more than a second facet of the bevel would."""
    sides = filled(GROOVE, share, out=out)
    section = read_groove(seen(sides, NOISE))
    assert WELD_IN_GROOVE in section.conditions
    assert section.area == pytest.approx(area_left(GROOVE, sides), rel=0.01)


@pytest.mark.parametrize("left", [1.5, 2.0, 2.5, 3.0, 4.0])
@pytest.mark.parametrize("out", [0.3, 0.5, 1.6])
def test_a_short_rest_of_the_bevel_is_no_rounded_edge(left: float, out: float) -> None:
    """The flat weld may be taken for the bevel, but not surely."""
    sides = filled(GROOVE, 1 - left * MM / GROOVE.bevel, out=out)
    for seed in range(4):
        try:
            section = read_groove(seen(sides, NOISE, seed))
        except GrooveNotFound:
            continue
        off = np.linalg.norm(section.points_s[1, [0, 2]] - GROOVE.corners[0])
        assert off < 1 * MM or np.sqrt(np.trace(section.corner_covariances_s[0])) > 0.4 * MM


@pytest.mark.parametrize("beads", [2, 3])
def test_valleys_between_beads_are_no_corners(beads: int) -> None:
    sides = filled(GROOVE, 0.5, 0.15, beads)
    for seed in range(4):
        section = read_groove(seen(sides, NOISE, seed))
        assert section.area == pytest.approx(area_left(GROOVE, sides), rel=0.03)
        toes = section.points_s[2:4, [0, 2]] - np.array((sides[2][0], sides[2][-1]))
        sigmas = np.sqrt(np.trace(section.corner_covariances_s[1:], axis1=1, axis2=2))
        assert (np.linalg.norm(toes, axis=1) < 4 * sigmas).all()


def test_one_bead_of_three_is_no_tack() -> None:
    """The other two are steel that no root face leaves unexplained."""
    sides = filled(GROOVE, 0.4, 0.2, 3)
    for seed in range(3):
        section = read_groove(seen(sides, NOISE, seed))
        assert WELD_IN_GROOVE in section.conditions
        assert section.area == pytest.approx(area_left(GROOVE, sides), rel=0.01)


@pytest.mark.parametrize("share", [0.25, 0.35, 0.45])
def test_a_bead_as_high_as_a_tack_is_one_however_wide_it_is(share: float) -> None:
    """From 18 mm on it is read as a weld that fills the groove."""
    section = read_groove(seen(filled(GROOVE, share, 0.25), NOISE))
    assert section.on_tack
    assert section.absent == ("p3", "p4")


@pytest.mark.parametrize("bevel", [10 * MM, 14 * MM])
def test_a_shallow_rest_over_a_narrow_weld_is_read(bevel: float) -> None:
    """A narrow weld looks like a root's face: it need not be named to be welded over."""
    groove = replace(GROOVE, bevel=bevel)
    sides = filled(groove, 0.5)
    section = read_groove(seen(sides, NOISE))
    assert section.depth < 3 * MM
    assert section.area == pytest.approx(area_left(groove, sides), rel=0.02)


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


@pytest.mark.parametrize(("share", "bow"), [(0.8, 0.25), (0.85, 0.3)])
def test_an_overfull_groove_is_welded_already(share: float, bow: float) -> None:
    """What stands proud of the line between the tops is not to be filled."""
    sides = filled(GROOVE, share, bow)
    for seed in range(4):
        with pytest.raises(GrooveNotFound, match="already welded"):
            read_groove(seen(sides, NOISE, seed))


def hidden(sides: list[Array], columns: slice, seed: int = 0) -> Profile:
    """A profile that shows nothing in some of its columns."""
    profile = seen(sides, NOISE, seed)
    x = profile.x_s.copy()
    x[columns] = np.nan
    return Profile(x, profile.z_s)


@pytest.mark.parametrize("first", range(200, 440, 20))
def test_what_a_hole_hides_is_stated(first: int) -> None:
    """Over bevel, toe or weld: a corner is where it seems, is stated unsurely, or none is read."""
    sides = filled(GROOVE, 0.5, 0.1)
    corners = np.array((GROOVE.corners[0], sides[2][0], sides[2][-1]))
    for seed in range(2):
        try:
            section = read_groove(hidden(sides, slice(first, first + 50), seed))
        except GrooveNotFound:
            continue
        off = np.linalg.norm(section.points_s[1:4, [0, 2]] - corners, axis=1)
        sigmas = np.sqrt(np.trace(section.corner_covariances_s, axis1=1, axis2=2))
        assert not ((sigmas < 0.4 * MM) & (off > 1 * MM)).any()
        assert abs(section.area - area_left(GROOVE, sides)) < 4 * section.area_sigma + 2e-6


def test_a_weld_of_which_a_hole_hides_most_is_not_stated() -> None:
    sides = filled(GROOVE, 0.7, 0.1)
    toes = np.sort([p[0] / p[1] for p in (sides[2][0], sides[2][-1])])
    profile = seen(sides, NOISE, 0)
    rays = profile.x_s / profile.z_s
    first, stop = np.searchsorted(rays, toes[0] + np.array((0.1, 0.8)) * np.ptp(toes))
    with pytest.raises(GrooveNotFound, match="too little is seen of the weld"):
        read_groove(hidden(sides, slice(first, stop)))


def test_a_bead_that_rises_high_bounds_the_area_too() -> None:
    """One of three is 2.5 mm high: farther off any smooth surface than most noise."""
    sides = filled(GROOVE, 0.5)
    surface = sides[2]
    s = np.linspace(0, 1, len(surface))
    bump = 2.5 * MM * np.sin(np.pi * np.clip((s - 0.35) / 0.3, 0, 1)) ** 0.5
    sides[2] = surface - bump[:, None] * np.array((0.0, 1.0))
    for seed in range(3):
        section = read_groove(seen(sides, NOISE, seed))
        assert section.area == pytest.approx(area_left(GROOVE, sides), rel=0.03)
