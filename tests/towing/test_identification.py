"""What cable it was, from how hard the vehicles had to push."""

from dataclasses import replace

import numpy as np
import pytest

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.towing.identification import identify_cable
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.estimate import CableEstimate, HeldCable
from tjscan.towing.shape.plan import PoseAccuracy

STATED = Cable(links=20)
HELD = (9, 19)
TRUST = PoseAccuracy(0.5e-3, 2e-3)
CYCLES = 520
ANGLES = np.full(20, 0.12)


def poses_on_the_way() -> Array:
    """Of two vehicles that go to and fro, and turn."""
    start, time = STATED.poses(ANGLES)[list(HELD)], np.arange(CYCLES)[:, None] / CYCLES
    way = np.stack((-0.03 * np.sin(9 * time), 0.02 * np.sin(6 * time), 0.1 * np.sin(7 * time)), -1)
    return np.asarray(start + way * np.array((0.5, 1.0))[:, None])


def pushes_of(cable: Cable, poses: Array) -> Array:
    lies, pushes = CableEstimate.without_floor_pull(cable, ANGLES), np.zeros((CYCLES, 2, 3))
    for push, each in zip(pushes, poses, strict=True):
        lies = HeldCable(cable, HELD, each, TRUST).estimate(lies)
        push[:, :2] = -HeldCable(cable, HELD, each, TRUST).forces(lies)[0]
        off = cable.headings(lies.angles)[-1] - each[-1, 2]
        push[-1, 2] = -cable.bending_stiffness / TRUST.heading_sd**2 * off
    return pushes


def test_the_cable_of_a_tow_is_found_and_how_well() -> None:
    true = replace(STATED, bending_stiffness=2.4, friction=0.6, rest_angle=0.03)
    poses = poses_on_the_way()
    pushes = pushes_of(true, poses)
    pushes += 0.3 * np.random.default_rng(1).normal(size=pushes.shape)
    found = identify_cable(STATED, HELD, poses, pushes, ANGLES, TRUST)
    assert found.stiffness == pytest.approx(0.24, abs=max(0.01, 4 * found.stiffness_sd))
    assert found.drag == pytest.approx(6.0, abs=max(0.2, 4 * found.drag_sd))
    assert found.curvature == pytest.approx(0.3, abs=max(0.03, 4 * found.curvature_sd))
    assert found.stiffness_sd < 0.02
    assert found.drag_sd < 0.5


@pytest.mark.parametrize("cycles", [40, CYCLES])
def test_a_tow_that_does_not_show_it_is_refused(cycles: int) -> None:
    poses = poses_on_the_way()[:cycles]
    pushes = np.full((cycles, 2, 3), np.nan if cycles == CYCLES else 0.0)
    with pytest.raises(ConfigurationError, match="push"):
        identify_cable(STATED, HELD, poses, pushes, ANGLES, TRUST)
