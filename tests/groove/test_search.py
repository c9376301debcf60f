"""The search for a groove: pieces, candidates and chains are the best of all there are."""

from dataclasses import replace
from itertools import combinations, pairwise, product

import numpy as np
import pytest
from grooves import MM, Groove, Noise, draw
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.candidates import (
    BEAD_KIND,
    CANDIDATE_KINDS,
    LEAST_UNEVENNESS,
    LONGEST_PIECE_BLOCKS,
    NOISE_INFLATION,
    PIECE_COST,
    POINTS_PER_BLOCK,
    ProjectivePoints,
    find_pieces,
    project_points,
    propose_candidates,
)
from tjscan.groove.chains import (
    FEWEST_INNER_POINTS,
    FEWEST_OUTER_POINTS,
    LEAST_SUPPORT_SHARE,
    SIDE_LENGTH_SLACK,
    ChainSearch,
    kinds_of_sides,
)
from tjscan.groove.read import fit_groove, order_points, read_groove
from tjscan.groove.reflections import PointRuns, find_runs
from tjscan.groove.settings import (
    BUTT_V,
    DEFAULT_SETTINGS,
    LEAST_FACE_TURN,
    TEE_GROOVE,
    TEE_NO_ROOT,
    GrooveModel,
)
from tjscan.laser.profile import Profile

TOLERANCE = DEFAULT_SETTINGS.support_tolerance


def ordered(points: Array) -> Profile:
    """Points from wall to leg, one a column."""
    return Profile(*points.T)


def drawn(seed: int, noise: float = 0.03, ghosts: float = 0.0) -> Profile:
    return order_points(draw(Groove(), Noise(noise * MM, ghosts=ghosts), seed), DEFAULT_SETTINGS)


def search_of(row: Profile) -> tuple[ChainSearch, ProjectivePoints, PointRuns]:
    points = project_points(row, DEFAULT_SETTINGS.noise)
    runs = find_runs(row)
    pieces = find_pieces(points, runs)
    candidates = propose_candidates(points, pieces)
    return ChainSearch(points, candidates, runs, TOLERANCE), points, runs


@pytest.mark.parametrize("noise", [0.01, 0.02, 0.04])
def test_the_noise_of_a_bent_surface_is_that_of_its_points(noise: float) -> None:
    found = [project_points(drawn(seed, noise), 1.0).noise for seed in range(8)]
    assert np.median(found) == pytest.approx(noise * MM, rel=0.25)


def test_steps_of_a_sensor_that_rounds_are_noise() -> None:
    x = np.linspace(-20, 20, 400)[::-1] * MM
    heights = np.round((200 * MM + 0.05 * x) / (0.1 * MM)) * 0.1 * MM
    assert project_points(ordered(np.column_stack((x, heights))), 1.0).noise > 0.03 * MM


@given(seed=st.integers(0, 10_000))
def test_no_other_division_into_lines_costs_less(seed: int) -> None:
    random = np.random.default_rng(seed)
    x = np.linspace(10, -10, 7 * POINTS_PER_BLOCK) * MM
    bends = random.uniform(-10, 10, 2) * MM
    z = 0.2 + sum(random.uniform(-1, 1) * np.maximum(x - bend, 0) for bend in bends)
    row = ordered(np.column_stack((x, z + random.normal(0, 0.03 * MM, len(x)))))
    points = project_points(row, 0.05 * MM)
    runs = PointRuns(np.array([0]), np.array([len(x)]), np.array([False]))
    pieces = find_pieces(points, runs)
    variance = NOISE_INFLATION * (points.noise**2 + LEAST_UNEVENNESS**2)

    def cost(edges: tuple[int, ...]) -> float:
        total = 0.0
        for a, b in pairwise(edges):
            line = np.polynomial.Polynomial.fit(points.u[a:b], points.y[a:b], 1)
            off = (points.y[a:b] - line(points.u[a:b])) * points.z[a:b] ** 2
            total += PIECE_COST + float(off @ off) / (2 * variance)
        return total

    inner = range(POINTS_PER_BLOCK, len(x), POINTS_PER_BLOCK)
    every = [(0, *cut, len(x)) for n in range(len(inner) + 1) for cut in combinations(inner, n)]
    found = (*pieces.first.tolist(), len(x))
    # Depth weighs a little unlike its square times a line through unweighted points.
    assert cost(found) == pytest.approx(min(map(cost, every)), rel=1e-3, abs=1e-3)


def test_a_long_line_is_divided_and_grown_together_again() -> None:
    count = 3 * LONGEST_PIECE_BLOCKS * POINTS_PER_BLOCK // 2
    x = np.linspace(20, -20, count) * MM
    row = ordered(np.column_stack((x, 0.2 + 0.3 * x)))
    points = project_points(row, DEFAULT_SETTINGS.noise)
    pieces = find_pieces(points, find_runs(row))
    assert len(pieces.first) > 1
    candidates = propose_candidates(points, pieces)
    assert (candidates.first == points.u[0]).any()
    assert ((candidates.first == points.u[0]) & (candidates.last == points.u[-1])).any()
    np.testing.assert_allclose(candidates.scaled_distances(points, 1.0)[0], 0, atol=1e-9)


@pytest.mark.parametrize("radius", [-60.0, 30.0, 300.0])
def test_a_candidate_is_the_curve_that_it_is_drawn_as(radius: float) -> None:
    """About its middle: farther off a parabola over its tangent is not one in (u, y)."""
    angle = np.linspace(0.25, -0.25, 300) * 5 / abs(radius)
    circle = abs(radius) * MM * np.column_stack((np.sin(angle), np.cos(angle) - 1))
    row = ordered((circle * (1, np.sign(radius))) @ np.array([[0.8, 0.6], [-0.6, 0.8]]) + (0, 0.2))
    points = project_points(row, DEFAULT_SETTINGS.noise)
    pieces = find_pieces(points, find_runs(row))
    candidates = propose_candidates(points, pieces)
    length = (candidates.last - candidates.first) * (candidates.kind == BEAD_KIND)
    longest = int(length.argmax())
    curve = candidates.as_curves()[longest]
    assert np.abs(curve.signed_distances(row.points)).max() < 0.02 * MM
    np.testing.assert_allclose(
        candidates.scaled_distances(points, 1.0)[longest],
        curve.signed_distances(row.points),
        atol=0.01 * MM,
    )
    assert abs(curve.c2) == pytest.approx(500 / abs(radius), rel=0.15)


@pytest.mark.parametrize("model", [TEE_NO_ROOT, TEE_GROOVE], ids=lambda model: model.name)
@pytest.mark.parametrize("seed", range(3))
def test_no_other_chain_of_candidates_costs_less(
    model: GrooveModel, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled = search_of(drawn(seed, ghosts=0.02))[0].cheapest_chains(model, 1)
    monkeypatch.setattr(kernel, "compiled", None)
    search, points, runs = search_of(drawn(seed, ghosts=0.02))
    candidates, corners = search.candidates, search._corners
    best = np.inf
    layers = [np.flatnonzero(np.isin(candidates.kind, kinds)) for kinds in kinds_of_sides(model)]
    assert max(candidates.kind) < len(CANDIDATE_KINDS)
    support = 1 - search._costs
    for chain in product(*(layer.tolist() for layer in layers)):
        pair = list(chain[:-1]), list(chain[1:])
        turns = corners.before[pair] - corners.after[pair]
        if not all(b.least <= t <= b.most for t, b in zip(turns, model.turns, strict=True)):
            continue
        edges = [0, *corners.place[pair].tolist(), len(points.u)]
        spans = list(zip(chain, edges, edges[1:], strict=False))
        if any(b <= a for _, a, b in spans[1:-1]):
            continue
        shown = [support[k, a:b].sum() for k, a, b in spans]
        if any(
            n < LEAST_SUPPORT_SHARE * (b - a) for n, (_, a, b) in zip(shown, spans, strict=True)
        ):
            continue
        if min(shown[1:-1]) < FEWEST_INNER_POINTS:
            continue
        if min(shown[0], shown[-1]) < FEWEST_OUTER_POINTS:
            continue
        lengths = np.hypot(np.diff(corners.x[pair]), np.diff(corners.z[pair]))
        if any(
            not s.shortest * SIDE_LENGTH_SLACK < n < s.longest / SIDE_LENGTH_SLACK
            for n, s in zip(lengths, model.sides[1:-1], strict=True)
        ):
            continue
        bead = len(chain) - 2
        if model.sides[bead].bead:
            before, after = pair[0][bead - 1 :], pair[1][bead - 1 :]
            (x, z) = (np.diff(v[before, after])[0] for v in (corners.x, corners.z))
            start = corners.before[before[0], after[0]]
            end = corners.after[before[1], after[1]]
            if min(start - np.arctan2(z, -x), np.arctan2(z, -x) - end) <= LEAST_FACE_TURN:
                continue
        costs = np.concatenate([search._costs[k, a:b] for k, a, b in spans])
        best = min(best, float(runs.total_cost(costs)))
    found = search.cheapest_chains(model, 1)
    assert np.isfinite(best)
    assert found[0].cost == pytest.approx(best)
    assert compiled[0].cost == pytest.approx(best)


def test_points_of_pure_chance_are_refused_soon() -> None:
    random = np.random.default_rng(0)
    x = np.linspace(40, -40, 640) * MM
    with pytest.raises(GrooveNotFound):
        read_groove(Profile(x, 0.2 + random.normal(0, 3 * MM, len(x))))


@pytest.mark.parametrize("far", [99999.0, 1e9, 3.4e38])
def test_a_value_that_stands_for_no_point_costs_none(far: float) -> None:
    profile = draw(Groove(), Noise(0.03 * MM), 1)
    expected = read_groove(profile).points_s
    x, z = profile.x_s.copy(), profile.z_s.copy()
    x[300] = z[300] = far
    np.testing.assert_allclose(read_groove(Profile(x, z)).points_s, expected, atol=0.05 * MM)


@pytest.mark.parametrize("compiled", [kernel.compiled, None])
@pytest.mark.parametrize("tiny", [1e-300, 1e-9, 1e-3])
def test_tiny_depths_are_no_points(
    tiny: float, compiled: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel, "compiled", compiled)
    profile = draw(Groove(), Noise(0.03 * MM), 1)
    points = []
    for depth in (np.nan, tiny):
        z = profile.z_s.copy()
        z[::40] = depth
        points.append(read_groove(Profile(profile.x_s, z)).points_s)
    np.testing.assert_array_equal(points[0], points[1])


@pytest.mark.parametrize("x", [0.0, 0.01, -0.03])
def test_all_points_on_one_ray_are_refused(x: float) -> None:
    for z in (np.full(640, 0.24), np.linspace(0.2, 0.3, 640)):
        with pytest.raises(GrooveNotFound):
            read_groove(Profile(x * z / 0.24, z))


@pytest.mark.parametrize("x", [0.0, 0.01])
def test_points_on_one_ray_are_no_surface(x: float) -> None:
    profile = draw(Groove(), Noise(0.03 * MM), 1)
    xs, zs = profile.x_s.copy(), profile.z_s.copy()
    xs[20:26], zs[20:26] = x, 0.3
    expected = read_groove(profile).points_s
    np.testing.assert_allclose(read_groove(Profile(xs, zs)).points_s, expected, atol=0.05 * MM)


@pytest.mark.parametrize("seed", range(60))
def test_a_streak_along_a_ray_has_a_curve(seed: int) -> None:
    """Even if rounding leaves nothing of its bend."""
    random = np.random.default_rng(seed)
    z = np.full(43, 0.25)
    z[:3] = random.uniform(0.2, 0.3) + 0.3 * MM * np.arange(3)
    u = np.linspace(0.3, 0.5, 43)
    u[:3] = random.uniform(-0.25, 0.25) + 10 ** random.uniform(-5, -4) * np.arange(3)
    row = ordered(np.column_stack((-u * z, z)))
    points = project_points(row, DEFAULT_SETTINGS.noise)
    candidates = propose_candidates(points, find_pieces(points, find_runs(row)))
    assert np.isfinite(candidates.coefficients).all()


@pytest.mark.parametrize("every", [3, 7])
def test_a_profile_of_short_runs_is_read_or_refused(every: int) -> None:
    profile = draw(Groove(), Noise(0.03 * MM), 1)
    z = profile.z_s.copy()
    z[::every] += 3 * MM
    few = np.full_like(z, np.nan)
    few[::every] = profile.z_s[::every]
    for heights in (z, few):
        try:
            section = read_groove(Profile(profile.x_s, heights))
        except GrooveNotFound:
            continue
        assert section.area > 0


def test_plates_that_turn_are_no_butt_joint() -> None:
    settings = replace(DEFAULT_SETTINGS, model=BUTT_V)
    outline = np.array([(40, 0), (10, 0), (2, 12), (-2, 12), (-10, 0), (-35, 24)]) * MM
    x = np.linspace(0.039, -0.034, 640)
    z = 0.2 + np.interp(x, outline[::-1, 0], outline[::-1, 1])
    with pytest.raises(GrooveNotFound):
        fit_groove(Profile(x, z), settings)
    level = outline.copy()
    level[-1, 1] = 0.0
    z = 0.2 + np.interp(x, level[::-1, 0], level[::-1, 1])
    assert len(fit_groove(Profile(x, z), settings).fitted.corners) == 4


def test_a_part_of_a_profile_keeps_its_sensors_columns() -> None:
    whole = drawn(3)
    part = Profile(
        whole.x_s[::2], whole.z_s[::2], columns=whole.columns[::2], column_count=whole.column_count
    )
    row = order_points(part, DEFAULT_SETTINGS)
    assert row.column_count == whole.column_count
    assert (row.columns == whole.columns[::2]).all()
