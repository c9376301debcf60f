"""The simulated cable against one of another make: quasi-static, in the plane, by least work.

While vehicles move a little, the links between two of them go where the bends' energy and the work
against friction together are least (rate-independent evolution with Coulomb friction):

    min over θ of  Σ k θ_i² / 2 + μ m g Σ |p_i(θ) - p_i before|   with the last link's pose given.

The multipliers of that pose are the force and moment on the vehicle that holds it. No equation and
no code of this is the plant's.
"""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'tjscan[towing]'")

from tjscan.core.frames import Array
from tjscan.vehicle.cable.model import CableModel, TowingVehicleModel, TowingWorldModel
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.pad_plant import GRAVITY_M_S2
from tjscan.vehicle.vehicle import Twist

CABLE = CableModel(links=20, held=(9, 19), root=None)
WEIGHT = CABLE.friction * CABLE.link_mass * GRAVITY_M_S2
SMOOTH = np.geomspace(1e-3, 2e-6, 7)
"""Metres that a link may move almost freely, for |p| has no slope at 0; less and less of it."""

PERIOD = 0.25
SPEED = 0.01
DISTANCE = 0.08


class QuasiStaticSegment:
    """Links between two vehicles: joints 10 to 19 of the cable, the last link held."""

    def __init__(self, angles: Array, start: Array) -> None:
        self.angles, self.start = angles, start
        self.middles = self._lay(angles)[1]

    def move(self, start: Array, end: Array) -> Array:
        """Force and moment on the second vehicle, once both stand at these poses."""
        self.start, before = start, self.middles
        for smooth in SMOOTH:
            load = self._find_least_work(before, end, smooth)
        self.middles = self._lay(self.angles)[1]
        return load

    def _find_least_work(self, before: Array, end: Array, smooth: float) -> Array:
        """Newton's method; returns the multipliers."""
        count = len(self.angles)
        for _ in range(50):
            ends, middles, headings, d_ends, d_middles = self._derivatives(self.angles)
            moved = (middles - before)[:-1]
            far = np.sqrt((moved**2).sum(axis=1) + smooth**2)
            along = moved / far[:, None]
            slope = CABLE.stiffness * self.angles
            slope = slope + WEIGHT * np.einsum("ic,icj->j", along, d_middles[:-1])
            across = (np.eye(2) - along[:, :, None] * along[:, None, :]) / far[:, None, None]
            bend = WEIGHT * np.einsum("icj,icd,idk->jk", d_middles[:-1], across, d_middles[:-1])
            off = np.array((*(ends[-1] - end[:2]), headings[-1] - end[2]))
            pose = np.vstack((d_ends[-1], np.ones(count)))
            hessian = bend + CABLE.stiffness * np.eye(count)
            kkt = np.block([[hessian, pose.T], [pose, np.zeros((3, 3))]])
            step = np.linalg.solve(kkt, -np.concatenate((slope, off)))
            self.angles = self.angles + step[:count]
            if np.abs(step[:count]).max() < 1e-9:
                return step[count:]
        raise AssertionError("Newton's method did not converge")

    def _lay(self, angles: Array) -> tuple[Array, Array, Array]:
        headings = self.start[2] + np.cumsum(angles)
        links = CABLE.link_length * np.column_stack((np.cos(headings), np.sin(headings)))
        ends = self.start[:2] + np.cumsum(links, axis=0)
        return ends, ends - links / 2, headings

    def _derivatives(self, angles: Array) -> tuple[Array, Array, Array, Array, Array]:
        ends, middles, headings = self._lay(angles)
        turned = CABLE.link_length * np.column_stack((-np.sin(headings), np.cos(headings)))
        swept = np.cumsum(turned, axis=0)
        before = swept - turned
        lower = np.tril(np.ones((len(angles),) * 2))[:, None, :]
        d_ends = lower * (swept[:, :, None] - before.T[None])
        d_middles = d_ends - lower * turned[:, :, None] / 2
        return ends, middles, headings, d_ends, d_middles


@pytest.mark.parametrize(
    ("angle", "way"),
    [(0.06, 0.927), (0.03, 3.1416)],
    ids=["aslant", "back"],
)
def test_towed_over_the_floor_it_pulls_as_least_work_says(angle: float, way: float) -> None:
    model = TowingWorldModel(cable=CABLE, vehicle=TowingVehicleModel(encoder_noise=0.0))
    world = TowingWorld(model, np.full(20, angle), settle=0.0)
    segment = QuasiStaticSegment(np.full(10, angle), world.truth().poses[0])
    for _ in range(round(DISTANCE / SPEED / PERIOD)):
        for which, heading in enumerate(world.truth().poses[:, 2]):
            ahead, right = SPEED * np.cos(way - heading), SPEED * np.sin(way - heading)
            world.order(which, Twist(ahead, 0.0, right))
        world.truth()
        world.advance(PERIOD)
        truth = world.truth()
        expected = segment.move(*truth.poses)
    # The plant's vehicles carry a little of the cable's weight, for it sinks into the floor.
    np.testing.assert_allclose(truth.forces[1], expected, atol=0.05 * np.abs(expected).max())
    np.testing.assert_allclose(truth.angles[10:], segment.angles, atol=5e-3)
