"""A simulated line laser over the outline of a section: rays in the plane, noise, arc points.

Frame s as on a vehicle: x_s to its right, z_s into the steel, the origin where the rays meet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, radians, sin, tan
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.random import Generator

from tjscan.core.devices import LocalDevice
from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array
from tjscan.core.units import DEG, MM, NOT_IN_FILE, POINTS, SettingsTable
from tjscan.laser.faults import choose_column_runs, round_randomly, round_to_steps
from tjscan.laser.profile import Profile

LASER_STAND_OFF: Final = 0.149
"""Distance at which a line of 80 mm at ±15° is above the steel, in metres."""

Fraction = Annotated[float, Ge(0.0), Le(0.9)]


@dataclass(frozen=True, slots=True, kw_only=True)
class SectionLaserModel(SettingsTable):
    """A line laser over a weld, in numbers. The defaults are data of Kermorgant (2018).

    Parameters
    ----------
    columns : int
        Points per profile.
    half_angle : float
        Between the central ray and the outermost ones, in radians.
    near, far : float
        Limits of z in frame s, in metres.
    noise : float
        Standard deviation of z, in metres; each point moves along its ray.
    step : float
        Coordinates are whole multiples of this, in metres; 0 for no quantisation.
    missing : float
        Fraction of columns without a point.
    missing_run : tuple of int
        Shortest and longest run of them.
    arc : float
        Fraction of columns that show the welding arc's light instead of the steel.
    arc_run : tuple of int
        Shortest and longest run of them.
    arc_reach : float
        Largest distance of such points before or behind the steel, in metres.
    """

    columns: Annotated[int, Ge(20), Le(10_000), POINTS] = 290
    half_angle: Annotated[float, Gt(0.0), Le(60.0), DEG] = radians(15.0)
    near: Annotated[float, Gt(0.0), Le(5000.0), MM] = 0.084
    far: Annotated[float, Gt(0.0), Le(5000.0), MM] = 0.204
    noise: Annotated[float, Ge(0.0), Le(5.0), MM] = 0.06e-3
    step: Annotated[float, Ge(0.0), Le(1.0), MM] = 0.01e-3
    missing: Fraction = 0.01
    missing_run: Annotated[tuple[int, int], NOT_IN_FILE] = (1, 4)
    arc: Fraction = 0.0
    arc_run: Annotated[tuple[int, int], NOT_IN_FILE] = (1, 6)
    arc_reach: Annotated[float, Ge(0.0), Le(500.0), MM] = 0.040

    def __post_init__(self) -> None:
        if not self.near < self.far:
            raise ValueError("near_mm must be smaller than far_mm")

    @property
    def ray_slopes(self) -> Array:
        """Ratio of x to z on each column's ray, rising, shape (columns,)."""
        return tan(self.half_angle) * np.linspace(-1.0, 1.0, self.columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class SectionLaserPose:
    """Pose of a laser before a section.

    Parameters
    ----------
    offset : float
        Its centre minus the section's origin along the laser line, positive to the right, in
        metres: unless it rolls, the origin is seen at ``x_s = -offset``.
    heading : float
        Of the vehicle against the joint, in radians, clockwise positive: what is seen is wider by
        one over its cosine.
    stand_off : float
        Of its origin from the section's height zero, in metres.
    roll : float
        Turn about the forward axis, in radians, positive if its right side goes down.
    """

    offset: float = 0.0
    heading: float = 0.0
    stand_off: float = LASER_STAND_OFF
    roll: float = 0.0


def section_in_sensor(section: Array, pose: SectionLaserPose) -> Array:
    """Points of a section, (across, height), shape (n, 2), as x_s and z_s, in metres."""
    x = section[:, 0] / cos(pose.heading) - pose.offset
    z = pose.stand_off - section[:, 1]
    c, s = cos(pose.roll), sin(pose.roll)
    return np.column_stack((c * x + s * z, c * z - s * x))


def cast_rays_on_section(section: Array, pose: SectionLaserPose, model: SectionLaserModel) -> Array:
    """z_s of what each ray meets first, shape (columns,), in metres; NaN if it meets nothing.

    Parameters
    ----------
    section : ndarray, shape (n, 2)
        Outline of the steel, across and height, in metres.
    pose : SectionLaserPose
    model : SectionLaserModel
    """
    x, z = section_in_sensor(section, pose).T
    slopes = model.ray_slopes
    # Each edge of the outline is met by the rays between its ends.
    ends = np.searchsorted(slopes, x / z)
    low, count = np.minimum(ends[1:], ends[:-1]), np.abs(np.diff(ends))
    edge = np.repeat(np.arange(len(count)), count)
    column = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - low, count)
    slope = slopes[column]
    before = x[edge] - slope * z[edge]
    share = before / (before - x[edge + 1] + slope * z[edge + 1])
    met = z[edge] + share * (z[edge + 1] - z[edge])
    first = np.full(model.columns, np.inf)
    np.minimum.at(first, column, met)
    return np.where((first >= model.near) & (first <= model.far), first, np.nan)


def simulate_section_profile(
    section: Array,
    pose: SectionLaserPose,
    model: SectionLaserModel,
    rng: Generator,
    time: float = 0.0,
) -> Profile:
    """Take one profile of a section.

    Parameters
    ----------
    section : ndarray, shape (n, 2)
        Outline of the steel, across and height, in metres.
    pose : SectionLaserPose
    model : SectionLaserModel
    rng : numpy.random.Generator
    time : float
        Of the profile, in seconds.
    """
    z = cast_rays_on_section(section, pose, model)
    z += model.noise * rng.standard_normal(model.columns)
    everywhere = np.arange(model.columns)
    for share, run, reach in (
        (model.arc, model.arc_run, model.arc_reach),
        (model.missing, model.missing_run, np.nan),
    ):
        count = round_randomly(share * model.columns, rng)
        hit = choose_column_runs(rng, everywhere, count, run)
        z[hit] += reach * rng.uniform(-1.0, 1.0, len(hit))
    x = z * model.ray_slopes
    x, z = round_to_steps(x, model.step), round_to_steps(z, model.step)
    gone = ~((z >= model.near) & (z <= model.far))
    x[gone] = z[gone] = np.nan
    return Profile(x, z, time=time)


class SimulatedSectionLaser(LocalDevice):
    """A `LineLaser` over sections of a joint.

    Parameters
    ----------
    view : callable
        Returns the section below the laser at this moment, shape (n, 2), and its pose over it.
    model : callable
        Returns its optics and faults at this moment: an arc blinds columns while it burns.
    time : callable
        Gives the time in seconds.
    rng : numpy.random.Generator
        Source of all randomness.
    """

    not_connected = (LaserFault, "the laser is not connected: capture inside a `with` block")

    def __init__(
        self,
        view: Callable[[], tuple[Array, SectionLaserPose]],
        model: Callable[[], SectionLaserModel],
        time: Callable[[], float],
        *,
        rng: Generator,
    ) -> None:
        self._view, self._model, self._time, self._rng = view, model, time, rng

    def capture(self) -> Profile:
        """Take one profile from where the laser is now.

        Raises
        ------
        LaserFault
            Outside a ``with`` block.
        """
        self.check_connected()
        section, pose = self._view()
        return simulate_section_profile(section, pose, self._model(), self._rng, self._time())
