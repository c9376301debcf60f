"""Kinematics against an independent product of DH transforms, and against itself."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from tjscan.core.errors import ConfigurationError, PoseUnreachable
from tjscan.core.frames import Array, pose, rot_x, rot_y
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.urdf import ARM_MODELS

# d1, a2, a3, d4, d5, d6 as the maker publishes them, apart from the project's own table.
DH = {
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur16e": (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
    "ur20": (0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
    "ur30": (0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543),
}
ROUNDING = 1e-12
"""Six products of transforms of about one metre, in float64."""

SOLVED = 5e-9
"""Metres and radians: a few times what the solver promises, element by element."""

REGULAR = 0.02
"""Smallest singular value above which joint angles answer to poses without blowing up."""

SINGULAR = 2e-7
"""Metres and radians: the same where an arm may be singular."""

ANGLES = SOLVED / REGULAR
"""Radians: what the solver's tolerance leaves open in the joint angles."""

WELL = np.radians([10, -80, 100, -60, -80, 20])
"""An elbow-up configuration of any of the arms, far from singular."""

UR_MODELS = tuple(DH)
WRIST_ARMS = tuple(model for model in ARM_MODELS if model not in DH)

angles = st.lists(st.floats(-1, 1), min_size=6, max_size=6).map(np.array)
models = st.sampled_from(UR_MODELS)


@cache
def arm(model: str) -> Kinematics:
    return Kinematics.load(model)


def dh_product(model: str, q: Array) -> Array:
    d1, a2, a3, d4, d5, d6 = DH[model]
    T = np.eye(4)
    rows = zip(
        q,
        (d1, 0, 0, d4, d5, d6),
        (0, a2, a3, 0, 0, 0),
        np.radians([90, 0, 0, 90, -90, 0]),
        strict=True,
    )
    for theta, d, a, alpha in rows:
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        T = T @ [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    return T


def turned(q: Array) -> Array:
    """Angles brought into -pi to pi."""
    return np.asarray((q + np.pi) % (2 * np.pi) - np.pi)


@given(model=models, share=angles)
def test_forward_is_the_product_of_the_dh_transforms(model: str, share: Array) -> None:
    q = share * arm(model).upper
    np.testing.assert_allclose(arm(model).forward(q), dh_product(model, q), rtol=0, atol=ROUNDING)


STRETCHED = np.array([0, 0.5, 0, 0.75, 0, 0])


@given(model=models, share=angles, other=angles)
@example(model="ur5e", share=STRETCHED, other=np.array([0, 0, 0, 0, 0.5, 0.5]))
@settings(max_examples=200, deadline=None)
def test_any_pose_the_arm_can_hold_is_found_from_anywhere(
    model: str, share: Array, other: Array
) -> None:
    kinematics = arm(model)
    T_b_f = kinematics.forward(share * kinematics.upper)
    q = kinematics.inverse(T_b_f, near=other * kinematics.upper)
    np.testing.assert_allclose(kinematics.forward(q), T_b_f, rtol=0, atol=SINGULAR)
    assert (q <= kinematics.upper).all()
    assert (q >= kinematics.lower).all()


@given(model=models, share=angles, other=angles)
def test_no_other_turn_of_a_joint_would_be_nearer(model: str, share: Array, other: Array) -> None:
    kinematics = arm(model)
    near = other * kinematics.upper
    q = kinematics.inverse(kinematics.forward(share * kinematics.upper), near)
    for turn in (-2 * np.pi, 2 * np.pi):
        within = (q + turn <= kinematics.upper) & (q + turn >= kinematics.lower)
        nearer = np.abs(q + turn - near) < np.abs(q - near) - SOLVED
        assert not (within & nearer).any()


@given(model=models, share=angles)
@settings(max_examples=50, deadline=None)
def test_all_configurations_hold_the_pose_and_the_nearest_comes_first(
    model: str, share: Array
) -> None:
    kinematics = arm(model)
    q = WELL + 0.5 * share
    assume(kinematics.smallest_singular_value(q) > REGULAR)
    T_b_f = kinematics.forward(q)
    found = kinematics.all_inverse_solutions(T_b_f, near=q)
    assert np.abs(found[0] - q).max() < ANGLES
    assert 4 <= len(found) <= 8  # shoulder, elbow and wrist, two ways each
    away = [float(np.linalg.norm(one - q)) for one in found]
    assert away == sorted(away)
    for one in found:
        np.testing.assert_allclose(kinematics.forward(one), T_b_f, rtol=0, atol=SINGULAR)
        assert (one >= kinematics.lower).all()
        assert (one <= kinematics.upper).all()


@given(model=models, share=angles, offset=angles)
@settings(max_examples=150, deadline=None)
def test_the_inverse_near_the_angles_returns_them(model: str, share: Array, offset: Array) -> None:
    kinematics = arm(model)
    q = 0.95 * share * kinematics.upper
    smallest = kinematics.smallest_singular_value(q)
    assume(smallest > REGULAR)
    # Nearer to q than to where this branch of the solution meets another, which is about as
    # far off in radians as the singular value is from zero.
    near = q + 0.2 * smallest * offset
    solution = kinematics.inverse(kinematics.forward(q), near)
    np.testing.assert_allclose(solution, q, rtol=0, atol=ANGLES)


@pytest.mark.parametrize("model", UR_MODELS)
def test_branches_of_many_poses_are_the_inverse_and_keep_their_places_along_a_path(
    model: str,
) -> None:
    kinematics = arm(model)
    path = WELL + np.linspace(0, 1, 50)[:, None] * np.array((0.9, 0.3, -0.4, 0.5, 0.6, -1.2))
    poses = np.array([kinematics.forward(q) for q in path])
    found = kinematics.inverse_branches(poses)
    assert found.shape == (50, 8, 6)
    held = np.isfinite(found).all(axis=2)
    for i, j in np.argwhere(held):
        np.testing.assert_allclose(kinematics.forward(found[i, j]), poses[i], atol=SOLVED)
    away = np.abs(np.angle(np.exp(1j * (found - path[:, None])))).max(axis=2)
    same = away < ANGLES
    assert (same.sum(axis=1) == 1).all()
    assert len(set(same.argmax(axis=1).tolist())) == 1


@pytest.mark.parametrize("model", UR_MODELS)
def test_a_general_arm_is_solved_without_the_closed_form(model: str, tmp_path: Path) -> None:
    # The same arm with its joints' axes turned round is none that the closed form knows.
    file = tmp_path / "arm.urdf"
    text = arm(model).urdf.read_text("utf-8")
    file.write_text(text.replace('xyz="0 0 1"', 'xyz="0 0 -1"'), encoding="utf-8")
    general = Kinematics.load(file)
    random = np.random.default_rng(3)
    for _ in range(10):
        q, near = random.uniform(-2.5, 2.5, (2, 6))
        T_b_f = arm(model).forward(q)
        np.testing.assert_allclose(general.forward(-q), T_b_f, rtol=0, atol=ROUNDING)
        solution = general.inverse(T_b_f, near)
        np.testing.assert_allclose(general.forward(solution), T_b_f, rtol=0, atol=SINGULAR)
        nearest = arm(model).inverse(T_b_f, -near)
        assert (
            np.linalg.norm(solution - near) >= np.linalg.norm(nearest + near) - SINGULAR / REGULAR
        )


def test_the_configuration_is_kept_along_a_long_path() -> None:
    kinematics = arm("ur10e")
    q, T_b_f = WELL, kinematics.forward(WELL)
    for angle in np.radians(np.arange(0, 360, 2)):
        shift = 0.15 * np.array([np.cos(angle) - 1, np.sin(angle), 0.3 * np.sin(2 * angle)])
        R = T_b_f[:3, :3] @ rot_x(0.3 * np.sin(angle)) @ rot_y(0.3 * (1 - np.cos(angle)))
        following = kinematics.inverse(pose(R, T_b_f[:3, 3] + shift), near=q)
        # 2 degrees of this loop are 5 mm and 0.6 degrees; no joint has to turn further.
        assert np.abs(following - q).max() < np.radians(3)
        q = following
    np.testing.assert_allclose(kinematics.inverse(T_b_f, near=q), WELL, rtol=0, atol=1e-6)


def test_a_singular_wrist_keeps_the_last_joint() -> None:
    kinematics = arm("ur5e")
    q = WELL.copy()
    q[4] = 0.0  # axes of wrist 1 and wrist 3 are parallel: only their sum is given
    far = q + 1.5 * np.eye(6)[0]
    solution = kinematics.inverse(kinematics.forward(q), near=far)
    np.testing.assert_allclose(
        kinematics.forward(solution), kinematics.forward(q), rtol=0, atol=SOLVED
    )
    assert solution[5] == pytest.approx(q[5], abs=1e-6)
    assert kinematics.smallest_singular_value(q) < 1e-12


@given(model=models, share=angles)
@settings(max_examples=50, deadline=None)
def test_the_jacobian_is_the_derivative_of_forward(model: str, share: Array) -> None:
    kinematics, q, h = arm(model), share * np.pi, 1e-6
    J = kinematics.jacobian(q)
    for i, step in enumerate(h * np.eye(6)):
        ahead, behind = kinematics.forward(q + step), kinematics.forward(q - step)
        spin = (ahead[:3, :3] - behind[:3, :3]) / (2 * h) @ kinematics.forward(q)[:3, :3].T
        speed = (ahead[:3, 3] - behind[:3, 3]) / (2 * h)
        np.testing.assert_allclose(J[:3, i], speed, atol=1e-8)
        np.testing.assert_allclose(J[3:, i], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


def test_links_are_drawn_from_the_base_to_the_flange() -> None:
    kinematics = arm("ur10e")
    links = kinematics.link_poses(WELL)
    assert links.shape == (len(kinematics.link_names), 4, 4)
    np.testing.assert_array_equal(links[0], np.eye(4))
    np.testing.assert_array_equal(links[-1], kinematics.forward(WELL))
    elbow = links[kinematics.link_names.index("forearm_link")][:3, 3]
    shoulder = links[kinematics.link_names.index("upper_arm_link")][:3, 3]
    assert np.linalg.norm(elbow - shoulder) == pytest.approx(0.6127, abs=ROUNDING)


@pytest.mark.parametrize("model", UR_MODELS)
def test_a_pose_beyond_the_reach_is_refused_with_what_is_missing(model: str) -> None:
    kinematics = arm(model)
    T_b_f = kinematics.forward(np.radians([0, -45, 0, -45, -90, 0]))
    T_b_f[:3, 3] *= 3
    with pytest.raises(PoseUnreachable, match=r"out of reach; the nearest found is \d+\.\d mm"):
        kinematics.inverse(T_b_f, near=WELL)


def test_a_joint_beyond_its_limit_is_named_with_its_excess(tmp_path: Path) -> None:
    whole = 'lower="-6.283185307179586" upper="6.283185307179586"'
    file = tmp_path / "fenced.urdf"
    text = arm("ur10e").urdf.read_text("utf-8")
    file.write_text(text.replace(whole, 'lower="-0.5" upper="0.5"', 1), encoding="utf-8")
    fenced = Kinematics.load(file)
    q = WELL.copy()
    q[0] = 0.5 + np.radians(4)
    with pytest.raises(PoseUnreachable, match=r"shoulder_pan_joint .* 4\.0 deg beyond its limit"):
        fenced.inverse(fenced.forward(q), near=WELL)


def test_what_is_no_pose_is_refused() -> None:
    stretched = pose(2 * np.eye(3), [0.5, 0.2, 0.3])
    nowhere = pose(None, [np.nan, 0.2, 0.3])
    for T_b_f in (stretched, nowhere):
        with pytest.raises(PoseUnreachable, match="no pose"):
            arm("ur5e").inverse(T_b_f, near=WELL)


def test_an_unknown_model_names_the_nearest() -> None:
    with pytest.raises(ConfigurationError, match="did you mean: ur10e"):
        Kinematics.load("ur10")


# A user's own arm, in the manner of a general URDF: offset base frame, tool0, slanted axes.
USERS_ARM = """<robot name="mine">
  <link name="world"/> <link name="base"/> <link name="l0"/> <link name="l1"/> <link name="l2"/>
  <link name="l3"/> <link name="l4"/> <link name="l5"/> <link name="l6"/> <link name="tool0"/>
  <joint name="mount" type="fixed"><parent link="world"/><child link="l0"/>
    <origin xyz="0.1 0.2 0.3"/></joint>
  <joint name="shown" type="fixed"><parent link="l0"/><child link="base"/>
    <origin rpy="0 0 3.141592653589793"/></joint>
  {joints}
  <joint name="end" type="fixed"><parent link="l6"/><child link="tool0"/>
    <origin xyz="0 0 0.1"/></joint>
</robot>"""
JOINT = """<joint name="j{i}" type="{kind}"><parent link="l{before}"/><child link="l{i}"/>
    <origin xyz="{xyz}"/><axis xyz="{axis}"/>
    <limit lower="-3" upper="3" velocity="{velocity}" effort="0"/></joint>"""
FIXED = '<joint name="j{i}" type="fixed"><parent link="l{before}"/><child link="l{i}"/></joint>'


def users_arm(folder: Path, joints: int = 6, kind: str = "revolute", velocity: float = 3) -> Path:
    shapes = [
        ("0 0 0.2", "0 0 1"),
        ("0.05 0 0.2", "0 1 0"),
        ("0 0 0.5", "0 1 0.1"),
        ("0.4 0 0.03", "1 0 0"),
        ("0.1 0 0", "0 1 0"),
        ("0.1 0 0", "1 0 0"),
    ]
    text = "\n".join(
        JOINT.format(i=i, before=i - 1, xyz=xyz, axis=axis, velocity=velocity, kind=kind)
        if i <= joints
        else FIXED.format(i=i, before=i - 1)
        for i, (xyz, axis) in enumerate(shapes, start=1)
    )
    file = folder / "mine.urdf"
    file.write_text(USERS_ARM.format(joints=text), encoding="utf-8")
    return file


def test_a_users_urdf_is_solved_in_its_controllers_frame(tmp_path: Path) -> None:
    mine = Kinematics.load(users_arm(tmp_path))
    # At zero it stands 0.93 m up and 0.65 m ahead; its base frame is turned by half a turn.
    np.testing.assert_allclose(mine.forward(np.zeros(6))[:3, 3], [-0.65, 0, 1.03], atol=ROUNDING)
    random = np.random.default_rng(5)
    for _ in range(20):
        q, near = random.uniform(-2, 2, (2, 6))
        T_b_f = mine.forward(q)
        np.testing.assert_allclose(
            mine.forward(mine.inverse(T_b_f, near)), T_b_f, rtol=0, atol=SINGULAR
        )


# The layout of the maker's own ROS 2 description: joints slid along their axes, the root turned
# by half a turn against the controller's base, and a `flange` that `tool0` puts right.
MAKERS_LAYOUT = (
    ("0 0 0.1807", "0 0 0"),
    ("0 0 0", "1.5707963267948966 0 0"),
    ("-0.6127 0 0", "0 0 0"),
    ("-0.57155 0 0.17415", "0 0 0"),
    ("0 -0.11985 0", "1.5707963267948966 0 0"),
    ("0 0.11655 0", "1.5707963267948966 3.141592653589793 3.141592653589793"),
)
MAKERS_ARM = """<robot name="ur10e">
  <link name="base_link"/> <link name="base"/> <link name="l0"/> <link name="l1"/> <link name="l2"/>
  <link name="l3"/> <link name="l4"/> <link name="l5"/> <link name="l6"/> <link name="flange"/>
  <link name="tool0"/>
  <joint name="turned" type="fixed"><parent link="base_link"/><child link="l0"/>
    <origin rpy="0 0 3.141592653589793"/></joint>
  <joint name="shown" type="fixed"><parent link="base_link"/><child link="base"/>
    <origin rpy="0 0 3.141592653589793"/></joint>
  {joints}
  <joint name="end" type="fixed"><parent link="l6"/><child link="flange"/>
    <origin rpy="0 -1.5707963267948966 -1.5707963267948966"/></joint>
  <joint name="tool" type="fixed"><parent link="flange"/><child link="tool0"/>
    <origin rpy="1.5707963267948966 0 1.5707963267948966"/></joint>
</robot>"""
MAKERS_JOINT = """<joint name="j{i}" type="revolute"><parent link="l{before}"/><child link="l{i}"/>
    <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>
    <limit lower="-{turn}" upper="{turn}" velocity="2" effort="0"/></joint>"""


def test_the_makers_own_description_gives_the_same_poses(tmp_path: Path) -> None:
    joints = "\n".join(
        MAKERS_JOINT.format(
            i=i, before=i - 1, xyz=xyz, rpy=rpy, turn=np.pi if i == 3 else 2 * np.pi
        )
        for i, (xyz, rpy) in enumerate(MAKERS_LAYOUT, start=1)
    )
    file = tmp_path / "makers.urdf"
    file.write_text(MAKERS_ARM.format(joints=joints), encoding="utf-8")
    makers = Kinematics.load(file)
    random = np.random.default_rng(7)
    for q, near in random.uniform(-3, 3, (20, 2, 6)):
        T_b_f = dh_product("ur10e", q)
        np.testing.assert_allclose(makers.forward(q), T_b_f, rtol=0, atol=ROUNDING)
        ours, theirs = arm("ur10e").inverse(T_b_f, near), makers.inverse(T_b_f, near)
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=SINGULAR / REGULAR)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"joints": 5}, "5 joints"),
        ({"kind": "continuous"}, "revolute joints with limits"),
        ({"kind": "prismatic"}, "revolute joints with limits"),
        ({"velocity": 0}, "j1 has no range or no speed"),
    ],
)
def test_a_urdf_of_another_kind_is_refused(
    tmp_path: Path, change: dict[str, object], complaint: str
) -> None:
    with pytest.raises(ConfigurationError, match=complaint):
        Kinematics.load(users_arm(tmp_path, **change))  # type: ignore[arg-type]


@pytest.mark.parametrize("left", ["", '<limit lower="-3" upper="3" effort="0"/>'])
def test_a_joint_without_limits_is_refused_by_its_name(tmp_path: Path, left: str) -> None:
    file = users_arm(tmp_path)
    limit = '<limit lower="-3" upper="3" velocity="3" effort="0"/>'
    before, after = file.read_text(encoding="utf-8").rsplit(limit, 1)
    file.write_text(before + left + after, encoding="utf-8")
    with pytest.raises(ConfigurationError, match="joint j6 has no lower, upper, velocity"):
        Kinematics.load(file)


def test_a_urdf_without_flange_or_with_a_gripper_is_refused(tmp_path: Path) -> None:
    file = users_arm(tmp_path)
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("tool0", "hand"), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="'tool0' or 'flange'"):
        Kinematics.load(file)
    finger = JOINT.format(i=7, before=3, xyz="0 0 0", axis="1 0 0", velocity=1, kind="revolute")
    file.write_text(text.replace("</robot>", f'<link name="l7"/>{finger}</robot>'), "utf-8")
    with pytest.raises(ConfigurationError, match="j7 does not move the flange"):
        Kinematics.load(file)


def test_what_is_no_urdf_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no such URDF"):
        Kinematics.load(tmp_path / "none.urdf")
    broken = tmp_path / "broken.urdf"
    broken.write_text("<robot", encoding="utf-8")
    with pytest.raises(ConfigurationError, match="is not a URDF"):
        Kinematics.load(broken)
