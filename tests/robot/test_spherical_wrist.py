"""All configurations of arms with a spherical wrist, by the axes that their URDFs have."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import arm_models
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, pose
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

MODELS = tuple(arm_models.WRIST_ARMS)
ROUND_TRIP = 1e-9
"""Metres and radians."""

REGULAR = 0.01
"""Smallest singular value above which joint angles answer to poses."""

DRAWN = 3000

WELL = {
    "kr5_arc": np.radians([10, -80, 80, 0, 60, 20]),
    "irb1600_10_145": np.radians([10, 10, 10, 0, 60, 20]),
    "m10ia": np.radians([10, 10, 0, 0, -60, 20]),
}
"""The elbow up and the flange looking ahead and down, far from singular."""


@cache
def arm(model: str) -> Kinematics:
    return Kinematics.load(model)


@cache
def drawn(model: str) -> tuple[Array, Array]:
    """Joint angles anywhere within limits, and their flange poses."""
    q = np.random.default_rng(0).uniform(arm(model).lower, arm(model).upper, (DRAWN, 6))
    return q, poses(arm(model), q)


def poses(kinematics: Kinematics, q: Array) -> Array:
    return np.array([kinematics.forward(one) for one in q])


def apart(q: Array, other: Array) -> Array:
    """Largest difference of joint angles, whatever their turns."""
    return np.asarray(np.abs(np.angle(np.exp(1j * (q - other)))).max(axis=-1))


def check_round_trip(kinematics: Kinematics, T_b_f: Array) -> Array:
    """Which branches hold the poses, having checked that those that are given do."""
    found = kinematics.inverse_branches(T_b_f)
    assert found.shape == (len(T_b_f), 8, 6)
    held = np.isfinite(found)
    assert (held.all(axis=2) == held.any(axis=2)).all()
    whole = held.all(axis=2)
    wanted = np.broadcast_to(T_b_f[:, None], (*whole.shape, 4, 4))[whole]
    np.testing.assert_allclose(poses(kinematics, found[whole]), wanted, rtol=0, atol=ROUND_TRIP)
    return np.asarray(whole)


@pytest.mark.parametrize("model", MODELS)
def test_every_branch_holds_the_pose_and_one_is_where_it_came_from(model: str) -> None:
    q, T_b_f = drawn(model)
    held = check_round_trip(arm(model), T_b_f)
    assert set(held.sum(axis=1).tolist()) <= {4, 8}  # a branch goes with its flipped wrist
    regular = np.array([arm(model).smallest_singular_value(one) > REGULAR for one in q])
    assert regular.mean() > 0.8
    away = apart(arm(model).inverse_branches(T_b_f), q[:, None])
    assert np.nanmin(away[regular], axis=1).max() < 1e-9


@pytest.mark.parametrize("model", MODELS)
def test_branches_differ_from_each_other(model: str) -> None:
    _, T_b_f = drawn(model)
    found = arm(model).inverse_branches(T_b_f[:500])
    between = apart(found[:, :, None], found[:, None])
    between[:, np.arange(8), np.arange(8)] = np.nan
    looked_at = 0
    for branches, gaps in zip(found, between, strict=True):
        held = branches[np.isfinite(branches).all(axis=1)]
        if min(arm(model).smallest_singular_value(one) for one in held) > REGULAR:
            assert np.nanmin(gaps) > 1e-3
            looked_at += 1
    assert looked_at > 250


@pytest.mark.parametrize("model", MODELS)
def test_a_branch_keeps_its_place_along_a_path(model: str) -> None:
    kinematics = arm(model)
    whole = np.array((0.9, 0.3, -0.3, 0.5, 0.3, -1.2))
    path = WELL[model] + np.linspace(0, 1, 60)[:, None] * whole
    away = apart(kinematics.inverse_branches(poses(kinematics, path)), path[:, None])
    same = away < 1e-7
    assert (same.sum(axis=1) == 1).all()
    assert len(set(same.argmax(axis=1).tolist())) == 1


@pytest.mark.parametrize("model", MODELS)
def test_what_is_out_of_reach_has_no_branch(model: str) -> None:
    kinematics = arm(model)
    far = pose(p=(9.0, 0.0, 0.5))
    within = kinematics.forward(np.zeros(6))
    found = kinematics.inverse_branches(np.array([far, within]))
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1]).any()


@pytest.mark.parametrize("model", MODELS)
def test_a_straight_wrist_is_solved_and_keeps_joint_4(model: str) -> None:
    kinematics = arm(model)
    q = WELL[model] + np.random.default_rng(1).uniform(-0.3, 0.3, (200, 6))
    q[:, 4] = 0.0  # axes 4 and 6 are one: their sum alone is given
    T_b_f = poses(kinematics, q)
    assert check_round_trip(kinematics, T_b_f).any(axis=1).all()
    for one, T in zip(q[:20], T_b_f, strict=False):
        far = one + 1.5 * np.eye(6)[0]
        solution = kinematics.inverse(T, near=far)
        np.testing.assert_allclose(kinematics.forward(solution), T, rtol=0, atol=1e-6)
        assert solution[3] == pytest.approx(one[3], abs=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_a_nearly_straight_wrist_and_a_stretched_elbow_are_solved(model: str) -> None:
    kinematics = arm(model)
    q = WELL[model] + np.random.default_rng(2).uniform(-0.3, 0.3, (300, 6))
    q[:100, 4] = np.logspace(-14, -3, 100)
    (before, fore) = (kinematics.joint_placements[i][:3, 3] for i in (2, 3))
    fore = fore + kinematics.joint_placements[4][:3, 3]
    straight = np.arctan2(before[0], before[2]) - np.arctan2(fore[0], fore[2])
    q[100:200, 2] = kinematics.joint_axes[2, 1] * straight + np.linspace(-1e-7, 1e-7, 100)
    assert check_round_trip(kinematics, poses(kinematics, q)).any(axis=1).all()


def test_a_wrist_on_axis_1_is_solved() -> None:
    kinematics = arm("irb1600_10_145")  # its links lie in a plane with axis 1
    q = np.array((0.3, -0.4, 0.0, 0.2, 0.5, 0.1))
    away, upper, fore = 0.15, 0.7, 0.6  # joint 2 from axis 1, its link, the wrist from joint 3
    q[2] = -np.arccos((-away - upper * np.sin(q[1])) / fore) - q[1]
    assert abs(kinematics.link_poses(q)[kinematics.link_names.index("link_5"), 0, 3]) < 1e-12
    T_b_f = kinematics.forward(q)
    assert check_round_trip(kinematics, T_b_f[None]).any()
    np.testing.assert_allclose(kinematics.inverse(T_b_f, near=q), q, rtol=0, atol=1e-6)


def chain(
    placements: list[tuple[Array, Array]], axes: list[Array], folder: Path, limit: float = 3.0
) -> Kinematics:
    """An arm of a user's own, its joints' frames turned any way."""
    parts = [f'<link name="l{i}"/>' for i in range(7)] + ['<link name="tool0"/>']
    for i, ((xyz, rpy), axis) in enumerate(zip(placements, axes, strict=True)):
        words = [" ".join(repr(float(x)) for x in one) for one in (xyz, rpy, axis)]
        parts.append(
            f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{words[0]}" rpy="{words[1]}"/><axis xyz="{words[2]}"/>'
            f'<limit lower="-{limit}" upper="{limit}" velocity="1" effort="0"/></joint>'
        )
    parts.append(
        '<joint name="end" type="fixed"><parent link="l6"/><child link="tool0"/>'
        '<origin xyz="0.01 0.02 0.1" rpy="0.1 0.2 0.3"/></joint>'
    )
    file = folder / "mine.urdf"
    file.write_text(f'<robot name="mine">{"".join(parts)}</robot>', encoding="utf-8")
    return Kinematics.load(file)


numbers = st.floats(-1, 1)


@given(
    lengths=st.lists(numbers, min_size=6, max_size=6).map(np.array),
    signs=st.lists(st.sampled_from((-1.0, 1.0)), min_size=6, max_size=6).map(np.array),
    bends=st.lists(numbers, min_size=3, max_size=3).map(np.array),
    seed=st.integers(0, 10_000),
)
@settings(max_examples=50, deadline=None)
def test_any_lengths_signs_and_zeros_are_found_from_the_axes(
    lengths: Array,
    signs: Array,
    bends: Array,
    seed: int,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    b, height, a1, upper, fore, aside = lengths * 0.3
    placements = [
        (np.array((0.1, -0.2, height)), np.array((0.2, 0.1, 0.3))),
        (np.array((a1, b, 0.1)), np.array((0.0, 0.0, 0.4))),
        (np.array((upper, 0.05, 0.5)), np.array((0.0, bends[0], 0.0))),
        (np.array((fore, aside, 0.4)), np.array((0.0, bends[1], 0.0))),
        (np.array((0.2, 0.0, 0.0)), np.array((0.7, 0.0, 0.0))),
        (np.zeros(3), np.array((0.0, bends[2], 0.0))),
    ]
    axes = signs[:, None] * np.eye(3)[[2, 1, 1, 0, 1, 0]]
    kinematics = chain(placements, list(axes), tmp_path_factory.mktemp("arm"))
    q = np.random.default_rng(seed).uniform(-3, 3, (5, 6))
    T_b_f = poses(kinematics, q)
    assert check_round_trip(kinematics, T_b_f).any(axis=1).all()


def test_a_deviating_arm_is_solved_as_the_model_is() -> None:
    sigmas = PlacementTolerance().sigmas
    deviations = sigmas * np.random.default_rng(4).standard_normal((6, 6))
    kinematics = deviate_joint_frames(arm("kr5_arc"), deviations)
    q = WELL["kr5_arc"]
    T_b_f = kinematics.forward(q)
    np.testing.assert_allclose(kinematics.inverse(T_b_f, near=q), q, rtol=0, atol=1e-9)
    nearest = np.nanmin(apart(kinematics.inverse_branches(T_b_f[None])[0], q))
    assert 1e-6 < nearest < 5e-3
    # One way round, the arm holds a pose that it can't without its limits.
    found = kinematics.all_inverse_solutions(T_b_f, q)
    assert len(found) > 1
    for one in found:
        np.testing.assert_allclose(kinematics.forward(one), T_b_f, rtol=0, atol=2e-7)


@pytest.mark.parametrize(
    ("joint", "change"),
    [
        (1, ((0.0, 0.0, 0.1), (0.0, 0.0, 0.0), (0.3, 1.0, 0.0))),  # axis 3 is slanted
        (4, ((0.2, 0.0, 0.05), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))),  # axis 5 passes axis 4
        (4, ((0.2, 0.0, 0.0), (0.0, 0.0, 0.0), (0.3, 1.0, 0.0))),  # axis 5 is slanted
    ],
)
def test_an_arm_of_neither_kind_is_told_so(
    joint: int, change: tuple[tuple[float, ...], ...], tmp_path: Path
) -> None:
    zero = np.zeros(3)
    steps = np.array([(0, 0, 0.3), (0.1, 0, 0), (0, 0, 0.5), (0.3, 0, 0.1), (0.2, 0, 0), (0, 0, 0)])
    placements = [(step, zero) for step in steps]
    axes = list(np.eye(3)[[2, 1, 1, 0, 1, 0]])
    assert np.isfinite(chain(placements, axes, tmp_path).inverse_branches(np.eye(4)[None])).any()
    xyz, rpy, axis = (np.array(one) for one in change)
    placements[joint], axes[joint] = (xyz, rpy), axis / np.linalg.norm(axis)
    other = chain(placements, axes, tmp_path)
    with pytest.raises(ConfigurationError, match="4, 5 and 6 through one point"):
        other.inverse_branches(np.eye(4)[None])
    # It is solved from many seeds as before.
    q = np.array((0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    T_b_f = other.forward(q)
    np.testing.assert_allclose(
        other.forward(other.inverse(T_b_f, q + 0.8)), T_b_f, rtol=0, atol=2e-7
    )
