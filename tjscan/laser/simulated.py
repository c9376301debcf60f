"""A simulated line laser, before a surface of triangles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from tjscan.core.devices import LocalDevice
from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array
from tjscan.laser.deviation import Distortion
from tjscan.laser.faults import FaultRandomStreams, SimulatedProfile, apply_faults
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import RaycastSurface, laser_ray_directions, trace_laser_rays
from tjscan.laser.profile import Profile


class SimulatedLaser(LocalDevice):
    """A `LineLaser` on a simulated arm.

    Parameters
    ----------
    surface : RaycastSurface
        What is before the sensor, in frame j.
    pose : callable
        Returns ``T_j_s``, shape (4, 4): the *true* pose of the sensor at this moment.
    model : LaserModel
        Its optics and faults.
    rng : numpy.random.Generator
        Source of all randomness. The same seed gives the same sequence of profiles, and what a
        fault draws in the k-th profile depends on neither the other faults nor earlier views.
    clock : callable
        Gives the time in seconds.
    make : int, optional
        Decides how the sensor's own calibration is off, see `LaserModel.linearity`: which sensor
        of its kind it is.
    """

    not_connected = (
        LaserFault,
        "the simulated laser is not connected: capture inside a `with` block",
    )

    def __init__(
        self,
        surface: RaycastSurface,
        pose: Callable[[], Array],
        *,
        model: LaserModel,
        rng: Generator,
        clock: Callable[[], float],
        make: int = 0,
    ) -> None:
        self.model = model
        self._surface, self._pose, self._clock = surface, pose, clock
        self._rng = rng
        self._directions_s = laser_ray_directions(model)
        self._distortion = Distortion.draw(model, make)

    def capture(self) -> Profile:
        """Take one profile from where the sensor is now.

        Raises
        ------
        LaserFault
            Outside a ``with`` block, or if the pose is not one.
        """
        points = self.capture_with_origins()
        return Profile(points.x_s, points.z_s, points.intensity, self._clock())

    def capture_with_origins(self) -> SimulatedProfile:
        """Take one profile with the origin of each point; raises as `capture` does."""
        self.check_connected()
        T_j_s = np.asarray(self._pose(), dtype=np.float64)
        if T_j_s.shape != (4, 4) or not np.isfinite(T_j_s).all():
            raise LaserFault(f"the simulated laser was put at a pose that is not one: {T_j_s}")
        hits = trace_laser_rays(self._surface, T_j_s, self.model, self._directions_s)
        return apply_faults(hits, self.model, FaultRandomStreams.spawn(self._rng), self._distortion)
