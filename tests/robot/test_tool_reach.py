"""Where an arm can hold a tool that may spin about its axis, and how it is led along a line."""

import numpy as np
import pytest
from ur_cell import HOME, KINEMATICS

from tjscan.core.frames import Array, inverse_pose, pose, rot_x, rot_z
from tjscan.robot.tool_reach import (
    OUT_OF_REACH_TEXT,
    TOOL_SPINS,
    Hindrance,
    ToolConfigurations,
)

TOOL = pose(rot_x(0.4), (0.0, 0.05, 0.2))
SINGULAR = 0.02
START = KINEMATICS.forward(HOME) @ TOOL


def nothing(q: Array) -> str:
    return ""


def line(length: float, places: int = 9) -> Array:
    """Poses along y of frame b, shape (places, 1, 4, 4)."""
    steps = np.linspace(0, length, places)
    return np.array([[pose(p=(0.0, y, 0.0)) @ START] for y in steps])


def holds(
    poses: Array,
    hindrance: Hindrance = nothing,
    *,
    closed: bool = False,
    singular: float = SINGULAR,
) -> ToolConfigurations:
    return ToolConfigurations(KINEMATICS, TOOL, poses, hindrance, singular=singular, closed=closed)


def test_a_line_in_reach_is_one_stretch_whose_joints_hold_every_place() -> None:
    poses = line(0.15)
    found = holds(poses)
    assert found.stretches() == ((0, 8),)
    spins, q = found.path(0, 8)
    for T, spin, angles in zip(poses[:, 0], spins, q, strict=True):
        held = KINEMATICS.forward(angles) @ TOOL
        np.testing.assert_allclose(held, T @ pose(rot_z(spin)), atol=1e-9)
    assert np.abs(np.diff(q, axis=0)).max() < np.radians(30)


def test_spin_alone_makes_no_difference_to_what_is_reached() -> None:
    """The tool may be turned as one likes: so may the poses that are asked for."""
    turned = line(0.15) @ pose(rot_z(2 * np.pi * 5 / TOOL_SPINS))
    can = holds(line(0.15)).can
    np.testing.assert_array_equal(holds(turned).can, np.roll(can, -5, axis=1))


def test_what_is_out_of_reach_or_hindered_parts_the_line_and_is_named() -> None:
    poses = line(0.15)
    poses[4, 0, :3, 3] += (0.0, 0.0, 9.0)
    found = holds(poses)
    assert found.stretches() == ((0, 3), (5, 8))
    assert found.hindrances[4] == OUT_OF_REACH_TEXT
    y = START[1, 3] + 0.07

    def wall(q: Array) -> str:
        return "a wall" if (KINEMATICS.forward(q) @ TOOL)[1, 3] > y else ""

    found = holds(line(0.15), wall)
    assert found.stretches() == ((0, 3),)
    assert set(found.hindrances[4:]) == {"a wall"}
    assert set(found.hindrances[:4]) == {""}


def test_poses_of_one_place_are_held_together() -> None:
    near, far = line(0.1, 4), line(0.1, 4) @ pose(p=(0.0, 0.0, -0.05))
    both, *apart = (
        holds(poses, singular=0.0).can for poses in (np.concatenate((near, far), axis=1), near, far)
    )
    np.testing.assert_array_equal(both, apart[0] & apart[1])


@pytest.mark.parametrize("first", [0, 3])
def test_a_line_that_closes_may_be_begun_anywhere(first: int) -> None:
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.array(
        [[pose(p=0.05 * np.array((np.cos(a), np.sin(a), 0.0))) @ START] for a in angles]
    )
    ring = np.roll(ring, first, axis=0)
    ((begin, end),) = holds(ring, closed=True).stretches()
    assert end - begin >= len(ring)
    ring[7, 0, :3, 3] += (0.0, 0.0, 9.0)
    assert holds(ring, closed=True).stretches() == ((8, 18),)


def test_the_tool_s_own_place_on_the_flange_counts() -> None:
    found = ToolConfigurations(
        KINEMATICS,
        TOOL,
        START[None, None],
        nothing,
        singular=SINGULAR,
        closed=False,
    )
    spin, branch = np.argwhere(found.can[0])[0]
    T_b_f = START @ pose(rot_z(2 * np.pi * spin / TOOL_SPINS)) @ inverse_pose(TOOL)
    np.testing.assert_allclose(KINEMATICS.forward(found.q[0, spin, branch]), T_b_f, atol=1e-9)
