"""Each fault of the simulated laser has the size, the place and the randomness it is given."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.laser.faults import (
    FaultRandomStreams,
    LaserRayHits,
    PointOrigin,
    SimulatedProfile,
    apply_faults,
    choose_column_runs,
    correlated_noise,
)
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import laser_ray_directions

N = 640
EXACT = 1e-12
RAYS = laser_ray_directions(LaserModel.without_faults())
ALL_ON = LaserModel(ghosts=0.1, missing=0.05, flyers=0.8, strays=0.1)


def hits(
    incidence: float = 0.0, z: Array | float = 0.24, ghost: NDArray[np.bool_] | None = None
) -> LaserRayHits:
    """A face at depth z, under the same incidence in every column, square to no ray's side.

    Ghosts, where there are any, lie 20 mm behind it.
    """
    distance = (np.broadcast_to(z, N) - LaserModel().emitter_z) / RAYS[:, 2]
    toward = -RAYS * np.cos(incidence) + np.array([0, 1.0, 0]) * np.sin(incidence)
    images = np.where(np.zeros(N, bool) if ghost is None else ghost, distance + 0.02, np.nan)
    return LaserRayHits(RAYS, distance, toward, np.ones(N, bool), images)


def taken(view: LaserRayHits, model: LaserModel, seed: int = 0) -> SimulatedProfile:
    return apply_faults(view, model, FaultRandomStreams.spawn(np.random.default_rng(seed)))


def along(points: SimulatedProfile) -> Array:
    """Distance of each point from the emitter."""
    return np.hypot(points.x_s, points.z_s - LaserModel().emitter_z)


def runs_of(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Lengths of the runs of true columns."""
    steps = np.diff(np.concatenate(([0], mask.astype(int), [0])))
    return np.asarray(np.flatnonzero(steps == -1) - np.flatnonzero(steps == 1))


def groove() -> LaserRayHits:
    """A view with everything in it: a jump, a crease, mirrors, a grazing face."""
    z = np.where(np.arange(N) < 200, 0.23, 0.26)
    view = hits(0.5, z, ghost=(np.arange(N) > 250) & (np.arange(N) < 500))
    normals = view.normals_s.copy()
    normals[400:, 0] += 0.9
    normals[560:] = hits(np.radians(70)).normals_s[560:]
    return replace(view, normals_s=normals / np.linalg.norm(normals, axis=1, keepdims=True))


def test_without_faults_the_points_are_what_is_seen() -> None:
    view = groove()
    points = taken(view, LaserModel.without_faults())
    np.testing.assert_allclose(along(points), view.distance, atol=EXACT)
    np.testing.assert_allclose(points.x_s, view.distance * RAYS[:, 0], atol=EXACT)
    assert np.all(points.kind == PointOrigin.TRUE)


@pytest.mark.parametrize("correlation", [0.0, 3.0, 4.0, 10.0])
def test_noise_has_its_sigma_everywhere_and_its_correlation(correlation: float) -> None:
    rng = np.random.default_rng(3)
    e = np.array([correlated_noise(rng, N, 30e-6, correlation) for _ in range(1500)])
    # 1500 profiles: each column's sigma is good to 1.8 %, five times that is never reached.
    np.testing.assert_allclose(e.std(axis=0), 30e-6, rtol=0.1)
    np.testing.assert_allclose(e.std(), 30e-6, rtol=0.01)
    for lag in (1, 3, 4, 10, 30):
        expected = np.exp(-((lag / correlation) ** 2)) if correlation else 0.0
        r = np.mean(e[:, lag:] * e[:, :-lag]) / 30e-6**2
        assert r == pytest.approx(expected, abs=0.02)


def test_noise_moves_points_along_their_rays() -> None:
    points = taken(hits(), LaserModel.without_faults(noise=50e-6))
    z = points.z_s - LaserModel().emitter_z
    np.testing.assert_allclose(points.x_s * RAYS[:, 2], z * RAYS[:, 0], atol=EXACT)
    assert np.std(along(points) - hits().distance) == pytest.approx(50e-6, rel=0.3)


def test_bias_grows_with_incidence_and_is_bounded() -> None:
    model = LaserModel.without_faults(bias=LaserModel().bias)
    biases = np.array(
        [along(taken(hits(a), model)) - hits(a).distance for a in np.radians(range(0, 90, 2))]
    )
    assert np.all(np.diff(biases, axis=0) >= -EXACT)
    np.testing.assert_allclose(biases[0], 0, atol=EXACT)
    assert biases.max() == pytest.approx(0.1e-3, abs=EXACT)
    middle = along(taken(hits(np.pi / 4), model)) - hits().distance
    assert middle[N // 2] == pytest.approx(model.bias, rel=0.01)


def test_points_drop_out_with_growing_incidence() -> None:
    model = LaserModel.without_faults(dropout=1.0)
    # Every ray of `hits` lies in the x-z plane, so the incidence is the same in each column.
    left = [
        np.mean(
            [(taken(hits(np.radians(a)), model, s).kind == PointOrigin.TRUE) for s in range(20)]
        )
        for a in (0, 40, 59.9, 64, 68, 72, 76, 80.1, 89)
    ]
    assert np.all(np.diff(left) <= 0)
    assert left[:3] == [1, 1, 1]
    assert left[-2:] == [0, 0]
    assert left[5] == pytest.approx(0.4, abs=0.03)


@settings(deadline=None, max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    eligible=st.integers(0, 640),
    count=st.integers(0, 640),
    run=st.tuples(st.integers(1, 30), st.integers(0, 30)).map(lambda r: (r[0], r[0] + r[1])),
)
def test_runs_hold_the_count_and_keep_their_lengths(
    seed: int, eligible: int, count: int, run: tuple[int, int]
) -> None:
    columns = np.arange(eligible) + 7
    chosen = choose_column_runs(np.random.default_rng(seed), columns, count, run)
    assert len(chosen) == min(count, eligible)
    assert np.all(np.diff(chosen) > 0)
    assert np.isin(chosen, columns).all()
    mask = np.zeros(660, bool)
    mask[chosen] = True
    lengths = runs_of(mask)
    # With room between the runs each keeps its length; only one may be cut to fit the count.
    if len(chosen) and eligible - count >= -(-count // run[0]):
        assert lengths.max() <= run[1]
        assert np.count_nonzero(lengths < run[0]) <= 1


@pytest.mark.parametrize("fraction", [0.0, 0.02, 0.065, 0.15])
def test_ghosts_are_the_asked_fraction_in_runs(fraction: float) -> None:
    view = hits(ghost=np.arange(N) >= 300)
    model = LaserModel.without_faults(ghosts=fraction)
    kinds = np.array([taken(view, model, seed).kind for seed in range(40)])
    ghosts = kinds == PointOrigin.GHOST
    # One column more or less per profile is as near as a whole number comes.
    assert ghosts.mean() == pytest.approx(fraction, abs=0.5 / N)
    assert not ghosts[:, :300].any()
    for row in ghosts:
        lengths = runs_of(row)
        assert np.all(lengths <= model.ghost_run[1])
        assert np.count_nonzero(lengths < model.ghost_run[0]) <= 1


def test_ghosts_lie_at_their_image_and_are_dim() -> None:
    view = hits(ghost=np.ones(N, bool))
    points = taken(view, LaserModel.without_faults(ghosts=0.15))
    ghosts = points.kind == PointOrigin.GHOST
    np.testing.assert_allclose(along(points)[ghosts], view.ghost[ghosts], atol=EXACT)
    np.testing.assert_allclose(along(points)[~ghosts], view.distance[~ghosts], atol=EXACT)
    assert points.intensity[ghosts].max() < points.intensity[~ghosts].min()


def test_no_face_turns_into_a_mirror_altogether() -> None:
    view = hits(ghost=np.arange(N) >= 600)
    model = LaserModel.without_faults(ghosts=0.15)
    assert np.sum(taken(view, model).kind == PointOrigin.GHOST) == model.ghost_share * 40
    assert not np.any(taken(hits(), model).kind == PointOrigin.GHOST)


@pytest.mark.parametrize("fraction", [0.02, 0.1])
def test_missing_points_are_the_asked_fraction_in_short_runs(fraction: float) -> None:
    model = LaserModel.without_faults(missing=fraction)
    missing = np.array([taken(hits(), model, s).kind == PointOrigin.MISSING for s in range(60)])
    assert missing.mean() == pytest.approx(fraction, abs=0.5 / N)
    assert max(runs_of(row).max() for row in missing) <= model.missing_run[1]


def test_flyers_fly_only_beside_edges_and_between_their_sides() -> None:
    view = groove()
    model = LaserModel.without_faults(flyers=1.0, flyer_overshoot=0.0)
    points = taken(view, model)
    flyers = np.flatnonzero(points.kind == PointOrigin.FLYER)
    np.testing.assert_array_equal(flyers, [199, 200, 399, 400, 559, 560])
    sides = np.sort(view.distance[[199, 200]])
    jumped = along(points)[[199, 200]]
    assert np.all((jumped >= sides[0] - EXACT) & (jumped <= sides[1] + EXACT))
    assert np.all(np.abs(jumped - view.distance[[199, 200]]) > 1e-4)
    smooth = taken(hits(0.5), replace(model, flyer_jump=5e-3))
    assert not np.any(smooth.kind == PointOrigin.FLYER)


def test_where_the_surface_ends_nothing_flies() -> None:
    view = hits()
    gone = np.arange(N) >= 300
    view = replace(
        view,
        distance=np.where(gone, np.inf, view.distance),
        normals_s=np.where(gone[:, None], 0.0, view.normals_s),
        seen=~gone,
    )
    points = taken(view, LaserModel.without_faults(flyers=1.0))
    np.testing.assert_array_equal(
        points.kind, np.where(gone, PointOrigin.MISSING, PointOrigin.TRUE)
    )


def test_flyers_come_as_often_as_asked() -> None:
    model = LaserModel.without_faults(flyers=0.3)
    flyers = [np.sum(taken(groove(), model, s).kind == PointOrigin.FLYER) for s in range(500)]
    assert np.mean(flyers) == pytest.approx(0.3 * 6, rel=0.1)


def test_raw_coordinates_are_whole_steps() -> None:
    points = taken(hits(), LaserModel.without_faults(step=5e-6, noise=30e-6))
    for values in (points.x_s, points.z_s):
        np.testing.assert_allclose(values / 5e-6, np.round(values / 5e-6), atol=1e-6)
    exact = taken(hits(), LaserModel.without_faults(noise=30e-6))
    assert np.abs(points.z_s - exact.z_s).max() <= 2.5e-6 + EXACT


def test_no_fault_carries_a_point_outside_the_range() -> None:
    model = LaserModel.without_faults(noise=1e-3)
    for edge in (model.near, model.far):
        points = taken(hits(z=edge), model)
        there = points.kind != PointOrigin.MISSING
        assert 0 < there.sum() < N
        assert np.all((points.z_s[there] >= model.near) & (points.z_s[there] <= model.far))


def test_a_missing_point_is_nan_and_dark_and_no_other_is() -> None:
    points = taken(groove(), ALL_ON)
    missing = points.kind == PointOrigin.MISSING
    assert set(np.unique(points.kind)) == set(PointOrigin)
    np.testing.assert_array_equal(np.isnan(points.x_s), missing)
    np.testing.assert_array_equal(np.isnan(points.z_s), missing)
    np.testing.assert_array_equal(points.intensity == 0, missing)
    assert np.nanmax(points.intensity) <= 1


def test_intensity_falls_with_incidence() -> None:
    bright = [
        taken(hits(a), LaserModel.without_faults()).intensity[0] for a in (0.0, 0.5, 1.0, 1.5)
    ]
    np.testing.assert_allclose(bright, np.cos([0.0, 0.5, 1.0, 1.5]), atol=EXACT)


@pytest.mark.parametrize(
    "off",
    [
        {"noise": 0.0},
        {"bias": 0.0},
        {"dropout": 0.0},
        {"missing": 0.0},
        {"ghosts": 0.0},
        {"flyers": 0.0},
    ],
    ids=lambda off: next(iter(off)),
)
def test_switching_one_fault_off_leaves_the_others_alone(off: dict[str, Any]) -> None:
    model = replace(ALL_ON, step=0.0)
    with_it, without = taken(groove(), model, 5), taken(groove(), replace(model, **off), 5)
    same = with_it.kind == without.kind
    what = {
        "dropout": (PointOrigin.MISSING, PointOrigin.TRUE),
        "missing": (PointOrigin.MISSING, PointOrigin.TRUE),
        "ghosts": (PointOrigin.GHOST,),
        "flyers": (PointOrigin.FLYER,),
    }.get(next(iter(off)), ())
    assert np.isin(with_it.kind[~same], what).all()
    if "noise" not in off and "bias" not in off:
        np.testing.assert_array_equal(with_it.z_s[same], without.z_s[same])
    else:
        assert same.all()
        limit = 6 * model.noise + model.bias_limit
        there = with_it.kind != PointOrigin.MISSING
        assert np.abs(with_it.z_s - without.z_s)[there].max() < limit


def test_every_fault_has_its_own_stream() -> None:
    streams = FaultRandomStreams.spawn(np.random.default_rng(0))
    first = {getattr(streams, f.name).random() for f in fields(streams)}
    assert len(first) == len(fields(streams))


def test_strays_lie_before_and_behind_the_surface_in_whole_runs() -> None:
    model = LaserModel.without_faults(strays=0.2)
    offsets, lengths = [], []
    for seed in range(40):
        points = taken(hits(), model, seed)
        off = along(points) - hits().distance
        strays = points.kind == PointOrigin.STRAY
        assert np.count_nonzero(strays) == pytest.approx(0.2 * N, abs=1)
        np.testing.assert_allclose(off[~strays], 0, atol=EXACT)
        least, most = model.stray_offset
        assert np.all((np.abs(off[strays]) > least - EXACT) & (np.abs(off[strays]) < most + EXACT))
        offsets.append(off[strays])
        lengths.append(runs_of(strays).mean())
    before = np.concatenate(offsets) < 0
    assert 0.3 < before.mean() < 0.7
    assert np.mean(lengths) > model.stray_run[0]


def valley(angle: float = np.radians(60)) -> LaserRayHits:
    """Two faces that meet in the middle at `angle`; turned inside out where it is above 180°."""
    x = np.linspace(-0.04, 0.04, N)
    rise = 1 / np.tan(angle / 2)
    z = 0.26 - np.abs(x) * rise
    apex = np.array((0.0, 0.0, LaserModel().emitter_z))
    rays = np.column_stack((x, np.zeros(N), z)) - apex
    distance = np.linalg.norm(rays, axis=1)
    normals = np.column_stack((-np.sign(x) * rise, np.zeros(N), -np.ones(N)))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    seen = np.ones(N, bool)
    return LaserRayHits(rays / distance[:, None], distance, normals, seen, np.full(N, np.nan))


def test_interreflection_pulls_a_notch_in_and_fades_out() -> None:
    model = LaserModel.without_faults(interreflection=1e-3, interreflection_reach=4e-3)
    view = valley()
    points = taken(view, model)
    pulled = view.distance - along(points)
    true = view.distance[:, None] * view.directions_s
    away = np.linalg.norm(true - (0.0, 0.0, 0.26 - LaserModel().emitter_z), axis=1)
    assert pulled.max() == pytest.approx(1e-3, rel=0.01)
    np.testing.assert_allclose(pulled[away > 4.1e-3], 0, atol=EXACT)
    expected = 0.5e-3 * (1 + np.cos(np.pi * np.clip(away / 4e-3, 0, 1)))
    np.testing.assert_allclose(pulled, expected, atol=0.05e-3)


def test_a_ridge_has_no_interreflection() -> None:
    view = valley(np.radians(220))
    points = taken(view, LaserModel.without_faults(interreflection=1e-3))
    np.testing.assert_allclose(along(points), view.distance, atol=EXACT)
