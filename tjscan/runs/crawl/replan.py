"""Plan each pass of a crawl from what the laser showed on the way back from the last one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, CrawlStopped, LookRefused
from tjscan.core.frames import Array, stretches_of_true_values
from tjscan.core.robust import mad_sigma
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.crawler.joint_tracking.tracking import ButtJointReading
from tjscan.crawler.journal import PROFILE_SPACING, CrawlCycle, PlannedPass
from tjscan.crawler.phases import Phase
from tjscan.crawler.plan import PassSettings, with_rows
from tjscan.job.crawl.job import CrawlJob
from tjscan.laser.profile import Profile
from tjscan.planning.wps import WeldingProcedure
from tjscan.recording.journal import RunEvent
from tjscan.runs.weld.journal import SURFACE_EVENT
from tjscan.welding.look import (
    LEAST_SEEN_SHARE,
    SurfaceLook,
    columns_over,
    heights_over_columns,
    look_of_heights,
)
from tjscan.welding.replan import BeadOrder, NextBead, WeldPlanner
from tjscan.welding.state import WeldState
from tjscan.welding.target import surface_in_words

LOOKING_PHASES: Final = (Phase.FORWARD_ALIGNMENT, Phase.BACKWARD_ALIGNMENT, Phase.RETURN)
"""The arc is out, and the vehicle goes along the joint."""

STATION_STEP, POOLED_LENGTH, END_LENGTH = 5e-3, 4e-3, 5e-3
"""Between two stations, and to either side of one whose profiles count; and from either end of the
weld to the first: what start and crater leave unfilled there no further bead fills. Metres."""

FEWEST_PROFILES: Final = 3
"""Profiles that show a station: the median of fewer has the arc's glow or spatter in it."""

PLATE_MARGIN: Final = 8e-3
"""Of the plates beside the joint that a look shows, metres."""

MOST_BEHIND: Final = 15e-3
"""Metres by which the torch may be behind where tracks have it: 3 % of the half metre that the
laser is ahead."""

LOOKED_BEYOND: Final = MOST_BEHIND + 5e-3
"""Metres beyond either end of the weld that are looked at: profiles farther on than a bead may end,
of which some may not be read."""

BEAD_END_REACH: Final = 3e-3
"""Metres to either side of where beads end within which nothing is read: how well that is known,
and how long an end is."""

EDGE_POOLING, EDGE_SIGMA = 6e-3, 0.05e-3
"""To either side of a station over which its edges are the median of those read, and how well the
centre between these must be known, as a standard deviation; metres."""


Seen = tuple[float, Profile, JointPlacement]
"""Where along the joint by the tracks a profile was taken, metres, and the joint's place in it."""


@dataclass(eq=False)
class CrawlPassPlanner:
    """A `PassPlanner` by the bead model.

    Parameters
    ----------
    job : CrawlJob
        With layers.
    wps : WeldingProcedure

    Attributes
    ----------
    planner : WeldPlanner or None
        None until the bare joint was seen.
    tell : callable
        Receives each pass that was planned: a simulated world has to know its wire feed.
    """

    job: CrawlJob
    wps: WeldingProcedure
    planner: WeldPlanner | None = None
    tell: Callable[[PassSettings], None] = lambda planned: None
    s: Array = field(init=False)
    _toes_u: Array = field(init=False, repr=False)
    _closed: Array = field(init=False, repr=False)
    _bead: NextBead | None = None
    _last: float = np.inf
    _seen: list[Seen] = field(default_factory=list)
    _bare: list[Seen] = field(default_factory=list)
    _behind: float | None = None

    def __post_init__(self) -> None:
        length = self.job.weld.length
        begin, end = END_LENGTH, length - END_LENGTH
        self.s = np.linspace(begin, end, 1 + max(2, ceil((end - begin) / STATION_STEP)))
        self._closed = np.zeros(len(self.s))

    def see(self, cycle: CrawlCycle, placement: JointPlacement) -> None:
        """Take in a cycle's profile; see `JointLook.see`."""
        if cycle.arc:  # what was seen before lies below its bead
            self._seen.clear()
        at = cycle.travel + self.job.vehicle.laser_to_torch
        near = -LOOKED_BEYOND <= at <= self.job.weld.length + LOOKED_BEYOND
        looks = cycle.phase in LOOKING_PHASES and near
        if cycle.profile is None or not looks or abs(at - self._last) < 0.9 * PROFILE_SPACING:
            return
        self._last = at
        self._seen.append((at, cycle.profile, placement))

    def middle_moved(self, at: float) -> float:
        """See `JointLook.middle_moved`; the planner's groove closes from the left (assumption)."""
        s = np.concatenate((self.s[:1] - EDGE_POOLING, self.s, self.s[-1:] + EDGE_POOLING))
        return float(np.interp(self._place(at), s, np.pad(self._closed, 1))) / 2

    def at_bead_end(self, at: float) -> bool:
        """See `JointLook.at_bead_end`: of the first bead alone, both edges are seen beside it."""
        off = min(abs(self._place(at)), abs(self._place(at) - self.job.weld.length))
        return self.planner is not None and self.planner.done > 0 and off < BEAD_END_REACH

    def _place(self, at: float) -> float:
        """Where along the weld the torch comes to what the laser sees at a place, metres."""
        return at + (self._behind or 0.0)

    def unread_stretch(self) -> float:
        """See `PassPlanner.unread_stretch`."""
        places = np.sort([self._place(at) for at, _, _ in self._seen])
        near = [np.searchsorted(places, self.s + side) for side in (-POOLED_LENGTH, POOLED_LENGTH)]
        unread = near[1] - near[0] < FEWEST_PROFILES
        if not unread.all():
            seen = self._seen
            unread |= ~self._look(seen).read if self._take_edges(seen) else True
        middles = 0.5 * (self.s[1:] + self.s[:-1])
        borders = np.concatenate(([0.0], middles, [self.job.weld.length]))
        begin, end = stretches_of_true_values(unread)
        return float(np.max(borders[end] - borders[begin], initial=0.0))

    def take_look(self, laid: int) -> tuple[WeldPlanner, SurfaceLook]:
        """Take in what was seen since the last pass, of which so many are laid.

        Raises
        ------
        LookRefused, CrawlStopped
            As `PassPlanner.plan_pass`; or if nothing shows the bare joint.
        """
        bead, planner = self._bead, self.planner
        if planner is None:
            self._bare = self._seen
            planner, look = self._see_bare_joint()
        else:
            if bead is not None and bead.number < laid:
                if bead.number == 0:
                    self._behind = self._distance_behind()
                    planner, _ = self._see_bare_joint()
                ends = 0.0, self.job.weld.length
                area = planner.area_of_arc(bead.s, ends, bead.feed, bead.speed)
                planner.after_bead(bead, area)
            self._take_edges(self._seen)
            look = self._look(self._seen)
            u = np.tile(look.u, (len(self.s), 1))
            planner.take_look(u, look.w, look.sigma, look.read)
        self._seen = []
        return planner, look

    def plan_pass(self, number: int) -> PlannedPass:
        """Plan a pass; see `PassPlanner.plan_pass`."""
        planner, look = self.take_look(number - 1)
        if planner.done != number - 1:
            raise ConfigurationError(
                f"pass {number} can't be planned: of the passes before it {planner.done} "
                "were planned from looks",
                key="weld.layers",
            )
        bead = planner.for_arc(planner.next_bead(), 0.0, self.job.weld.length)
        self._check_reach(bead)
        self._bead = bead.at(self.s)
        planned = self._planned(planner, bead, float(np.mean(~look.read)))
        self.tell(with_rows(self.job.passes[number - 1], planned.table))
        return planned

    def finish(self, laid: int) -> RunEvent:
        """See `PassPlanner.finish`."""
        try:
            planner, look = self.take_look(laid)
        except LookRefused as error:
            return RunEvent(SURFACE_EVENT, str(error))
        state = planner.belief.part(look.read)
        text = surface_in_words(state, planner.order.cap_height, float(self.s[1] - self.s[0]))
        return RunEvent(SURFACE_EVENT, text)

    def replay(
        self,
        numbers: Sequence[int],
        readings: Iterable[tuple[CrawlCycle, JointPlacement | None]],
    ) -> None:
        """Take in what an interrupted crawl saw, and plan again what it planned and began.

        It began a pass where an arc was let burn, whether or not the joint was read there.
        """
        for cycle, reading in readings:
            done = 0 if self._bead is None else self._bead.number + 1
            if cycle.arc and cycle.number in numbers and cycle.number > done:
                self.plan_pass(cycle.number)
            if reading is not None:
                self.see(cycle, reading)

    def _see_bare_joint(self) -> tuple[WeldPlanner, SurfaceLook]:
        """Begin to plan with what was seen before the first bead."""
        self.planner, self._closed = None, np.zeros(len(self.s))
        if not self._take_edges(self._bare):
            raise CrawlStopped("not seen", "the joint's edges were not read along the weld")
        look = self._look(self._bare)
        if not (read := look.read).any():
            raise LookRefused("nothing read", "no profile shows the groove between its edges")
        # Between the sections that were read: what shows only the plates is no groove.
        w = [np.interp(self.s, self.s[read], column[read]) for column in look.w.T]
        tilt = np.full(len(self.s), self.job.weld.tilt)
        belief = WeldState.of_groove(self.s, look.u, np.transpose(w), self._toes_u, tilt)
        self.planner = WeldPlanner(belief, bead_order(self.job, self.wps), self.wps)
        return self.planner, look

    def _distance_behind(self) -> float | None:
        """How far behind the place that tracks show the torch laid the first bead, metres.

        Tracks slip between where the laser sees a place and where the torch comes to it. Where the
        bead ends shows by how much, to a millimetre; the laser need not come to where it begins.
        None if nothing was seen beyond it.
        """
        end = self.job.weld.length
        x = np.arange(0.0, end + MOST_BEHIND, PROFILE_SPACING)
        grown = self._metal_along(self._seen, x) - self._metal_along(self._bare, x)
        if not np.isfinite(grown[-1]):
            return None
        welded = grown > np.nanmedian(grown[x < end]) / 2
        # Most places before the end are welded, and most beyond it are not, whatever spatters.
        behind = end - PROFILE_SPACING - float(x[np.where(welded, 1, -1).cumsum().argmax()])
        if abs(behind) > MOST_BEHIND - 2 * PROFILE_SPACING:
            raise CrawlStopped(
                "bead misplaced",
                f"the first bead ends {1e3 * abs(behind):.0f} mm "
                f"{'before' if behind > 0 else 'beyond'} where the tracks had the torch: look at "
                "vehicle.laser_to_torch_mm, and whether tracks slip or their sprockets' radius is "
                "wrong",
            )
        return behind

    def _metal_along(self, seen: Sequence[Seen], x: Array) -> Array:
        """Section over the root between the toes at places, (n,), m²; NaN beyond those seen."""
        u = columns_over(self._toes_u, 0.0)
        rows = sorted(
            (at, float(np.interp(u, u[known], row[known]).sum()) * (u[1] - u[0]))
            for (at, _, _), row in zip(seen, self._heights(seen, u), strict=True)
            if np.mean(known := np.isfinite(row)) > LEAST_SEEN_SHARE
        )
        at, area = np.reshape(rows, (-1, 2)).T
        return np.interp(x, at, area, np.nan, np.nan) if len(at) else np.full(len(x), np.nan)

    def _take_edges(self, seen: Sequence[Seen]) -> bool:
        """Take where the edges are now; False if they were not read while the joint was bare."""
        edges = self._edges_along_weld(seen)
        if self.planner is None:
            if not np.isfinite(edges).any():
                return False
            self._toes_u = np.where(np.isfinite(edges), edges, np.nanmedian(edges, axis=0))
        closed = np.diff(self._toes_u - edges, axis=1)[:, 0]
        self._closed = np.where(np.isfinite(closed), closed, self._closed)
        return True

    def _edges_along_weld(self, seen: Sequence[Seen]) -> Array:
        """Top edges at the stations, shape (n, 2), from the joint's centre; NaN where not read."""
        rows = [
            (self._place(at), *placement.joint_coordinates(*placement.edges.T)[0])
            for at, _, placement in seen
            if isinstance(placement, ButtJointReading)
            and np.isfinite(placement.edges).all()
            and placement.centre_sigma < EDGE_SIGMA
        ]
        at, *edges = np.reshape(rows, (-1, 3)).T
        near = np.abs(at - self.s[:, None]) < EDGE_POOLING
        pooled = [
            [np.median(edge[row]) if row.sum() >= FEWEST_PROFILES else np.nan for edge in edges]
            for row in near
        ]
        return np.array(pooled)

    def _heights(self, seen: Sequence[Seen], u: Array) -> Array:
        """Heights of profiles at columns of the bare joint, (p, k), metres; NaN where not seen."""
        heights = np.empty((len(seen), len(u)))
        for row, (at, profile, placement) in zip(heights, seen, strict=True):
            steel = profile.x_s[profile.valid], profile.z_s[profile.valid]
            across, into = placement.joint_coordinates(*steel)
            row[:] = heights_over_columns(across, (-into,), u - self.middle_moved(at))[0]
        return heights

    def _look(self, seen: Sequence[Seen]) -> SurfaceLook:
        toes = self._toes_u
        u = columns_over(toes, PLATE_MARGIN)
        heights = self._heights(seen, u)
        places = np.tile([[self._place(at)] for at, _, _ in seen], (1, len(u)))
        steps = np.diff(heights, axis=1)
        noise = np.full_like(heights, mad_sigma(steps[np.isfinite(steps)]) / np.sqrt(2))
        return look_of_heights(self.s, (places, heights, noise), u, toes, POOLED_LENGTH)

    def _check_reach(self, bead: NextBead) -> None:
        reach = self.job.torch.reach - abs(self.job.torch.aside)
        farthest = float((np.abs(bead.tip[:, 0]) + 0.5 * bead.weave).max())
        if farthest > reach:
            raise CrawlStopped(
                "torch reach",
                f"pass {bead.number + 1} would have the torch {1e3 * farthest:.1f} mm beside the "
                f"joint, and its axis reaches {1e3 * reach:g} mm",
            )

    def _planned(self, planner: WeldPlanner, bead: NextBead, unread: float) -> PlannedPass:
        learner, deviation = planner.learner, planner.deviation
        s = np.concatenate(([0.0], self.s, [self.job.weld.length]))
        rows = bead.at(s)
        offset, height = rows.tip.T
        return PlannedPass(
            bead.number + 1,
            unread,
            learner.gain.value,
            learner.offset.value,
            learner.shrinkage.value,
            None if deviation is None else deviation.value,
            None if deviation is None else deviation.sigma,
            s,
            rows.speed,
            offset,
            height,
            0.5 * rows.weave,
            rows.feed,
            np.interp(s, self.s, self._closed),
            at_limit=float(bead.is_at_limit.mean()),
            behind=self._behind,
        )


def bead_order(job: CrawlJob, wps: WeldingProcedure) -> BeadOrder:
    """Beads of a job's passes: each keeps the wire feed and the weave that the job states."""
    tables = [one.table for one in job.passes]
    return BeadOrder(
        counts=job.weld.layers,
        feeds=tuple(float(table.feed.mean()) for table in tables),
        weaves=tuple(2 * float(table.weave.mean()) for table in tables),
        cap_height=wps.bead.cap_height,
    )
