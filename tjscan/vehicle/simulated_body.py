"""A simulated vehicle without a driver: drives, plant and sensors, one period at a time."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.frames import Array, pose, rot_z
from tjscan.vehicle.drives import TrackDrives
from tjscan.vehicle.pad_plant import PadPlant
from tjscan.vehicle.plant import VehiclePlant
from tjscan.vehicle.simulation import VehicleSimulationSettings
from tjscan.vehicle.slip_plant import SlipPlant
from tjscan.vehicle.steel import ProximitySensors, SteelArea
from tjscan.vehicle.track_load import TrackLoad
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist, VehicleState

STATE_PERIOD: Final = 0.01
"""Seconds between states."""


class SimulatedBody:
    """Drives, plant and sensors of a simulated vehicle.

    Parameters
    ----------
    tracks : TrackGeometry
        Its tracks.
    settings : VehicleSimulationSettings
        Where it stands and how it moves.
    seed : int, optional
        Of all random numbers: the same seed and commands give the same states.
    pose_w : array_like, shape (3,), optional
        Where it stands, if not where the settings say: x, y in metres and heading in radians.
    time : float, optional
        What its clock shows at first, seconds.
    """

    def __init__(
        self,
        tracks: TrackGeometry,
        settings: VehicleSimulationSettings,
        *,
        seed: int = 0,
        pose_w: Array | None = None,
        time: float = 0.0,
    ) -> None:
        slip, encoders, sensors = np.random.default_rng(seed).spawn(3)
        start = np.array((*settings.start, settings.heading)) if pose_w is None else pose_w
        self.plant: VehiclePlant = (
            SlipPlant(settings.slip, tracks.gauge, start, slip, TrackLoad(settings.pads, tracks))
            if settings.plant == "slip"
            else PadPlant(settings.pads, tracks, start)
        )
        self.steel = SteelArea(settings.steel)
        self.time = time
        self.arc_burning = False
        """Whether an arc disturbs the proximity sensors."""
        self._tracks, self._settings, self._encoders = tracks, settings, encoders
        self._drives = TrackDrives(settings.drives)
        self._sensors = ProximitySensors(settings.proximity, self.steel, sensors)
        self._sampled = -np.inf

    @property
    def T_w_v(self) -> Array:
        """True pose of the vehicle on the unrolled surface, shape (4, 4)."""
        x, y, heading = self.plant.pose_w
        return pose(rot_z(heading), (x, y, 0.0))

    @property
    def braking_time(self) -> float:
        """Seconds in which it brakes from its top speed to rest."""
        drives = self._settings.drives
        return drives.top_speed / drives.braking

    @property
    def stands(self) -> bool:
        """Whether both tracks stand."""
        return not self._drives.speeds.any()

    def advance(
        self, twist: Twist | None, *, period: float = STATE_PERIOD, grip: float = 1.0
    ) -> VehicleState:
        """Go on by a period, and report the state then.

        Parameters
        ----------
        twist : Twist or None
            What to drive; None brakes to rest.
        period : float, optional
            Seconds.
        grip : float, optional
            Share of the tracks' motion that the body follows at most; less than 1 where they spin.
        """
        if twist is None:
            self._drives.brake(period)
        else:
            half = self._tracks.gauge * twist.turn_rate / 2
            self._drives.follow(np.array((twist.speed + half, twist.speed - half)), period)
        left, right = self._drives.speeds.tolist()
        self.plant.advance(grip * left, grip * right, period)
        self.time += period
        return VehicleState(
            self.time, self._read_encoders(left, right), self.plant.torques, self._read_proximity()
        )

    def _read_encoders(self, left: float, right: float) -> Twist:
        r = self._tracks.sprocket_radius
        noise = self._settings.encoder_noise * self._encoders.standard_normal(2)
        return self._tracks.twist(left / r + noise[0], -right / r + noise[1])

    def _read_proximity(self) -> tuple[float, ...]:
        due = self._sampled + self._settings.proximity.period
        if self.time < due - STATE_PERIOD / 2:
            return ()
        self._sampled = self.time
        return self._sensors.read(self.plant.pose_w, arc_burning=self.arc_burning)
