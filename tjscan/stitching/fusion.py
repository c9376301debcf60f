"""Sections in the joint's frame with all of their uncertainty; those at one place are made one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, pose, rot_z, transform_points
from tjscan.core.gaussian_process import PeriodicKernel, SimpleKriging
from tjscan.groove.measured import MeasuredSection, section_to_result_frame
from tjscan.joint.geometry import LegSurface, cylindrical_to_j
from tjscan.joint.tubes.fit import ArmRepeatability, TubeDimensions
from tjscan.stitching.registration import SECTION_SHAPE_AZIMUTH, point_covariance_from_pose
from tjscan.stitching.stations import FULL_TURN_ANGLE, Station
from tjscan.stitching.unrolled_views import WIDEST_LEG_SHARE
from tjscan.uncertainty.budget import CORNER_POINTS, SectionShare

SAME_PLACE_STEP_SHARE: Final = 0.55
"""Sections of different stations closer than this share of a step are of one place."""

LEAST_CURVE_SIGMA: Final = 1e-6
"""Metres that no curve is taken for more certain than."""

LEAST_MEASURE_SIGMA_SHARE: Final = 1e-4
"""The same of measures, as a share of their span."""


class UnrolledSection:
    """A section unrolled about the brace, to be carried along the groove.

    Parameters
    ----------
    section : MeasuredSection
        What it is.
    shape : TubeDimensions
        What it is unrolled about.

    Attributes
    ----------
    azimuth : ndarray, shape (6,)
        Of p1 to p5 and of the origin of g.
    out, up : ndarray, shape (6,)
        Their distances from the brace's axis and heights over the leg.
    """

    def __init__(self, section: MeasuredSection, shape: TubeDimensions) -> None:
        points = np.vstack((section.points, section.T_r_g[:3, 3]))
        azimuth = np.arctan2(points[:, 1], points[:, 0])
        self.section = section
        self.azimuth: Array = section.azimuth + np.angle(np.exp(1j * (azimuth - section.azimuth)))
        self.out = np.hypot(points[:, 0], points[:, 1])
        self.up = points[:, 2] - _leg_height(self.azimuth, self.out, shape)


def sections_in_joint_frame(
    station: Station, T_j_b: Array, covariance: Array, repeatability: ArmRepeatability
) -> tuple[MeasuredSection, ...]:
    """Transform the sections of a station into frame j.

    The covariances of their corners hold the laser's noise, the error of the view's pose and that
    of the station's.

    Parameters
    ----------
    station : Station
        Its sections.
    T_j_b : ndarray, shape (4, 4)
        Its base in frame j.
    covariance : ndarray, shape (6, 6)
        Of that pose: translation and rotation vector in j, about its origin.
    repeatability : ArmRepeatability
        Of its arm.
    """
    sections = []
    for scan in station.sections:
        T_j_s = T_j_b @ scan.view.T_b_s
        index, name = scan.view.index, station.name
        section = section_to_result_frame(scan.groove, T_j_s, "j", index=index, station=name)
        corners = section.points[CORNER_POINTS]
        flange = transform_points(T_j_b, scan.view.T_b_f[:3, 3])
        whole = section.covariances + point_covariance_from_pose(covariance, corners)
        whole = whole + point_covariance_from_pose(repeatability.covariance, corners - flange)
        sections.append(replace(section, covariances=whole))
    return tuple(sections)


@dataclass(frozen=True, slots=True, eq=False)
class FusedSection:
    """A section made of one or several, and how each of these counts in it.

    Parameters
    ----------
    section : MeasuredSection
        In frame j.
    shares : tuple of SectionShare
        Of the sections that it is made of, by their numbers among all stations' sections.
    """

    section: MeasuredSection
    shares: tuple[SectionShare, ...]


def fuse_sections(
    stations: Sequence[Sequence[MeasuredSection]], shape: TubeDimensions
) -> tuple[FusedSection, ...]:
    """Fuse the sections of all stations by azimuth; sections of one place become one.

    Parameters
    ----------
    stations : sequence of sequence of MeasuredSection
        Of each station, in frame j and in the order of the scan.
    shape : TubeDimensions
        What sections are unrolled about when they are carried to their common place.
    """
    unrolled = [[UnrolledSection(section, shape) for section in sections] for sections in stations]
    curves = _fit_section_changes([one for sections in unrolled for one in sections])
    azimuths = [np.unwrap([section.azimuth for section in sections]) for sections in stations]
    steps = np.concatenate([np.abs(np.diff(azimuth)) for azimuth in azimuths])
    near = SAME_PLACE_STEP_SHARE * float(np.median(steps))
    places = sorted(
        (section.azimuth, k, i)
        for k, sections in enumerate(stations)
        for i, section in enumerate(sections)
    )
    first = np.cumsum([0, *(len(sections) for sections in stations)])
    fused = []
    for group in _group_sections_by_place(places, near):
        members = [(azimuth, unrolled[k][i]) for azimuth, k, i in group]
        numbers = [int(first[k]) + i for _, k, i in group]
        if len(group) > 1:
            fused.append(_fused_section(members, numbers, curves, shape))
        else:
            share = SectionShare.whole_section(numbers[0])
            fused.append(FusedSection(members[0][1].section, (share,)))
    return tuple(sorted(fused, key=lambda one: one.section.azimuth))


Place = tuple[float, int, int]
"""Azimuth, station, and number in that station."""


def _group_sections_by_place(places: Sequence[Place], near: float) -> list[list[Place]]:
    """Neighbours of different stations that are one place; nearest pairs first."""
    n = len(places)
    member = list(range(n))
    ahead = [(places[(i + 1) % n][0] - places[i][0]) % FULL_TURN_ANGLE for i in range(n)]
    groups = {i: [places[i]] for i in range(n)}
    for i in np.argsort(ahead, kind="stable").tolist():
        a, b = member[i], member[(i + 1) % n]
        if ahead[i] >= near:
            break
        # The whole group must be near, and hold no station twice.
        shift = FULL_TURN_ANGLE if (i + 1) % n == 0 else 0.0
        joined = groups[a] + [(azimuth + shift, k, m) for azimuth, k, m in groups[b]]
        spread = max(p[0] for p in joined) - min(p[0] for p in joined)
        if spread >= near or len({p[1] for p in joined}) < len(joined):
            continue
        groups[a] = joined
        del groups[b]
        member = [a if m == b else m for m in member]
    return list(groups.values())


def _fit_section_changes(unrolled: Sequence[UnrolledSection]) -> list[SimpleKriging]:
    """How out and up of p2, p3 and p4, and the four measures, change along the groove."""
    curves = []
    covariances = np.array([one.section.covariances for one in unrolled])
    sigma = float(np.sqrt(np.median(np.trace(covariances, axis1=2, axis2=3) / 3)))
    for name in ("out", "up"):
        for i in range(1, 4):
            azimuth = np.array([one.azimuth[i] for one in unrolled])
            value = np.array([getattr(one, name)[i] for one in unrolled])
            curves.append(_fit_curve(azimuth, value, max(sigma, LEAST_CURVE_SIGMA)))
    azimuth = np.array([one.section.azimuth for one in unrolled])
    measures = np.array([one.section.measures for one in unrolled])
    sigmas = np.median([one.section.sigmas for one in unrolled], axis=0)
    least = LEAST_MEASURE_SIGMA_SHARE * np.ptp(measures, axis=0) + 1e-12
    for value, sigma in zip(measures.T, np.maximum(sigmas, least), strict=True):
        curves.append(_fit_curve(azimuth, value, float(sigma)))
    return curves


def _fit_curve(azimuth: Array, value: Array, sigma: float) -> SimpleKriging:
    """A smooth curve through values, shape (n,), over the azimuth."""
    kernel = PeriodicKernel(float(np.ptp(value)) + 10 * sigma, SECTION_SHAPE_AZIMUTH)
    return SimpleKriging.fit(kernel, azimuth, value, sigma)


def _leg_height(azimuth: Array, out: Array, shape: TubeDimensions) -> Array:
    surface = LegSurface(shape.leg_radius, shape.angle)
    return surface.height(azimuth, np.minimum(out, WIDEST_LEG_SHARE * shape.leg_radius))


def _fused_section(
    members: Sequence[tuple[float, UnrolledSection]],
    numbers: Sequence[int],
    curves: Sequence[SimpleKriging],
    shape: TubeDimensions,
) -> FusedSection:
    """One section of several, each carried along the groove to their middle."""
    middle = float(np.mean([azimuth for azimuth, _ in members]))
    # Each point to the middle of its own kind: apart along the groove, they would not be one.
    places = np.mean([one.azimuth + azimuth - one.section.azimuth for azimuth, one in members], 0)
    points, frames, corner_info, measure_info, values, turns = [], [], [], [], [], []
    for azimuth, one in members:
        start = one.azimuth + azimuth - one.section.azimuth  # in this group's turn
        by = places - start
        starts = [*start[CORNER_POINTS], *start[CORNER_POINTS], *np.repeat(azimuth, 4)]
        ways = [*by[CORNER_POINTS], *by[CORNER_POINTS], *np.repeat(middle - azimuth, 4)]
        along = zip(curves, starts, ways, strict=True)
        grown = np.array([curve.predict_change(*way) for curve, *way in along])
        out, up = one.out.copy(), one.up.copy()
        out[CORNER_POINTS] += grown[:3]
        up[CORNER_POINTS] += grown[3:6]
        carried = cylindrical_to_j(places, out, _leg_height(places, out, shape) + up)
        turn = rot_z(middle - azimuth)
        turns.append(turn)
        points.append(carried[:5])
        frames.append(pose(turn @ one.section.T_r_g[:3, :3], carried[5]))
        corner_info.append(np.linalg.inv(turn @ one.section.covariances @ turn.T))
        measure_info.append(np.linalg.inv(one.section.measure_covariance))
        values.append(one.section.measures + grown[6:])
    covariances = np.linalg.inv(np.sum(corner_info, axis=0))
    fused = np.mean(points, axis=0)
    fused[CORNER_POINTS] = np.einsum(
        "cij,mcjk,mck->ci", covariances, np.array(corner_info), np.array(points)[:, CORNER_POINTS]
    )
    measure_covariance = np.linalg.inv(np.sum(measure_info, axis=0))
    measures = measure_covariance @ np.einsum("mij,mj->i", np.array(measure_info), np.array(values))
    shares = []
    for k, number in enumerate(numbers):
        weights = np.tile(np.eye(3) / len(numbers), (5, 1, 1))
        weights[CORNER_POINTS] = covariances @ corner_info[k]
        by_measures = measure_covariance @ measure_info[k]
        shares.append(SectionShare(number, weights @ turns[k], by_measures))
    R = Rotation.from_matrix([T[:3, :3] for T in frames]).mean().as_matrix()
    sections = [one.section for _, one in members]
    first = min(sections, key=lambda section: section.station)
    section = replace(
        first,
        station="+".join(sorted(section.station for section in sections)),
        azimuth=float(np.angle(np.exp(1j * middle))),
        T_r_g=pose(R, np.mean([T[:3, 3] for T in frames], axis=0)),
        points=fused,
        covariances=covariances,
        measures=measures,
        measure_covariance=measure_covariance,
        work_angle=float(np.mean([section.work_angle for section in sections])),
        rms=float(np.sqrt(np.mean([section.rms**2 for section in sections]))),
    )
    return FusedSection(section, tuple(shares))
