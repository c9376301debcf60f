"""What the motors of a vehicle have to turn its tracks with, where slip is a matter of numbers."""

from __future__ import annotations

from math import cos, sin
from typing import Final

from tjscan.vehicle.pad_plant import GRAVITY_M_S2, PadSettings
from tjscan.vehicle.tracks import TrackGeometry

TURN_TIGHTNESS: Final = (0.925, 0.15)
"""Of Merritt's formula, as Wong, Theory of Ground Vehicles, prints it."""


class TrackLoad:
    """Torques of a climb and of a turn, in closed form.

    The weight along the tracks is borne by both alike. A turn is resisted by the moment
    mu_t N L / 4 of pads that slide sideways under the normal force N over the length L, with
    Merritt's mu_t = mu / (0.925 + 0.15 R / b) for the radius R and the gauge b. The pads take some
    way to be sheared, here an L: the moment follows over the way of the tracks.

    Parameters
    ----------
    pads : PadSettings
        Friction, grip, weight, and how the surface lies.
    tracks : TrackGeometry
    """

    def __init__(self, pads: PadSettings, tracks: TrackGeometry) -> None:
        self._pads, self._tracks = pads, tracks
        weight = pads.mass * GRAVITY_M_S2
        self._along = weight * sin(pads.inclination)
        pressed = 2 * pads.pads * pads.grip * GRAVITY_M_S2 + weight * cos(pads.inclination)
        self._most = pads.friction * pressed * pads.contact_length / 4
        self._moment = 0.0

    def advance(self, left: float, right: float) -> None:
        """Let the left and right track run by some metres."""
        run, turn = abs(left) + abs(right), left - right
        if run == 0.0:
            return
        # R / b = |left + right| / 2 |turn|, multiplied out: straight on there is no R.
        own, by_radius = TURN_TIGHTNESS
        wanted = self._most * turn / (own * abs(turn) + by_radius * abs(left + right) / 2)
        share = min(run / 2 / self._pads.contact_length, 1.0)
        self._moment += share * (wanted - self._moment)

    def torques(self, heading: float) -> tuple[float, float]:
        """Torque of the left and right motor at its sprocket, N m, in the sense of its rate.

        Parameters
        ----------
        heading : float
            Of the vehicle on the surface, from x of frame w towards y, radians.
        """
        climb = -self._along * cos(self._pads.down - heading) / 2
        turn = self._moment / self._tracks.gauge
        radius = self._tracks.sprocket_radius
        return radius * (climb + turn), -radius * (climb - turn)
