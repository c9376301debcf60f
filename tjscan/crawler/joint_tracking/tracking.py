"""The centre of a V butt joint, profile by profile: searched for once, then tracked."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict, dataclass, replace
from math import hypot, nan, radians, sqrt
from statistics import median
from typing import Final

import numpy as np
import scipy  # its parts are loaded at first use

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, frozen_arrays
from tjscan.crawler.joint_tracking import edge_lines, registration
from tjscan.crawler.joint_tracking.edge_lines import BEVEL_LINES, PLATE_LINES, EdgeLines
from tjscan.crawler.joint_tracking.registration import JointPlacement, ReferenceProfile
from tjscan.groove.read import LEAST_DEPTH, fit_groove
from tjscan.groove.refinement import estimate_variance_inflation
from tjscan.groove.settings import BUTT_V, GrooveSettings
from tjscan.groove.sides import FittedProfile
from tjscan.laser.profile import Profile, ProfileRepeats

HULL_GROOVE_SETTINGS: Final = GrooveSettings(model=BUTT_V, noise=0.06e-3, largest_sigma=0.15e-3)
"""A crawler's joint and its sensor's noise."""

FILLED_GROOVE, TACK_WELD, REGISTERED_JOINT = "filled", "tack", "registered"
"""Conditions of a reading: nothing is left to fill; the root is buried under a tack; the edges are
gone, and the centre is where an earlier profile had it."""

FEWEST_ON_PLATE, FEWEST_ON_BEVEL = 10.0, 3.5
"""Points that must lie on each plate and on each bevel, by their probability: of a bevel whose
angle is known four show where its edge is."""

LEAST_SHARE_ON_PLATE: Final = 0.3
"""Share of the points before a plate that must lie on it."""

BEVEL_TURNS: Final = (radians(10.0), radians(80.0))
"""Angles at which a bevel may leave its plate."""

LARGEST_ANGLE_BETWEEN_PLATES: Final = radians(20.0)
"""Largest angle between the plates."""

LARGEST_JOINT_WIDTH_CHANGE: Final = 1.0e-3
"""The joint's width does not change by more from one profile to the next, in metres."""

LARGEST_WIDENING: Final = 0.2e-3
"""Metres by which it may be wider than when it was last seen there: welds only close it, and where
a bead covers an edge its toe looks like one. It is six standard deviations."""

LEAST_SHARE_ON_REFERENCE: Final = 0.3
"""Share of the points that must lie on the reference."""

LARGEST_REGISTERED_SIGMA: Final = 0.3e-3
"""Of a centre by the reference, metres: half of what guards let a torch be unsure by. Beads show it
less surely than edges, and what is remembered is the line through many of them."""

FARTHEST_SIGMAS, FARTHEST_SIDEWAYS = 4.0, 0.03e-3
"""How far a joint that is found by the reference may be from where it was last: in standard
deviations, and, in metres, for each profile since then. A vehicle at 20 mm/s that turns with a
radius of 5 m carries its laser sideways by half of that."""

REFUSALS_BEFORE_SEARCH: Final = 5
"""Profiles in a row that are refused before the joint is searched for again: a search takes longer
than a sensor's period."""

WEIGHT_OF_NEW_PROFILE: Final = 0.05
"""Share that each profile has in what is known of noise, width and the bevels' angles."""

PROFILES_PER_CORRELATION: Final = 5
"""Of how many profiles one shows how its noise is correlated: that takes a while, and stays."""

DEPTHS_KEPT, DEPTH_EVERY = 21, 50
"""How many depths show what is usual, and of how many profiles one is taken: a tack passes sooner
than half of them."""

SHORT_BEVEL_SHARE: Final = 0.1
"""Share of the way to the root that a bevel still has in a groove nearly filled."""

BURIED_HEIGHT: Final = 1.0e-3
"""A root that is higher than usual by more, in metres, is under a tack."""

FILLED_DEPTH: Final = 0.7e-3
"""A groove less deep than this is filled, in metres."""

WIDE_MEDIAN, NARROW_MEDIAN, STRAY_HEIGHT = 25, 9, 2.0e-3
"""Points over which the bottom's heights are smoothed by their median: first over many, then,
without the points that lie farther from that, in metres, over fewer."""


@dataclass(frozen=True, slots=True, kw_only=True)
@frozen_arrays
class ButtJointReading(JointPlacement):
    """What one profile shows of a butt joint, in the frame s of a sensor on a vehicle.

    Parameters
    ----------
    time : float
        Of the profile, in seconds.
    edges : ndarray, shape (2, 2)
        x_s and z_s of the left and of the right top edge, where hull and bevel meet, in metres.
        If the edges are gone they are NaN.
    edge_covariances : ndarray, shape (2, 2, 2)
        In m².
    depth_left : float
        Of the middle of the bottom below the line between the top edges, in metres; NaN where
        no point of it is seen.
    area_left : float
        Of the cross-section that is left to fill, in m².
    conditions : tuple of str
        Of `FILLED_GROOVE`, `TACK_WELD`, `REGISTERED_JOINT`.
    """

    time: float
    edges: Array
    edge_covariances: Array
    depth_left: float
    area_left: float
    conditions: tuple[str, ...] = ()

    @property
    def width(self) -> float:
        """Between the top edges, in metres."""
        return float(np.hypot(*(self.edges[1] - self.edges[0])))


class JointTracker:
    """Reads the centre of a butt joint off one profile after the other.

    It goes on from its last reading, and knows the joint by its width: another joint needs another
    tracker. The first reading is searched with `HULL_GROOVE_SETTINGS`; the noise is learned from
    then on.
    """

    def __init__(self) -> None:
        self._noise = HULL_GROOVE_SETTINGS.noise
        self._inflation = 1.0
        self._lines: EdgeLines | None = None
        self._angles = np.zeros(2)
        self._width = 0.0
        self._repeats = ProfileRepeats()
        self._reading: ButtJointReading | None = None
        self._lost = 0
        self._depths: deque[float] = deque(maxlen=DEPTHS_KEPT)
        self._count = 0

    @property
    def noise(self) -> float:
        """Standard deviation of z as learned so far, in metres."""
        return self._noise

    def read(self, profile: Profile, reference: ReferenceProfile | None = None) -> ButtJointReading:
        """Read the joint's centre.

        Parameters
        ----------
        profile : Profile
            With x_s to the vehicle's right.
        reference : ReferenceProfile, optional
            What the joint looked like here before, for use if the edges are gone.

        Raises
        ------
        GrooveNotFound
            If there are too few points, the profile came before, or the joint is not to be seen.
        """
        if self._repeats.is_repeat(profile):
            raise GrooveNotFound(
                "frozen", "the profile came before, to the last bit: is the sensor still measuring?"
            )
        row = _ProfileRays(profile, HULL_GROOVE_SETTINGS.minimum_points)
        try:
            self._reading = self._read_from_last(row, reference)
        except GrooveNotFound:
            self._lost += 1
            if self._lines is not None and self._lost % REFUSALS_BEFORE_SEARCH:
                raise
            start = _edge_lines_of_fit(
                fit_groove(profile, HULL_GROOVE_SETTINGS).fitted, self._noise
            )
            self._reading = self._read_edges(row, start, known=False)
        self._lost = 0
        return self._reading

    def _read_from_last(
        self, row: _ProfileRays, reference: ReferenceProfile | None
    ) -> ButtJointReading:
        """Read from where the joint was last: by its edges, or else by the reference."""
        try:
            return self._read_last_edges(row, reference)
        except GrooveNotFound:
            if reference is None or self._reading is None:
                raise
            return self._read_by_reference(row, reference, self._reading)

    def _read_last_edges(
        self, row: _ProfileRays, reference: ReferenceProfile | None
    ) -> ButtJointReading:
        """Read by the edges, from where they were; the bevels may have got longer or shorter."""
        if self._lines is None:
            raise GrooveNotFound("no bevel", "no joint has been found so far", row.points)
        edges, root = self._lines.edges, self._lines.root
        ends = (self._lines.feet, np.full(2, root), edges + SHORT_BEVEL_SHARE * (root - edges))
        for feet in ends if reference is None else ends[:1]:
            try:
                return self._read_edges(row, replace(self._lines, feet=feet), reference)
            except GrooveNotFound as error:
                refused = error
        raise refused

    def _read_edges(
        self,
        row: _ProfileRays,
        start: EdgeLines,
        reference: ReferenceProfile | None = None,
        *,
        known: bool = True,
    ) -> ButtJointReading:
        last = self._reading if known else None
        angles = None if last is None else self._angles - last.roll
        lines = edge_lines.fit_joint_lines(row.t, row.z, replace(start, noise=self._noise), angles)
        if lines is None:
            raise row.ambiguity("the lines of the last profile are gone")
        edges = lines.points
        width = float(np.hypot(*(edges[1] - edges[0])))
        self._check_lines(row, lines, width, nan if reference is None else reference.width)
        covariances = self._inflation * lines.point_covariances
        sigma = 0.5 * sqrt(float(covariances[:, 0, 0].sum()))
        row.refuse_unsure(sigma, HULL_GROOVE_SETTINGS.largest_sigma)
        depth, area = _depth_and_area_left_to_fill(row, lines)
        if not known:
            if depth < LEAST_DEPTH:
                raise GrooveNotFound(
                    "no bevel",
                    f"what is found is {1e3 * depth:.1f} mm deep: too little to be sure of it "
                    "without having seen it before",
                    row.points,
                )
            self._depths.clear()
            self._count = 0
        self._learn_from(row, lines, width, known=known)
        self._lines = lines
        return ButtJointReading(
            time=row.time,
            centre=float(edges[:, 0].mean()),
            centre_sigma=sigma,
            hull_z=float(edges[:, 1].mean()),
            roll=-float(lines.angles[PLATE_LINES].mean()),
            edges=edges,
            edge_covariances=covariances,
            depth_left=depth,
            area_left=area,
            conditions=self._conditions_at(depth),
        )

    def _read_by_reference(
        self, row: _ProfileRays, reference: ReferenceProfile, last: ButtJointReading
    ) -> ButtJointReading:
        found = registration.register_profile(row.t, row.z, reference, last, self._noise)
        if found is None or found[1] < LEAST_SHARE_ON_REFERENCE:
            raise row.ambiguity("the profile does not look like the last one taken here")
        placement, _ = found
        noise = placement.centre_sigma**2 - placement.shared_sigma**2
        sigma = sqrt(self._inflation * noise + placement.shared_sigma**2)
        row.refuse_unsure(sigma, LARGEST_REGISTERED_SIGMA)
        room = FARTHEST_SIGMAS * hypot(sigma, last.centre_sigma)
        room += FARTHEST_SIDEWAYS * (self._lost + 1)
        if abs(placement.centre - last.centre) > room:
            raise row.ambiguity("on the last profile taken here the joint would have jumped")
        if self._lines is not None:
            self._lines = self._lines.moved(
                placement.roll - last.roll,
                np.array((last.centre, last.hull_z)),
                np.array((placement.centre, placement.hull_z)),
            )
        u, h = placement.joint_coordinates(row.x, row.z)
        inside = np.abs(u) < self._width / 2
        across, depth = _smoothed_bottom(u[inside], h[inside])
        middle = depth[np.abs(across) < self._width / 4]
        left = float(np.median(middle)) if len(middle) else nan
        area = float(np.trapezoid(np.maximum(depth, 0.0), across))
        return ButtJointReading(
            **asdict(replace(placement, centre_sigma=sigma)),
            time=row.time,
            edges=np.full((2, 2), np.nan),
            edge_covariances=np.full((2, 2, 2), np.nan),
            depth_left=left,
            area_left=area,
            conditions=(*((FILLED_GROOVE,) if left < FILLED_DEPTH else ()), REGISTERED_JOINT),
        )

    def _check_lines(
        self, row: _ProfileRays, lines: EdgeLines, width: float, before: float
    ) -> None:
        """Refuse lines that are not a joint's edges, which were so far apart here before."""
        left, left_bevel, right_bevel, right = lines.angles.tolist()
        least_turn, most_turn = BEVEL_TURNS
        refusals = {
            "too little of a plate is seen": lines.counts[PLATE_LINES].min() < FEWEST_ON_PLATE,
            "too little of a bevel is left": lines.counts[BEVEL_LINES].min() < FEWEST_ON_BEVEL,
            "the points are not on the plates": lines.shares[PLATE_LINES].min()
            < LEAST_SHARE_ON_PLATE,
            "the left bevel does not lead down": not least_turn < left_bevel - left < most_turn,
            "the right bevel does not lead down": not least_turn < right - right_bevel < most_turn,
            "the plates are at an angle": abs(left - right) > LARGEST_ANGLE_BETWEEN_PLATES,
            "the width has jumped": abs(width - (self._width or width))
            > LARGEST_JOINT_WIDTH_CHANGE,
            "the joint has widened": width > before + LARGEST_WIDENING,
        }
        for why, refused in refusals.items():
            if refused:
                raise row.ambiguity(why)

    def _learn_from(
        self, row: _ProfileRays, lines: EdgeLines, width: float, *, known: bool
    ) -> None:
        """Learn noise, width and the bevels' angles against the hull."""
        share = WEIGHT_OF_NEW_PROFILE if known else 1.0
        first, last = np.searchsorted(row.t, lines.edges).tolist()
        sides = slice(None, first), slice(last, None)
        residuals = np.concatenate(
            [
                row.z[own] - lines.heights(line, row.t[own])
                for line, own in zip(PLATE_LINES, sides, strict=True)
            ]
        )
        columns = np.concatenate([row.columns[own] for own in sides])
        on = np.abs(residuals) < 3 * self._noise
        if np.count_nonzero(on) > FEWEST_ON_PLATE:
            # Three standard deviations leave out a bit of the variance, four coefficients more.
            left = 0.973 * (1 - 4 / np.count_nonzero(on))
            noise = sqrt(float(np.mean(residuals[on] ** 2)) / left)
            self._noise += WEIGHT_OF_NEW_PROFILE * (noise - self._noise)
            if self._count % PROFILES_PER_CORRELATION == 0:
                order = np.argsort(columns[on])
                inflation = estimate_variance_inflation(
                    residuals[on][order] / noise, columns[on][order], row.count, 4
                )
                self._inflation += WEIGHT_OF_NEW_PROFILE * (inflation - self._inflation)
        self._width += share * (width - self._width)
        angles = lines.angles
        against = angles[BEVEL_LINES] - angles[PLATE_LINES].mean()
        self._angles = self._angles + share * (against - self._angles)

    def _conditions_at(self, depth: float) -> tuple[str, ...]:
        if self._count % DEPTH_EVERY == 0:
            self._depths.append(depth)
        self._count += 1
        if depth < FILLED_DEPTH:
            return (FILLED_GROOVE,)
        return (TACK_WELD,) if depth < median(self._depths) - BURIED_HEIGHT else ()


class _ProfileRays:
    """A profile's points in the order of their rays."""

    def __init__(self, profile: Profile, fewest: int) -> None:
        valid = profile.valid & (profile.z_s > 0)
        columns = np.flatnonzero(valid)
        x, z = profile.x_s[columns], profile.z_s[columns]
        if len(columns) < fewest:
            raise GrooveNotFound(
                "too few points",
                f"{len(columns)} of {len(profile)} columns hold a point, {fewest} are needed",
                np.column_stack((x, z)),
            )
        t = x / z
        order = np.argsort(t, kind="stable")
        self.t, self.x, self.z = t[order], x[order], z[order]
        self.columns, self.count, self.time = columns[order], len(profile), profile.time

    @property
    def points(self) -> Array:
        """Places (x, z), shape (n, 2)."""
        return np.column_stack((self.x, self.z))

    def refuse_unsure(self, sigma: float, largest: float) -> None:
        """Refuse a centre that is too uncertain."""
        if sigma > largest:
            raise self.ambiguity(f"its centre is known to {1e3 * sigma:.2f} mm only")

    def ambiguity(self, why: str) -> GrooveNotFound:
        """The error of points that do not show one joint."""
        return GrooveNotFound("ambiguous", why, self.points)


def _edge_lines_of_fit(fitted: FittedProfile, noise: float) -> EdgeLines:
    """The four lines of a fit, whose sides run from high x to low x."""
    curves, corners, places = fitted.curves, fitted.corners, fitted.places
    right, left = corners[0], corners[-1]
    lines = [
        edge_lines.line_through(left, left + curves[-1].tangent_at(places[-1][1])),
        edge_lines.line_through(left, left + curves[-2].tangent_at(places[-1][0])),
        edge_lines.line_through(right, right + curves[1].tangent_at(places[0][1])),
        edge_lines.line_through(right, right + curves[0].tangent_at(places[0][0])),
    ]
    (x, z), (u, w) = np.transpose((left, right)), np.transpose((corners[-2], corners[1]))
    return EdgeLines(
        lines=np.array(lines),
        covariances=np.zeros((4, 2, 2)),
        edges=x / z,
        feet=u / w,
        counts=np.zeros(4),
        shares=np.zeros(4),
        noise=noise,
        background=0.1,
    )


def _depth_and_area_left_to_fill(row: _ProfileRays, lines: EdgeLines) -> tuple[float, float]:
    """Depth and area below the line between the top edges."""
    first, last = np.searchsorted(row.t, lines.feet).tolist()
    (x0, z0), (x1, z1) = lines.points.tolist()
    inner, bottom = _smoothed_bottom(row.t[first:last], row.z[first:last])
    ends = [lines.heights(line, lines.feet[k]) for k, line in enumerate(BEVEL_LINES)]
    t = np.concatenate((lines.edges[:1], lines.feet[:1], inner, lines.feet[1:], lines.edges[1:]))
    z = np.concatenate(([z0, float(ends[0])], bottom, [float(ends[1]), z1]))
    x = t * z
    width = float(np.hypot(x1 - x0, z1 - z0))
    depth = ((x1 - x0) * (z - z0) - (z1 - z0) * (x - x0)) / width
    along = ((x1 - x0) * (x - x0) + (z1 - z0) * (z - z0)) / width
    middle = depth[2:-2] if len(inner) else depth[1:-1]
    return float(np.median(middle)), float(np.trapezoid(np.maximum(depth, 0.0), along))


def _smoothed_bottom(t: Array, z: Array) -> tuple[Array, Array]:
    """The points of a groove's bottom, without arc light, and their smoothed heights."""
    near = np.abs(z - _running_median(z, WIDE_MEDIAN)) < STRAY_HEIGHT
    return t[near], _running_median(z[near], NARROW_MEDIAN)


def _running_median(values: Array, count: int) -> Array:
    """Running median over `count` values, an odd number; fewer if there are no more."""
    count = min(count, len(values) - 1 + len(values) % 2)
    if count < 2:
        return values
    return np.asarray(scipy.ndimage.median_filter(values, count, mode="mirror"))
