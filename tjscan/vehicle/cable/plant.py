"""The plant behind towing vehicles: MuJoCo simulates the cable, and forces push the vehicles."""

from __future__ import annotations

from typing import Any, Final

import mujoco
import numpy as np

from tjscan.core.errors import VehicleFault
from tjscan.core.frames import Array
from tjscan.vehicle.cable.model import TowingWorldModel
from tjscan.vehicle.cable.scene import specify_scene

TIME_STEP: Final = 0.005
"""Seconds of one step; docs/vehicles.md has what others give."""

DIVERGENCE_WARNINGS: Final = tuple(
    getattr(mujoco.mjtWarning, f"mjWARN_BAD{what}") for what in ("QPOS", "QVEL", "QACC")
)

# Warnings become errors below; left alone, MuJoCo writes them to a file where the program runs.
mujoco.set_mju_user_warning(lambda message: None)


class CablePlant:
    """What truly moves: a cable that lies on the floor, and the n vehicles that hold it.

    The cable starts in a given shape in the plane, at rest. The same forces give the same motion.

    Parameters
    ----------
    world : TowingWorldModel
    angles : ndarray, shape (N,)
        Of the joints at first, radians.
    step : float, optional
        Seconds.
    """

    def __init__(self, world: TowingWorldModel, angles: Array, *, step: float = TIME_STEP) -> None:
        self.cable, self.step = world.cable, step
        model: Any = specify_scene(world, step).compile()
        self._model, self._data = model, mujoco.MjData(model)
        vehicles = [model.joint(f"x {m}") for m in range(len(self.cable.held))]
        three = np.arange(3)
        self._at = np.concatenate([joint.qposadr[0] + three for joint in vehicles])
        self._dof = np.concatenate([joint.dofadr[0] + three for joint in vehicles])
        self._links = np.array([model.body(f"link {i}").id for i in range(self.cable.links)])
        self._floor = model.geom("floor").id
        self._passers_by = [
            int(model.body(f"passer-by {i + 1}").mocapid[0]) for i in range(len(world.passers_by))
        ]
        self._lay_cable(angles)

    def _lay_cable(self, angles: Array) -> None:
        headings, points = self.cable.headings(angles), self.cable.points(angles)
        held = np.array(self.cable.held)
        data = self._data
        for i, angle in enumerate(np.asarray(angles, float)):
            at = self._model.joint(f"joint {i}").qposadr[0]
            data.qpos[at : at + 4] = (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2))
        data.qpos[self._at] = np.column_stack((points[held + 1], headings[held])).ravel()
        mujoco.mj_forward(self._model, data)

    @property
    def poses(self) -> Array:
        """Of the vehicles: x, y in metres and the heading in radians, not wrapped, (n, 3)."""
        return np.array(self._data.qpos[self._at]).reshape(-1, 3)

    @property
    def speeds(self) -> Array:
        """Of the vehicles in frame w, m/s and rad/s, shape (n, 3)."""
        return np.array(self._data.qvel[self._dof]).reshape(-1, 3)

    @property
    def headings(self) -> Array:
        """Directions of the links in the plane, radians, not wrapped, shape (N,)."""
        mujoco.mj_kinematics(self._model, self._data)
        along = self._data.xmat[self._links].reshape(-1, 3, 3)[:, :, 0]
        return np.unwrap(np.arctan2(along[:, 1], along[:, 0]))

    @property
    def points(self) -> Array:
        """The root and the far end of each link, metres, shape (N + 1, 3)."""
        mujoco.mj_kinematics(self._model, self._data)
        near = self._data.xpos[self._links]
        tip = near[-1] + self.cable.link_length * self._data.xmat[self._links[-1]][[0, 3, 6]]
        return np.vstack((near, tip))

    @property
    def touches(self) -> set[tuple[str, str]]:
        """What touches what, but for the floor, by name; a pair in alphabetical order."""
        pairs = self._data.contact.geom
        geom = self._model.geom
        return {
            (min(a, b), max(a, b))
            for a, b in (
                (geom(first).name, geom(second).name)
                for first, second in pairs[(pairs != self._floor).all(axis=1)].tolist()
            )
        }

    @property
    def energy(self) -> float:
        """Of motion, of the bends, and of height, J."""
        mujoco.mj_energyPos(self._model, self._data)
        mujoco.mj_energyVel(self._model, self._data)
        return float(self._data.energy.sum())

    def place_passer_by(self, which: int, at: Array) -> None:
        """Put a passer-by somewhere: x and y, metres, shape (2,)."""
        self._data.mocap_pos[self._passers_by[which], :2] = at

    def advance(self, forces: Array) -> None:
        """Go on by one step.

        Parameters
        ----------
        forces : ndarray, shape (n, 3)
            That push each vehicle, and the moment about its origin, in frame w: newton, N m.

        Raises
        ------
        VehicleFault
            If the simulation diverges; its state is worth nothing then.
        """
        self._data.qfrc_applied[self._dof] = np.ravel(forces)
        mujoco.mj_step(self._model, self._data)
        if any(self._data.warning[kind].number for kind in DIVERGENCE_WARNINGS):
            raise VehicleFault(
                "the simulation of the cable diverged. Forces or speeds are beyond what it can "
                "follow; take a smaller step."
            )
