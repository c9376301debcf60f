"""One view of the groove: where the sensor was, what the laser saw, what was read in it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tjscan.core.frames import Array, frozen_arrays, transform_points
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile


class Substep(StrEnum):
    """Substep that a profile is taken for: teaching, prediction or correction."""

    TAUGHT = "taught"
    PREDICTION = "prediction"
    CORRECTION = "correction"
    RESUMED = "resumed"


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class ProfileView:
    """A profile, and the poses of flange and sensor it was taken from.

    Parameters
    ----------
    index : int
        Number of the section it is taken for, 0 for the first taught one.
    substep : Substep
        What it is taken for.
    T_b_f, T_b_s : ndarray, shape (4, 4)
        Flange and sensor pose as reached, metres.
    profile : Profile
        What the laser saw.
    time : float
        Seconds on the arm's clock.
    q : ndarray, shape (n,)
        Joint angles, radians.
    """

    index: int
    substep: Substep
    T_b_f: Array
    T_b_s: Array
    profile: Profile
    time: float
    q: Array


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class ScannedSection:
    """A view, the groove read in it, and the target frame it was taken with.

    Parameters
    ----------
    view : ProfileView
        The profile and where it was taken from.
    groove : GrooveSection
        The five points and measures, in the sensor frame.
    T_s_t : ndarray, shape (4, 4)
        The target frame in the sensor, eq. (14), metres.
    """

    view: ProfileView
    groove: GrooveSection
    T_s_t: Array

    @property
    def T_b_g(self) -> Array:
        """Frame g in the base frame, eq. (5), shape (4, 4)."""
        return self.view.T_b_s @ self.groove.T_s_g

    @property
    def T_b_t(self) -> Array:
        """Frame t in the base frame, shape (4, 4)."""
        return self.view.T_b_s @ self.T_s_t

    @property
    def points_b(self) -> Array:
        """The five points in the base frame, eq. (4), shape (5, 3), metres."""
        return transform_points(self.view.T_b_s, self.groove.points_s)
