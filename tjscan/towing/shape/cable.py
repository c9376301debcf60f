"""The cable as a plane chain of rigid links, and the vehicles along it.

Suzuki et al. (2022), IV-B. Angles are counter-clockwise; a link's pose is its far end's, seen
from the root, with the direction in which the link points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, inf

import numpy as np

from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True)
class Cable:
    """A cable that is fixed at its root. The defaults are the paper's, table I.

    Parameters
    ----------
    links : int
        How many: N.
    link_length : float
        Metres: l.
    least_bend_radius : float
        To which the cable may be bent, metres; no less than half a link.
    bending_stiffness : float
        Of a joint, N m/rad: k.
    friction : float
        Force with which the floor holds a link that slides, newton: μ m g.
    root : tuple of float
        x and y, metres, and the direction of the first link at a first joint of no angle, radians.
    rest_angle : float
        Of every joint of a cable that nothing bends, radians: its set, from years on a drum.
    friction_doubt : float
        Share by which friction over stiffness may differ: floors differ by half (table I has one
        figure), and cables stiffen as they cool.
    """

    links: int = 60
    link_length: float = 0.10
    least_bend_radius: float = 0.133
    bending_stiffness: float = 1.7
    friction: float = 0.87 * 0.10 * 9.81
    root: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rest_angle: float = 0.0
    friction_doubt: float = 0.5

    @property
    def length(self) -> float:
        """Of the whole cable, metres."""
        return self.links * self.link_length

    @property
    def joint_limit(self) -> float:
        """Largest angle of a joint, radians: the links are chords of the tightest circle."""
        return 2 * asin(self.link_length / (2 * self.least_bend_radius))

    def headings(self, angles: Array) -> Array:
        """Directions of the links.

        Parameters
        ----------
        angles : ndarray, shape (..., N)
            Of the joints, radians: θ.

        Returns
        -------
        ndarray, shape (..., N)
            φ_i, radians, not wrapped.
        """
        return np.asarray(self.root[2] + np.asarray(angles).cumsum(axis=-1))

    def poses(self, angles: Array) -> Array:
        """Poses of the links' far ends.

        Parameters
        ----------
        angles : ndarray, shape (..., N)
            Of the joints, radians.

        Returns
        -------
        ndarray, shape (..., N, 3)
            x, y in metres and heading in radians; p_i and φ_i.
        """
        phi = self.headings(angles)
        poses = np.empty((*phi.shape, 3))
        poses[..., 0] = self.root[0] + self.link_length * np.cos(phi).cumsum(axis=-1)
        poses[..., 1] = self.root[1] + self.link_length * np.sin(phi).cumsum(axis=-1)
        poses[..., 2] = phi
        return poses

    def line(self, angles: Array) -> Array:
        """Points from the root to the tip, shape (N + 1, 2), of angles of shape (N,)."""
        return np.vstack((self.root[:2], self.poses(angles)[:, :2]))

    def longest_chords(self, held_links: Sequence[int], pull: float) -> Array:
        """Chords of the pieces before held links, metres, with which they pull when dragged.

        A piece of length L that is dragged sideways hangs on its ends like a rope, by friction q a
        metre: sagging by s it pulls with q L² / 8 s, and its chord is 8 s² / 3 L shorter.

        Parameters
        ----------
        held_links : sequence of int
        pull : float
            Newton.
        """
        lengths = self.link_length * np.diff(held_links, prepend=-1)
        sags = self.friction / self.link_length * lengths**2 / (8 * pull)
        return np.asarray(lengths - 8 / 3 * sags**2 / lengths)

    def angles(self, headings: Array) -> Array:
        """Angles of the joints for headings of the links, both of shape (N,)."""
        return np.diff(headings, prepend=self.root[2])


def equally_spaced_links(links: int, vehicles: int, last: int | None = None) -> tuple[int, ...]:
    """Links that vehicles hold at equal spacing; the last is the welder's, at the tip.

    Parameters
    ----------
    links : int
        Of the cable.
    vehicles : int
        The welder among them.
    last : int, optional
        Links between the last towing vehicle and the welder; as many as others if left out.
    """
    if last is not None:
        return (*equally_spaced_links(links - last, vehicles - 1), links - 1)
    return tuple(round((m + 1) * links / vehicles) - 1 for m in range(vehicles))


@dataclass(frozen=True, slots=True)
class TowingTeam:
    """Vehicles along the cable. The last is the welder: it holds the last link.

    Parameters
    ----------
    held_links : tuple of int
        Link that each vehicle holds, counted from 0 at the root, rising.
    body_radius : float
        Of a vehicle seen from above, metres.
    top_speed : float
        Of a towing vehicle, m/s.
    force : float
        With which a vehicle can pull at most, newton.
    """

    held_links: tuple[int, ...] = equally_spaced_links(60, 6)
    body_radius: float = 0.15
    top_speed: float = 0.1
    force: float = inf

    @property
    def welder(self) -> int:
        """Number of the welder in the team."""
        return len(self.held_links) - 1

    def name_of(self, vehicle: int) -> str:
        """Of a vehicle, counted from 0, for messages."""
        return "the welder" if vehicle == self.welder else f"vehicle {vehicle + 1}"
