"""A section in the frame of the result, with the uncertainty of all of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import nan

import numpy as np

from tjscan.core.frames import Array, frozen_arrays, transform_points
from tjscan.groove.section import GrooveSection


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class MeasuredSection:
    """One section of the groove in the frame r of the result: j, or b if no joint is known.

    Parameters
    ----------
    index : int
        Its number in its scan.
    station : str
        Where it was scanned from; names joined by ``+`` if several stations saw it.
    azimuth : float
        About the brace's axis from the crown, radians; NaN if no joint is known.
    T_r_g : ndarray, shape (4, 4)
        Frame g. Its x is square to the laser's plane, which is turned from the groove's normal
        plane by about the pull angle; its y goes up the brace's wall.
    points : ndarray, shape (5, 3)
        p1 to p5, metres.
    covariances : ndarray, shape (3, 3, 3)
        Of p2, p3 and p4, m²: all components of their uncertainty together.
    measures : ndarray, shape (4,)
        Groove angle (radians), root width, depth (metres) and area (m²).
    measure_covariance : ndarray, shape (4, 4)
        Their covariance.
    work_angle : float
        Radians.
    rms : float
        Of the points about the fitted sides, metres.
    model : str
        The form of groove that explains the points best; empty if this is not known.
    model_probability : float
        That the groove has this form, not another one; NaN if this is not known.
    conditions : tuple of str
        What was found about the groove, such as ``tack`` or ``open root``.
    absent : tuple of str
        Corners, of ``p2``, ``p3`` and ``p4``, that are buried, not there or not seen.
    root_opening : float
        Distance of an open root's edge from the leg, metres; NaN if the root is not open.
    shared_sigmas : ndarray, shape (3,)
        Standard deviations of p2, p3 and p4, all directions together, by causes that move all
        sections of a scan; they are part of `covariances`. Metres; NaN if this is not known.
    """

    index: int
    station: str
    azimuth: float
    T_r_g: Array
    points: Array
    covariances: Array
    measures: Array
    measure_covariance: Array
    work_angle: float
    rms: float
    model: str = ""
    model_probability: float = nan
    conditions: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    root_opening: float = nan
    shared_sigmas: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def sigmas(self) -> Array:
        """Standard deviations of the measures, shape (4,)."""
        return np.sqrt(np.diag(self.measure_covariance))

    @property
    def corner_sigmas(self) -> Array:
        """Standard deviations of p2, p3 and p4, all directions together, shape (3,), metres."""
        return np.asarray(np.sqrt(np.trace(self.covariances, axis1=1, axis2=2)))

    @property
    def own_corner_sigmas(self) -> Array:
        """The same by what is the section's own alone; all where nothing else is known."""
        shared = np.nan_to_num(self.shared_sigmas)
        return np.asarray(np.sqrt(np.maximum(self.corner_sigmas**2 - shared**2, 0.0)))


def section_to_result_frame(
    groove: GrooveSection, T_r_s: Array, frame: str, *, index: int, station: str = "1"
) -> MeasuredSection:
    """Transform a section that was read in a profile into the frame of the result.

    Parameters
    ----------
    groove : GrooveSection
        As it was read, in frame s.
    T_r_s : ndarray, shape (4, 4)
        Pose of the sensor in the frame of the result.
    frame : str
        Letter of that frame: in j the section has an azimuth, in b it has none.
    index : int
        Number of the section in its scan.
    station : str
        Name of the station that it was scanned from.
    """
    T_r_g = T_r_s @ groove.T_s_g
    in_plane = T_r_s[:3, [0, 2]]  # x and z of frame s
    x, y = T_r_g[:2, 3]
    return MeasuredSection(
        index=index,
        station=station,
        azimuth=float(np.arctan2(y, x)) if frame == "j" else float("nan"),
        T_r_g=T_r_g,
        points=transform_points(T_r_s, groove.points_s),
        covariances=in_plane @ groove.corner_covariances_s @ in_plane.T,
        measures=np.array((groove.groove_angle, groove.root_width, groove.depth, groove.area)),
        measure_covariance=groove.measure_covariance,
        work_angle=groove.work_angle,
        rms=groove.rms,
        model=groove.model,
        model_probability=groove.model_probability,
        conditions=groove.conditions,
        absent=groove.absent,
        root_opening=groove.root_opening,
    )
