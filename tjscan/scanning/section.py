"""Views of the groove, the sections read in them, and the steps from one section to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from math import radians
from typing import Final

import numpy as np

from tjscan.core.frames import Array, PoseMatrix, array_dataclass, transform_points
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile

TIGHTEST_GROOVE_BEND_RADIUS: Final = 0.04
"""Metres: radius of the tightest bend of a groove. A brace of 168 mm on a leg hardly larger bends
its groove so at the saddle."""

EXTRA_TURN_PER_SECTION: Final = radians(20)
"""Turn from section to section beside the groove's own: noise, and retries that turn the sensor."""

EXTRA_TURN_TAUGHT: Final = radians(45)
"""How much further the first turn may go, from where the operator held the sensor."""

LARGEST_SECTION_TURN: Final = radians(100)
"""Largest turn from section to section, whatever the step."""


class Substep(StrEnum):
    """Substep that a profile is taken for: teaching, prediction or correction.

    In a continuous scan profiles are taken in passing, and those about a section are fused.
    """

    TAUGHT = "taught"
    PREDICTION = "prediction"
    CORRECTION = "correction"
    RESUMED = "resumed"
    PASSING = "passing"
    FUSED = "fused"


@array_dataclass
class ProfileView:
    """A profile, and the poses of flange and sensor it was taken from.

    Parameters
    ----------
    index : int
        Number of the section it is taken for, 0 for the first taught one.
    substep : Substep
        What it is taken for.
    T_b_f, T_b_s : ndarray, shape (4, 4)
        Flange and sensor pose as reached, metres; where a burst showed how far the sensor was from
        its place of rest, with that.
    profile : Profile
        What the laser saw.
    time : float
        Seconds on the arm's clock.
    q : ndarray, shape (n,)
        Joint angles, radians.
    sway : ndarray, shape (2,), optional
        Standard deviations by which the sensor may be from there still, as of `SettledProfile`.
    """

    index: int
    substep: Substep
    T_b_f: PoseMatrix
    T_b_s: PoseMatrix
    profile: Profile
    time: float
    q: Array
    sway: Array | None = None


@array_dataclass
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
    T_s_t: PoseMatrix

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


Sections = Sequence[ScannedSection]
"""Sections of one scan, in the order in which they were finished."""


@array_dataclass
class SetPoint:
    """Pose of frame t that the sensor shall be moved to, and frame t's place in the sensor.

    Parameters
    ----------
    T_b_t : ndarray, shape (4, 4)
        Frame t in the base frame, metres.
    T_s_t : ndarray, shape (4, 4)
        Frame t in the sensor frame, eq. (14), metres.
    covariance : ndarray, shape (7, 7), optional
        Of where the ideal set-point will turn out to be: position and rotation vector in frame t
        (metres, radians), and work angle (radians). None if the predictor does not know.
    straight : bool
        Whether the flange shall go there on a straight line, as the paper's does. A path in
        joint space is shorter for the joints and takes less time.
    """

    T_b_t: Array
    T_s_t: Array
    covariance: Array | None = None
    straight: bool = True


@array_dataclass
class StepRequest:
    """One step as it was planned: from which section, where to, how long.

    Parameters
    ----------
    last : ScannedSection
        The section it starts from.
    p_b_ahead : ndarray, shape (3,)
        Where it leads: origin of frame t in the prediction substep, metres.
    length : float
        Metres.
    predicted : ScannedSection, optional
        What the prediction view showed, once it is read.
    """

    last: ScannedSection
    p_b_ahead: Array
    length: float
    predicted: ScannedSection | None = None

    @property
    def direction_b(self) -> Array:
        """Unit vector of the step, shape (3,).

        It starts from frame t or from the groove, whichever fits its length better: of a section
        that was taught, frame t is beside the groove.
        """
        steps = self.p_b_ahead - np.stack((self.last.T_b_t[:3, 3], self.groove_origin_b))
        lengths = np.linalg.norm(steps, axis=1)
        best = int(np.abs(lengths - self.length).argmin())
        return np.asarray(steps[best] / lengths[best])

    @property
    def groove_origin_b(self) -> Array:
        """Groove origin of the section that the step starts from, shape (3,), metres."""
        return self.last.T_b_g[:3, 3]

    @property
    def max_rotation(self) -> float:
        """Radians that sensor or groove may turn over the step."""
        turn = min(
            EXTRA_TURN_PER_SECTION + self.length / TIGHTEST_GROOVE_BEND_RADIUS, LARGEST_SECTION_TURN
        )
        return turn + EXTRA_TURN_TAUGHT if self.last.view.substep is Substep.TAUGHT else turn


SetPointPredictor = Callable[[Sections, float], SetPoint]
"""Predicts the set-point of the next section from two or more that are finished, a step (metres)
beyond the last one, and from nothing else.

It keeps no state: a scan that was interrupted goes on as if it had not been.
"""

StepLengthRule = Callable[[Sections], float]
"""Chooses the length of the next step, metres, from the finished sections and from nothing else."""
