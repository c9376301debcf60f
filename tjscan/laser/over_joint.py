"""A simulated line laser that is carried over a joint, and sees its section wherever it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

import numpy as np

from tjscan.core.devices import DeviceBase
from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array
from tjscan.laser.profile import Profile
from tjscan.laser.section_laser import (
    SectionLaserModel,
    SectionLaserPose,
    simulate_section_profile,
)


class SimulatedSectionLaser(DeviceBase):
    """A `LineLaser` over sections of a joint.

    Parameters
    ----------
    view : callable
        Gives the section below the laser at this moment, shape (n, 2), and its pose over it.
    model : callable
        Gives its optics and faults at this moment: an arc blinds columns while it burns.
    time : callable
        Gives the time in seconds.
    rng : numpy.random.Generator
        Source of all randomness.
    """

    def __init__(
        self,
        view: Callable[[], tuple[Array, SectionLaserPose]],
        model: Callable[[], SectionLaserModel],
        time: Callable[[], float],
        *,
        rng: np.random.Generator,
    ) -> None:
        self._view, self._model, self._time, self._rng = view, model, time, rng
        self._connected = False

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *error: object) -> None:
        self._connected = False

    def capture(self) -> Profile:
        """Take one profile from where the laser is now.

        Raises
        ------
        LaserFault
            Outside a ``with`` block.
        """
        if not self._connected:
            raise LaserFault("the simulated laser is not connected: capture inside a `with` block")
        section, pose = self._view()
        return simulate_section_profile(section, pose, self._model(), self._rng, self._time())
