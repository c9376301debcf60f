"""Stitching: each station finds the joint, overlaps register stations, the loop closes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tjscan.core import pose_vector
from tjscan.core.errors import ConfigurationError, StitchingRefused
from tjscan.core.frames import Array, array_dataclass, inverse_pose, rotation_angle_between
from tjscan.joint.tubes.fit import TubeDimensions
from tjscan.stitching.budget import SharedCauses, stitching_budget
from tjscan.stitching.fusion import fuse_sections, sections_in_joint_frame
from tjscan.stitching.graph import (
    CarriedFrames,
    StationErrorDraws,
    StationPoses,
    overlap_gap,
    spanning_tree_poses,
)
from tjscan.stitching.registration import (
    Registrations,
    StationRegistration,
    StitchingDraft,
    align_second_to_first,
)
from tjscan.stitching.stations import (
    DEFAULT_STITCH_SETTINGS,
    FULL_TURN_ANGLE,
    AzimuthArc,
    Station,
    StationOverlap,
    StationTubeFit,
    StitchSettings,
    TubeFits,
    arc_of_azimuths,
    azimuth_coverage,
    find_overlaps,
    fit_tubes_to_stations,
    section_azimuths,
    widen_frame_for_out_of_round,
)
from tjscan.stitching.unrolled_views import UnrolledViews, unroll_views

ALIGNMENT_ROUNDS = 6
"""Times that a station is laid on another again if it began far off."""

CONVERGED_STATION_MOTION = 1e-8
"""Metres and radians that it moves by no more in the end."""

AGREED_CHI2 = 2.5
"""Chi-squared per degree of freedom of stations and overlaps that agree."""

LARGEST_ALIGNMENT_MOTION = 0.05
"""Metres and radians by which no station is laid again: both see something else."""


@array_dataclass
class PlacedStation:
    """Pose of a station's base in the joint's frame, with covariance and what it rests on.

    Parameters
    ----------
    fit : StationTubeFit
        Which station, and its tubes.
    T_j_b : ndarray, shape (4, 4)
        Its base in frame j.
    covariance : ndarray, shape (6, 6)
        Of translation and rotation vector, in j and about its origin.
    arc : AzimuthArc
        What it saw.
    """

    fit: StationTubeFit
    T_j_b: Array
    covariance: Array
    arc: AzimuthArc


class StitchedGroove:
    """One groove stitched from what several stations saw of one joint.

    Parameters
    ----------
    stations : sequence of Station
        Two or more, in any order.
    settings : StitchSettings
        Assumptions and limits.

    Raises
    ------
    StitchingRefused
        If a station does not see the joint, or an overlap that is needed can't hold two stations
        together. It carries a `StitchingDraft` of what there was until then.
    ConfigurationError
        If there are fewer than two stations, or two of one name or of one recording.

    Attributes
    ----------
    stations : tuple of PlacedStation
        By name.
    shape : TubeDimensions
        Radii of the tubes, angle and offset of their axes.
    shape_sigma : ndarray, shape (4,)
        Standard deviations of these.
    registrations : tuple of StationRegistration
        Of every overlap.
    gaps : tuple of float
        How far apart the placed stations are at each of these, metres.
    out_of_round : float
        How far the tubes' walls were taken to bulge from circles, metres.
    gap_before, gap_after : float or None
        The largest if the way round closes, by overlaps alone and in the end, metres; None
        if it does not close.
    covered : float
        Azimuth without a gap, radians.
    sections : tuple of MeasuredSection
        In frame j by azimuth; those that several stations saw are fused.
    budget : UncertaintyBudget
        Where the sections' uncertainty comes from.
    draft : StitchingDraft
        Its stations, overlaps and registrations, for messages.
    """

    def __init__(
        self, stations: Sequence[Station], settings: StitchSettings = DEFAULT_STITCH_SETTINGS
    ) -> None:
        stations = sorted(stations, key=lambda station: station.name)
        _check_distinct_stations(stations)
        fits = fit_tubes_to_stations(stations, settings)
        azimuths = [section_azimuths(fit) for fit in fits]
        names = tuple(station.name for station in stations)
        draft = StitchingDraft(names, tuple(azimuths), tuple(find_overlaps(azimuths)))
        try:
            held = _overlaps_that_count(draft, settings)
            self.registrations = tuple(register_overlaps(fits, held, settings))
            self.draft = draft = replace(draft, registrations=self.registrations)
            _check_registrations(draft, settings)
            shared = SharedCauses(fits, self.registrations)
            placement, self.out_of_round = place_stations_with_out_of_round(
                fits, self.registrations, settings, shared.all_errors
            )
            _check_placement(draft, placement, settings)
            if (carried := _carried_frames(fits)) is not None:
                _check_carrier(draft, placement, carried, shared.all_errors, settings)
                frames = [widen_frame_for_out_of_round(f.frame, self.out_of_round) for f in fits]
                placement = StationPoses(frames, self.registrations, carried=carried)
        except StitchingRefused as error:
            raise StitchingRefused(error.reason, error.evidence, draft) from None
        budget, covariances, shape_covariance = stitching_budget(
            fits, self.registrations, placement, shared, settings.repeatability
        )
        self.shape, self.shape_sigma = placement.shape, np.sqrt(np.diag(shape_covariance))
        placed = zip(fits, placement.T, covariances, map(arc_of_azimuths, azimuths), strict=True)
        self.stations = tuple(
            PlacedStation(fit, T @ inverse_pose(fit.frame.T), covariance, arc)
            for fit, T, covariance, arc in placed
        )
        # Weighed by what is each station's own: what they share would not make one of them worse.
        single = [
            sections_in_joint_frame(one.fit.station, one.T_j_b, covariance, settings.repeatability)
            for one, covariance in zip(self.stations, placement.covariance, strict=True)
        ]
        fused = fuse_sections(single, placement.shape)
        self.budget = budget.fuse_sections([one.shares for one in fused])
        self.sections = self.budget.sections_with_covariances([one.section for one in fused])
        self.gaps = tuple(overlap_gap(edge, placement.T) for edge in self.registrations)
        chain, closing = spanning_tree_poses(len(stations), self.registrations)
        self.gap_before = max((overlap_gap(edge, chain) for edge in closing), default=None)
        self.gap_after = max(self.gaps) if closing else None
        self.covered = azimuth_coverage(azimuths)[0]

    @property
    def is_closed(self) -> bool:
        """Whether the stitched sections go all the way round, without a gap."""
        return self.covered > FULL_TURN_ANGLE - 1e-9


def register_overlaps(
    fits: TubeFits, overlaps: Sequence[StationOverlap], settings: StitchSettings
) -> list[StationRegistration]:
    """Align the two stations of every overlap; raises as `align_second_to_first` does.

    Parameters
    ----------
    fits : sequence of StationTubeFit
        Of all stations.
    overlaps : sequence of StationOverlap
        Those that are large enough.
    settings : StitchSettings
        Gives the arms' repeatability.
    """
    shape = TubeDimensions(*np.mean([one.frame.shape.as_array for one in fits], axis=0).tolist())

    def seen(k: int, T: Array) -> UnrolledViews:
        """What a station saw, its own frame j moved by T."""
        T_j_b = T @ inverse_pose(fits[k].frame.T)
        return unroll_views(fits[k].station.all_sections, T_j_b, shape, settings.repeatability)

    own = [seen(k, np.eye(4)) for k in range(len(fits))]
    edges = []
    for overlap in overlaps:
        first, second, T = own[overlap.first], own[overlap.second], np.eye(4)
        for _ in range(ALIGNMENT_ROUNDS):
            edge = align_second_to_first(overlap, first, second)
            T = edge.T @ T
            moved = float(np.abs(pose_vector.pose_to_vector(edge.T)).max())
            if moved < CONVERGED_STATION_MOTION or moved > LARGEST_ALIGNMENT_MOTION:
                break
            second = seen(overlap.second, T)
        edges.append(replace(edge, T=T))
    return edges


def place_stations_with_out_of_round(
    fits: TubeFits,
    registrations: Registrations,
    settings: StitchSettings,
    shared: StationErrorDraws | None = None,
) -> tuple[StationPoses, float]:
    """Place stations, and find how far tubes must be out of round for all to agree.

    A station can't see that the half of a tube before it is not round: it finds frame j a little
    elsewhere. Overlaps are not affected. If the two disagree, tubes weigh less.

    Parameters
    ----------
    fits : sequence of StationTubeFit
        Of all stations.
    registrations : sequence of StationRegistration
        Of all overlaps.
    settings : StitchSettings
        How far tubes may be out of round.
    shared : StationErrors, optional
        Errors that stations and overlaps have in common.

    Returns
    -------
    placement : StationPoses
        Of all stations.
    out_of_round : float
        How far the tubes' walls were taken to bulge from circles, metres.
    """
    allowance = settings.out_of_round
    while True:
        frames = [widen_frame_for_out_of_round(fit.frame, allowance) for fit in fits]
        placement = StationPoses(frames, registrations, shared)
        if placement.reduced_chi2 < AGREED_CHI2 or 2 * allowance > settings.most_out_of_round:
            return placement, allowance
        allowance *= 2


def _carried_frames(fits: TubeFits) -> CarriedFrames | None:
    """Where a carrier says that the stations' frames j are, if one carried them all."""
    sigmas = [s for fit in fits if (s := fit.station.carrier_sigma) is not None]
    if len(sigmas) < len(fits):
        return None
    T_w_b, T_b_j = ([fit.station.T_w_b for fit in fits], [fit.frame.T for fit in fits])
    return CarriedFrames.of_bases(T_w_b, T_b_j, sigmas)


def _check_carrier(
    draft: StitchingDraft,
    placement: StationPoses,
    carried: CarriedFrames,
    shared: StationErrorDraws | None,
    settings: StitchSettings,
) -> None:
    """Refuse what a carrier says if the overlaps contradict it: no weight would put that right."""
    disagreements = carried.disagreements(placement, shared)
    i = int(disagreements.argmax())
    if disagreements[i] > settings.largest_reduced_chi2:
        found = inverse_pose(placement.T[0]) @ placement.T[i]
        apart = 1e3 * np.linalg.norm(found[:3, 3] - carried.T[i][:3, 3])
        turned = np.degrees(rotation_angle_between(found, carried.T[i]))
        raise StitchingRefused(
            "carrier and overlaps disagree",
            f"on {draft.names[0]}, overlaps put station {draft.names[i]} {apart:.2f} mm and "
            f"{turned:.3f}° from where the carrier says, {np.sqrt(disagreements[i]):.1f} times "
            "farther off than the stated errors explain, "
            f"{np.sqrt(settings.largest_reduced_chi2):.1f} times are allowed. The base or the "
            "joint slipped, an axis is not as [carrier] describes it, or sigma_mm and sigma_deg "
            "are too small",
        )


def _check_distinct_stations(stations: Sequence[Station]) -> None:
    """Refuse what is no two stations: nothing could be learnt of one laid on itself."""
    if len(stations) < 2:
        raise ConfigurationError("stitching takes two stations or more")
    name, count = Counter(station.name for station in stations).most_common(1)[0]
    if count > 1:
        raise ConfigurationError(f"{count} stations are called {name}: give each its own name")
    for one, other in combinations(stations, 2):
        if one.shares_views_with(other):
            message = f"stations {one.name} and {other.name} hold the same recording: leave one out"
            raise ConfigurationError(message)


def _overlaps_that_count(draft: StitchingDraft, settings: StitchSettings) -> list[StationOverlap]:
    """The overlaps that are large enough; refuse if one that is needed is not."""

    def enough(overlap: StationOverlap) -> bool:
        wide = overlap.arc.span_angle >= settings.least_overlap
        return wide and min(overlap.sections) >= settings.fewest_sections

    held = [overlap for overlap in draft.overlaps if enough(overlap)]
    small = [overlap for overlap in draft.overlaps if not enough(overlap)]
    needed = (
        f"{np.degrees(settings.least_overlap):.0f}° and {settings.fewest_sections} sections of "
        "each are needed. Teach the stations' poses so that they overlap by 20° or more, and scan "
        "again"
    )
    # What only just meets is needed if nothing else bridges that place.
    for overlap in small:
        middle, arcs = np.array(overlap.arc.middle_azimuth), [o.arc for o in held]
        if not any(abs(arc.offset_from_middle(middle)) < 0.5 * arc.span_angle for arc in arcs):
            evidence = f"{draft.describe_overlap(overlap)}; {needed}"
            raise StitchingRefused("overlap too small", evidence)
    count, pairs = len(draft.names), [(overlap.first, overlap.second) for overlap in held]
    ends = np.reshape(np.array(pairs, dtype=int), (-1, 2)).T
    links = coo_array((np.ones(len(pairs)), ends), (count, count))
    _, part_of = connected_components(links, directed=False)
    parts = [np.flatnonzero(part_of == part) for part in range(part_of.max() + 1)]
    if len(parts) > 1:
        apart = " | ".join(", ".join(draft.names[k] for k in part) for part in parts)
        evidence = f"no overlap ties {apart}; {draft.describe_coverage()}; {needed}"
        raise StitchingRefused("not connected", evidence)
    return held


def _check_registrations(draft: StitchingDraft, settings: StitchSettings) -> None:
    """Refuse overlaps that contradict themselves, or that hold too little."""
    for edge in draft.registrations:
        described = draft.describe_overlap(edge.overlap)
        contradicts = edge.reduced_chi2 > settings.largest_reduced_chi2
        if contradicts or edge.counted_share < settings.least_counted:
            raise StitchingRefused(
                "overlap contradicts itself",
                f"{described}: {100 * edge.counted_share:.0f} % of its views fit each other, "
                f"{100 * settings.least_counted:.0f} % must; of these "
                f"{1e3 * edge.residual_rms:.3f} mm rms are left, "
                f"{np.sqrt(edge.reduced_chi2):.1f} times what the errors of arm and "
                f"laser explain, {np.sqrt(settings.largest_reduced_chi2):.1f} times are allowed. "
                "Both must show the same joint, and neither joint nor base may move during its "
                "scan",
            )
        if edge.position_sigma > settings.largest_sigma:
            raise StitchingRefused(
                "overlap too small",
                f"{described}: it leaves the second station's place uncertain by "
                f"{1e3 * edge.position_sigma:.2f} mm, {1e3 * settings.largest_sigma:.2f} mm are "
                "allowed. Teach the stations' poses so that they overlap by more, and scan again",
            )


def _check_placement(
    draft: StitchingDraft, placement: StationPoses, settings: StitchSettings
) -> None:
    """Refuse stations that find the tubes elsewhere than their overlaps put them."""
    if placement.reduced_chi2 > settings.largest_reduced_chi2:
        worst = max(draft.registrations, key=lambda edge: overlap_gap(edge, placement.T))
        raise StitchingRefused(
            "overlaps and tubes disagree",
            f"where stations see leg and brace does not fit how they overlap, "
            f"{np.sqrt(placement.reduced_chi2):.1f} times farther off than errors explain, "
            f"{np.sqrt(settings.largest_reduced_chi2):.1f} times are allowed; "
            f"{draft.describe_overlap(worst.overlap)}, where "
            f"{1e3 * overlap_gap(worst, placement.T):.2f} mm would "
            f"be left between them. A base or the joint moved during a scan, or tubes are out of "
            f"round by more than {1e3 * settings.most_out_of_round:g} mm",
        )
