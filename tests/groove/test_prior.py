"""What the sections before say of a profile: what persists, counted once, dropped where wrong."""

from dataclasses import replace

import numpy as np
import pytest
from grooves import MM, Groove, Noise, cast, draw, pulled_in, raised_cosine

from tjscan.core.frames import Array
from tjscan.groove.prior import (
    NOTCH_PULLS,
    SCALE_THICKNESSES,
    GroovePrior,
    SectionEvidence,
    posterior,
)
from tjscan.groove.read import read_groove
from tjscan.groove.refinement import solve_with_prior
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile

NOISE = Noise(sigma=0.03 * MM)
GROOVE = Groove(root=0.006, curvature=2.0)
BEND = GROOVE.curvature / 2
STEP = 40 * MM
MICRON = 1e-6


def corners(section: GrooveSection) -> Array:
    return section.points_s[1:4, [0, 2]]


def normalised_squares(section: GrooveSection) -> Array:
    """Squared errors of p2, p3, p4 over their stated variances, by degrees of freedom."""
    off = corners(section) - GROOVE.corners
    return np.array(
        [
            d @ np.linalg.solve(c, d) / 2
            for d, c in zip(off, section.corner_covariances_s, strict=True)
        ]
    )


def about(values: Array, mean: float, sigma: float) -> Array:
    return np.asarray(-0.5 * ((values - mean) / sigma) ** 2)


def evidence(section: GrooveSection) -> SectionEvidence:
    assert section.evidence is not None
    return section.evidence


def with_scale(profile: Profile, thickness: float, seed: int) -> Profile:
    """A profile whose wall and leg are covered by scale in patches of some 8 mm, bare between."""
    rng = np.random.default_rng(seed)
    rays = np.column_stack((profile.x_s, profile.z_s))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    _, side, tangent = cast(GROOVE.outline(), np.zeros_like(rays), rays)
    outer = (side == 0) | (side == 3)
    wave = np.sin(np.arange(len(side)) * 2 * np.pi / 90 + rng.uniform(0, 2 * np.pi))
    square = np.abs(rays[:, 0] * tangent[:, 1] - rays[:, 1] * tangent[:, 0])
    scale = 1 - np.where(outer & (wave > 0.4), thickness / square, 0.0) / profile.z_s * rays[:, 1]
    return Profile(profile.x_s * scale, profile.z_s * scale)


def chain(profiles: list[Profile]) -> list[GrooveSection]:
    """Sections a step apart, each read with what those before it say."""
    found: list[GrooveSection] = []
    for profile in profiles:
        before = [(evidence(one), STEP * (len(found) - i)) for i, one in enumerate(found)]
        found.append(read_groove(profile, prior=GroovePrior.from_sections(before)))
    return found


def test_a_prior_that_knows_nothing_changes_nothing() -> None:
    for groove in (GROOVE, Groove(roll=0.2), Groove(curvature=3.3, root=0.01)):
        profile = draw(groove, Noise(sigma=0))
        known = read_groove(profile, prior=GroovePrior())
        assert np.abs(corners(known) - corners(read_groove(profile))).max() < MICRON
    assert GroovePrior.from_sections([]).bend_sigmas.tolist() == [np.inf, np.inf]


def test_a_prior_and_a_fit_make_the_product_of_two_normal_distributions() -> None:
    rng = np.random.default_rng(3)
    basis = rng.standard_normal((4, 30))
    y, mean, sigmas = rng.standard_normal(30), rng.standard_normal(4), rng.uniform(0.1, 2, 4)
    mean[[0, 1, 3]] = 0  # of a side's bend alone anything is expected
    equations = ((basis @ basis.T)[None], (basis @ y)[None])
    found, inverse = solve_with_prior(equations, 1 / sigmas[None] ** 2, mean[2:3])
    P, C = np.linalg.inv(basis @ basis.T), np.diag(sigmas**2)
    gain = P @ np.linalg.inv(P + C)
    alone = P @ basis @ y
    np.testing.assert_allclose(found[0], alone + gain @ (mean - alone))
    np.testing.assert_allclose(inverse[0], P - gain @ P)


def test_likelihoods_on_a_grid_make_that_product_too() -> None:
    (m, s), (x, t) = (0.25 * MM, 0.05 * MM), (0.20 * MM, 0.04 * MM)
    values = np.linspace(0, 0.5 * MM, 21)
    p = posterior(about(values, m, s), about(values, x, t))
    variance = 1 / (1 / s**2 + 1 / t**2)
    assert p @ values == pytest.approx(variance * (m / s**2 + x / t**2), rel=1e-3)
    assert p @ values**2 - (p @ values) ** 2 == pytest.approx(variance, rel=1e-2)


@pytest.mark.parametrize("seed", range(3))
def test_a_section_says_what_its_profile_does_whatever_it_was_told(seed: int) -> None:
    profile = draw(GROOVE, NOISE, seed)
    told = replace(GroovePrior(), bends=np.array([0.0, BEND]), bend_sigmas=np.full(2, 0.2))
    alone, with_it = (
        evidence(read_groove(profile, prior=prior)) for prior in (GroovePrior(), told)
    )
    # Its bend is nearly the same, as is its uncertainty: what it was told does not count again.
    np.testing.assert_allclose(with_it.bends, alone.bends, atol=alone.bend_sigmas.max())
    np.testing.assert_allclose(with_it.bend_sigmas, alone.bend_sigmas, rtol=0.2)
    assert abs(alone.bends[1] - BEND) < 4 * alone.bend_sigmas[1]


WRONG = {
    "bends": replace(GroovePrior(), bends=np.array([1.5, -2.0]), bend_sigmas=np.full(2, 0.2)),
    "pull": GroovePrior.from_sections(
        [(SectionEvidence(np.zeros(2), np.full(2, np.inf),
          50 * about(NOTCH_PULLS, 0.5 * MM, 0.1 * MM), np.zeros(len(SCALE_THICKNESSES))), STEP)]
    ),
    "thickness": GroovePrior.from_sections(
        [(SectionEvidence(np.zeros(2), np.full(2, np.inf), np.zeros(len(NOTCH_PULLS)),
          50 * about(SCALE_THICKNESSES, 0.4 * MM, 0.05 * MM)), STEP)]
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
@pytest.mark.parametrize("seed", range(3))
def test_a_wrong_prior_makes_no_reading_wrong_and_sure(what: str, seed: int) -> None:
    section = read_groove(draw(GROOVE, NOISE, seed), prior=WRONG[what])
    assert normalised_squares(section).max() < 8
    off = np.linalg.norm(corners(section) - GROOVE.corners, axis=1)
    assert off.max() < 0.6 * MM


def test_a_pull_is_told_from_section_to_section() -> None:
    profiles = [
        pulled_in(draw(GROOVE, NOISE, seed), GROOVE, 0.2 * MM, raised_cosine) for seed in range(8)
    ]
    found = chain(profiles)
    alone = [read_groove(profile) for profile in profiles]
    errors, before = (
        np.linalg.norm([corners(one) - GROOVE.corners for one in some], axis=2)[3:, 1:]
        for some in (found, alone)
    )
    assert np.median(errors) < 0.6 * np.median(before)
    assert np.mean([normalised_squares(one)[1:] for one in found]) < 2


@pytest.mark.parametrize("by", [0.4, 0.8, 1.2])
def test_a_strong_pull_is_told_as_it_is(by: float) -> None:
    """Points that it moves far off their flanks are no outliers: they show it."""
    profiles = [
        pulled_in(draw(GROOVE, NOISE, seed), GROOVE, by * MM, raised_cosine) for seed in range(6)
    ]
    found = chain(profiles)
    shown = [float(NOTCH_PULLS[evidence(one).log_pulls.argmax()]) for one in found]
    assert np.median(shown) == pytest.approx(by * MM, rel=0.3)
    off = np.linalg.norm(corners(found[-1]) - GROOVE.corners, axis=1)
    assert off.max() < 0.2 * by * MM
    assert normalised_squares(found[-1]).max() < 4


def test_scale_is_told_from_section_to_section() -> None:
    profiles = [with_scale(draw(GROOVE, NOISE, seed), 0.3 * MM, seed) for seed in range(8)]
    found, alone = chain(profiles), [read_groove(profile) for profile in profiles]
    errors, before = (
        np.linalg.norm([corners(one) - GROOVE.corners for one in some], axis=2)[1:, [0, 2]]
        for some in (found, alone)
    )
    # Where it shows in a profile it is found without the sections before, too.
    assert np.sqrt(np.mean(errors**2)) < np.sqrt(np.mean(before**2))
    last = GroovePrior.from_sections([(evidence(one), STEP) for one in found])
    for side in last.log_thicknesses:
        assert SCALE_THICKNESSES[side.argmax()] == pytest.approx(0.3 * MM, abs=0.05 * MM)


def test_sound_sections_are_read_no_worse_one_after_the_other_and_stay_honest() -> None:
    profiles = [draw(GROOVE, NOISE, seed) for seed in range(12)]
    found, alone = chain(profiles), [read_groove(profile) for profile in profiles]
    errors, before = (
        np.sqrt(np.mean([(corners(one) - GROOVE.corners) ** 2 for one in some]))
        for some in (found, alone)
    )
    assert errors < 1.1 * before
    assert 0.3 < np.mean([normalised_squares(one) for one in found]) < 2


def test_what_lies_far_back_counts_less_and_the_same_patches_count_once() -> None:
    likely = SectionEvidence(
        np.zeros(2),
        np.ones(2),
        about(NOTCH_PULLS, 0.2 * MM, 0.1 * MM),
        np.zeros(len(SCALE_THICKNESSES)),
    )

    def sure(*aways: float) -> float:
        prior = GroovePrior.from_sections([(likely, away) for away in aways])
        return float(np.exp(prior.log_pulls)[NOTCH_PULLS.searchsorted(0.19 * MM)])

    assert sure(2.0) < sure(0.5) < sure(0.04)
    assert sure(0.040, 0.040) == pytest.approx(sure(0.040))
    assert sure(0.08, 0.04) > sure(0.04)


@pytest.mark.parametrize("seed", range(4))
def test_a_wave_of_a_wall_is_no_scale_and_steps_are(seed: int) -> None:
    """In a single profile: scale is found by its edges, which a wave has not."""
    profile = draw(GROOVE, NOISE, seed)
    wave = 0.15 * MM * np.sin(profile.x_s * 2 * np.pi / (20 * MM))
    waved = Profile(profile.x_s, profile.z_s + wave)
    assert read_groove(waved).evidence is None
    assert read_groove(with_scale(profile, 0.3 * MM, seed)).evidence is not None
    assert read_groove(with_scale(profile, 0.9 * MM, seed)).evidence is None  # none is so thick


def test_what_leads_over_to_patches_of_scale_draws_no_side_after_it() -> None:
    """Without the drop of points beside ghosts the leg's corner is off by 0.1 mm and more."""
    leg = [
        corners(read_groove(with_scale(draw(GROOVE, NOISE, seed), 0.4 * MM, seed)))[2]
        for seed in range(40)
    ]
    off = np.linalg.norm(leg - GROOVE.corners[2], axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.07 * MM
