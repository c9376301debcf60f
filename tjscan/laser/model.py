"""Optics and faults of the simulated laser, one number each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Final, Self

from annotated_types import Ge, Le

from tjscan.core.units import MILLISECONDS, MM, NOT_IN_FILE, POINTS, PPM_UNIT, SettingsTable

STANDARD_Z_RANGE: Final = (0.190, 0.290)
"""Nearest and farthest z of the 100 mm range, in metres (scanCONTROL 26xx-100)."""

EXTENDED_Z_RANGE: Final = (0.125, 0.390)
"""Nearest and farthest z at which the same sensor still measures, less accurately, in metres."""

# The trapezoid is 83 mm wide at z = 190 mm and 121 mm at z = 290 mm; its sides meet at the emitter.
_WINDOW_SLOPE: Final = 0.5 * (0.121 - 0.083) / (0.290 - 0.190)
_WINDOW_APEX_Z: Final = 0.190 - 0.5 * 0.083 / _WINDOW_SLOPE


@dataclass(frozen=True, slots=True)
class MeasuringRange:
    """The laser's measuring range (its window) in the laser plane. Metres, radians.

    Parameters
    ----------
    near, far : float
        Limits of z in frame s.
    apex_z : float
        The sides of the trapezoid meet at (0, 0, apex_z) in frame s.
    half_angle : float
        Between the central ray and a side.
    columns : int
        Points on a line that crosses the whole width.
    """

    near: float
    far: float
    apex_z: float
    half_angle: float
    columns: int

    def __post_init__(self) -> None:
        if not self.apex_z < self.near < self.far:
            raise ValueError("a window needs apex_z < near < far")
        if not 0 < self.half_angle < math.pi / 2 or self.columns < 2:
            raise ValueError("a window needs an opening between 0 and 90° and at least two columns")


Fraction = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True, slots=True)
class LaserModel(SettingsTable):
    """A line laser in numbers, the table [simulation.laser]. Metres, radians.

    The defaults of `columns`, `near`, `far`, `emitter_z`, `half_angle` and `step` are data of
    the scanCONTROL 26xx-100. **Every other default is an assumption**, chosen inside the span
    that such sensors show on ground steel. A zero amplitude or probability switches its
    effect off; `without_faults` switches all of them off.

    Parameters
    ----------
    columns : int
        Points per profile, 80 to 640 in steps of 80.
    near, far : float
        Limits of z in frame s; see `STANDARD_Z_RANGE` and `EXTENDED_Z_RANGE`.
    emitter_z : float
        The light, and the detector's columns, fan out from (0, 0, emitter_z) in frame s. That
        both have the same apex is an assumption.
    half_angle : float
        Between the central ray and the outermost ones.
    detector_y, detector_z : float
        The detector looks from (0, detector_y, detector_z) in frame s. Assumption: what fits
        the sensor's housing, a triangulation angle of 17° in mid range.
    noise : float
        Standard deviation of the range. Such sensors show 0.02 to 0.05 mm.
    noise_correlation : float
        Columns after which the noise's correlation has fallen to 1/e: speckle is not white.
        Zero makes it white.
    bias, bias_limit : float
        The range is too long by ``bias * tan(incidence)``, at most by `bias_limit`.
    linearity : float
        Largest error of the sensor's own calibration in its window, in metres: of range and of
        x, from scale, tilt and lens, the same in every profile, see `tjscan.laser.deviation`.
        Data sheets of the class state 0.1 to 0.2 % of the range.
    linearity_seed : int, optional
        Which sensor of its kind it is; the simulation's seed if left out.
    dropout : float
        Probability that a column loses its point at `dropout_end` and beyond.
    dropout_start, dropout_end : float
        Incidence at which points begin to drop out, and at which it gets no worse.
    missing : float
        Fraction of columns that stay empty for no visible reason; up to 0.1 is realistic.
    missing_run : tuple of int
        Shortest and longest run of such columns.
    ghosts : float
        Fraction of the points that are ghosts: seen in the mirror of a ground face instead of
        directly. 0 to 0.15 is realistic. If no face mirrors another there are none.
    ghost_share : float
        At most this share of the columns that could show a ghost do: no face turns into a
        mirror altogether. It outweighs `ghosts` where few columns could.
    ghost_run : tuple of int
        Shortest and longest run of ghosts.
    ghost_intensity : float
        Brightness of a ghost relative to the direct point.
    flyers : float
        Probability that a point beside an edge (a crease or a jump) flies.
    flyer_overshoot : float
        Standard deviation by which a flyer misses the span between the edge's two sides.
    flyer_crease : float
        Two neighbouring columns whose normals differ by more have a crease between them.
    flyer_jump : float
        Two neighbouring columns farther than this from each other's tangent plane have a jump
        between them.
    strays : float
        Fraction of the points that stray: runs before or behind the surface, as multiple
        reflections between shiny faces make them. Up to 0.3 on a shiny groove.
    stray_run : tuple of int
        Shortest and longest run of them.
    stray_offset : tuple of float
        Least and largest distance from the surface along the ray.
    interreflection : float
        How far light from one face onto the other pulls a notch in, towards the sensor: up to
        1.5 mm on shiny steel.
    interreflection_reach : float
        Distance from the notch within which it fades out, smoothly.
    notch : float
        Two neighbouring columns whose normals turn towards each other by more have a notch
        between them.
    step : float
        Raw coordinates are whole multiples of this; zero for no quantisation.
    clock_offset : float
        By which the sensor's own clock is ahead of the arm's in a stream of profiles, seconds.
    clock_drift : float
        By which it runs faster, as a share.
    delay, delay_jitter : float
        Seconds from a profile's exposure until it is there, and their standard deviation.
    occlusion : bool
        Whether what the detector does not see is lost; without, it sits on the emitter.
    """

    columns: Annotated[int, NOT_IN_FILE] = 640
    near: Annotated[float, NOT_IN_FILE] = STANDARD_Z_RANGE[0]
    far: Annotated[float, NOT_IN_FILE] = STANDARD_Z_RANGE[1]
    emitter_z: Annotated[float, NOT_IN_FILE] = _WINDOW_APEX_Z
    half_angle: Annotated[float, NOT_IN_FILE] = math.atan(_WINDOW_SLOPE)
    detector_y: Annotated[float, NOT_IN_FILE] = 0.080
    detector_z: Annotated[float, NOT_IN_FILE] = _WINDOW_APEX_Z
    noise: Annotated[float, Ge(0), Le(5), MM] = 30e-6
    noise_correlation: Annotated[float, Ge(0), Le(100), POINTS] = 4.0
    bias: Annotated[float, Ge(0), Le(5), MM] = 20e-6
    bias_limit: Annotated[float, NOT_IN_FILE] = 100e-6
    linearity: Annotated[float, Ge(0), Le(5), MM] = 0.0
    linearity_seed: Annotated[int, Ge(0)] | None = None
    dropout: Fraction = 1.0
    dropout_start: Annotated[float, NOT_IN_FILE] = math.radians(60)
    dropout_end: Annotated[float, NOT_IN_FILE] = math.radians(80)
    missing: Fraction = 0.02
    missing_run: Annotated[tuple[int, int], NOT_IN_FILE] = (1, 4)
    ghosts: Fraction = 0.065
    ghost_share: Annotated[float, NOT_IN_FILE] = 0.6
    ghost_run: Annotated[tuple[int, int], NOT_IN_FILE] = (4, 30)
    ghost_intensity: Annotated[float, NOT_IN_FILE] = 0.3
    flyers: Fraction = 0.3
    flyer_overshoot: Annotated[float, NOT_IN_FILE] = 0.5e-3
    flyer_crease: Annotated[float, NOT_IN_FILE] = math.radians(20)
    flyer_jump: Annotated[float, NOT_IN_FILE] = 0.5e-3
    strays: Fraction = 0.0
    stray_run: Annotated[tuple[int, int], NOT_IN_FILE] = (8, 40)
    stray_offset: Annotated[tuple[float, float], NOT_IN_FILE] = (0.8e-3, 8e-3)
    interreflection: Annotated[float, Ge(0), Le(5), MM] = 0.0
    interreflection_reach: Annotated[float, NOT_IN_FILE] = 4e-3
    notch: Annotated[float, NOT_IN_FILE] = math.radians(20)
    step: Annotated[float, Ge(0), Le(1), MM.with_key("resolution_mm")] = 5e-6
    clock_offset: Annotated[float, Ge(-10_000), Le(10_000), MILLISECONDS] = 0.02
    clock_drift: Annotated[float, Ge(-1000), Le(1000), PPM_UNIT] = 50e-6
    delay: Annotated[float, NOT_IN_FILE] = 2e-3
    delay_jitter: Annotated[float, Ge(0), Le(100), MILLISECONDS] = 0.5e-3
    occlusion: bool = True

    @property
    def measuring_range(self) -> MeasuringRange:
        """The window in which it measures."""
        return MeasuringRange(self.near, self.far, self.emitter_z, self.half_angle, self.columns)

    @classmethod
    def without_faults(cls, **changes: Any) -> Self:
        """Model without faults: all effects off except those given in `changes`."""
        amplitudes = ("noise", "bias", "interreflection", "step")
        probabilities = ("dropout", "missing", "ghosts", "flyers", "strays")
        return cls(**{**dict.fromkeys((*amplitudes, *probabilities), 0.0), **changes})
