"""Where the welder is to be along its seam."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.area import LOOK_AHEAD, DiscObstacle
from tjscan.towing.tables import SeamSettings

SMALLEST_SWEEP: Final = 1e-12
"""Square metres of a way: what goes less is at rest."""

WAY_SAMPLES: Final = 5
"""Places on that way that are looked at: at 0.1 m/s they are 25 mm apart."""


class Polyline:
    """A path of straight pieces, by its length.

    Parameters
    ----------
    points : sequence of (float, float)
        One at least, metres.
    """

    def __init__(self, points: Sequence[tuple[float, float]]) -> None:
        self.points: Array = np.array(points, dtype=float).reshape(-1, 2)
        steps = np.diff(self.points, axis=0)
        pieces = np.hypot(steps[:, 0], steps[:, 1])
        self.corners: Array = np.concatenate(([0.0], np.cumsum(pieces)))
        """Length from the beginning to each point, metres."""
        self.directions: Array = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        """Of each piece, from x towards y, radians, without jumps of whole turns."""

    @property
    def length(self) -> float:
        """Of all pieces, metres."""
        return float(self.corners[-1])

    def point_at(self, along: float | Array) -> Array:
        """Points at lengths from the beginning, metres, shape (..., 2); its ends beyond them."""
        places = [np.interp(along, self.corners, axis) for axis in self.points.T]
        return np.stack(places, axis=-1)


class Seam:
    """A seam with the welder's heading along it.

    Parameters
    ----------
    settings : SeamSettings
    """

    def __init__(self, settings: SeamSettings) -> None:
        self.settings = settings
        self.path = Polyline(settings.points)
        self._turns, self._headings = self._plan_headings()

    @property
    def length(self) -> float:
        """Metres; 0 if the welder stays in one place."""
        return self.path.length

    @property
    def seconds(self) -> float:
        """That welding takes without a halt."""
        return self.length / self.settings.speed if self.length else self.settings.seconds

    def pose_at(self, along: float) -> Array:
        """Pose of the welder at a length along the seam: x, y, heading, shape (3,).

        Parameters
        ----------
        along : float
            From the beginning, metres.
        """
        heading = np.interp(along, self._turns, self._headings)
        return np.array((*self.path.point_at(along), heading))

    def nearest_obstacle(
        self, pose: Array, along: float, obstacles: Sequence[DiscObstacle]
    ) -> tuple[float, str]:
        """Distance of the obstacle that comes nearest to the welder's centre, and its name.

        Within `LOOK_AHEAD`, on the welder's way and on its own.

        Parameters
        ----------
        pose : ndarray, shape (3,)
            Of the welder now.
        along : float
            Where along the seam it is to be, metres.
        obstacles : sequence of DiscObstacle

        Returns
        -------
        tuple of (float, str)
            Metres; infinite without obstacles.
        """
        way = np.linspace(along, along + LOOK_AHEAD * self.settings.speed, WAY_SAMPLES)
        places = np.vstack((pose[:2], self.path.point_at(way)))
        nearest = inf, ""
        for one in obstacles:
            begin, sweep = np.array((one.x, one.y)), LOOK_AHEAD * np.array(one.velocity)
            share = (places - begin) @ sweep / max(float(sweep @ sweep), SMALLEST_SWEEP)
            away = places - begin - np.clip(share, 0.0, 1.0)[:, None] * sweep
            nearest = min(nearest, (float(np.hypot(*away.T).min()) - one.radius, one.name))
        return nearest

    def _plan_headings(self) -> tuple[Array, Array]:
        """Lengths along the seam, and headings there; in between they change evenly."""
        if self.settings.heading is not None:
            return np.zeros(1), np.array([self.settings.heading])
        lengths, headings = [0.0], [float(self.path.directions[0])]
        corners, directions = self.path.corners, self.path.directions
        for k in range(1, len(directions)):
            before = min(self.settings.corner, (corners[k] - corners[k - 1]) / 2)
            after = min(self.settings.corner, (corners[k + 1] - corners[k]) / 2)
            lengths += [corners[k] - before, corners[k] + after]
            headings += [directions[k - 1], directions[k]]
        return np.array(lengths), np.array(headings)
