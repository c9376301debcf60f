"""A profile and the flange pose it was taken from, before anything is read into it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from tjscan.calibration.fits.circle import fit_dominant_circle
from tjscan.calibration.fits.laser_error import circle_by_laser, line_by_laser, roof_by_laser
from tjscan.calibration.fits.line import fit_line
from tjscan.calibration.fits.roof import fit_roof
from tjscan.calibration.fits.samples import ArcSample, LineSample, RoofSample
from tjscan.calibration.noise import NoiseModel
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, frozen_arrays
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.profile import Profile


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class PosedProfile:
    """A profile of the calibration target, and the flange pose it was taken from.

    Parameters
    ----------
    name : str
        What reports call it.
    T_b_f : ndarray, shape (4, 4)
        Flange pose, as the arm read it.
    profile : Profile
        What the laser saw from there.
    q : ndarray, shape (joints,), or None
        Joint angles there, radians, where they are known.
    """

    name: str
    T_b_f: Array
    profile: Profile
    q: Array | None = None


S = TypeVar("S", LineSample, ArcSample, RoofSample)


def fit_line_samples(
    profiles: Sequence[PosedProfile], noise: NoiseModel, laser: LaserDeviation | None = None
) -> tuple[list[LineSample], dict[str, CalibrationRefused]]:
    """Fit a line to every profile, and keep its flange pose with it.

    Parameters
    ----------
    profiles : sequence of PosedProfile
        Of a board.
    noise : NoiseModel
        Range noise of a point.
    laser : LaserDeviation, optional
        By what the laser may deviate.

    Returns
    -------
    samples : list of LineSample
        Of the profiles that show a line.
    refused : dict of str to CalibrationRefused
        By name, why each of the others shows none.
    """

    def fit(shot: PosedProfile) -> LineSample:
        line = fit_line(shot.profile, noise)
        by_laser = None if laser is None else line_by_laser(line, shot.profile, laser)
        return LineSample(shot.name, shot.T_b_f, line, by_laser)

    return _sort(profiles, fit)


def fit_arc_samples(
    profiles: Sequence[PosedProfile], noise: NoiseModel, laser: LaserDeviation | None = None
) -> tuple[list[ArcSample], dict[str, CalibrationRefused]]:
    """Fit a circle to every profile of a ball, and keep its flange pose with it.

    Parameters
    ----------
    profiles : sequence of PosedProfile
        Of a ball.
    noise : NoiseModel
        Range noise of a point.
    laser : LaserDeviation, optional
        By what the laser may deviate.

    Returns
    -------
    samples : list of ArcSample
        Of the profiles that show an arc.
    refused : dict of str to CalibrationRefused
        By name, why each of the others shows none.
    """

    def fit(shot: PosedProfile) -> ArcSample:
        arc = fit_dominant_circle(shot.profile, noise)
        by_laser = None if laser is None else circle_by_laser(arc, shot.profile, laser)
        return ArcSample(shot.name, shot.T_b_f, arc, by_laser)

    return _sort(profiles, fit)


def fit_roof_samples(
    profiles: Sequence[PosedProfile], noise: NoiseModel, laser: LaserDeviation | None = None
) -> tuple[list[RoofSample], dict[str, CalibrationRefused]]:
    """Fit two lines that meet to every profile of a roof edge.

    Parameters
    ----------
    profiles : sequence of PosedProfile
        Of a roof edge.
    noise : NoiseModel
        Range noise of a point.
    laser : LaserDeviation, optional
        By what the laser may deviate.

    Returns
    -------
    samples : list of RoofSample
        Of the profiles that show the edge.
    refused : dict of str to CalibrationRefused
        By name, why each of the others shows none.
    """

    def fit(shot: PosedProfile) -> RoofSample:
        roof = fit_roof(shot.profile, noise)
        by_laser = None if laser is None else roof_by_laser(roof, shot.profile, laser)
        return RoofSample(shot.name, shot.T_b_f, roof, by_laser)

    return _sort(profiles, fit)


def _sort(
    profiles: Sequence[PosedProfile], fit: Callable[[PosedProfile], S]
) -> tuple[list[S], dict[str, CalibrationRefused]]:
    samples, refused = list[S](), dict[str, CalibrationRefused]()
    for profile in profiles:
        try:
            samples.append(fit(profile))
        except CalibrationRefused as refusal:
            refused[profile.name] = refusal
    return samples, refused
