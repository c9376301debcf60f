"""The metal of a simulated crawl: beads lie where the torch truly was, and the laser sees them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tjscan.core.frames import Array
from tjscan.crawler.plan import PassSettings
from tjscan.job.crawl.job import SimulatedWeldSettings
from tjscan.joint.hull import HALF_PLATE_WIDTH, HullJoint, hull_section
from tjscan.welding.state import WeldState
from tjscan.welding.world import TorchTrace, WeldWorld

STATION_STEP, COLUMN_STEP = 2e-3, 0.25e-3
"""Between stations along the joint, and between columns across it, metres."""

LENGTH_BEFORE: Final = 20e-3
"""Metres of the joint before its start where beads may lie: of a torch that is behind."""

PLATE_REACH: Final = 15e-3
"""Metres of either plate that a bead may reach."""

HELD_LENGTH: Final = 60e-3
"""Over which the plates beyond a weld's ends hold the joint open there, metres: an assumption."""

LEAST_TRAVEL_SPEED: Final = 0.2e-3
"""A torch that hardly moves still gets its bead, metres a second."""

WELD_RANDOM_STREAM: Final = 3
"""Keeps the random numbers of the weld apart from the laser's and the vehicle's."""


@dataclass(slots=True)
class CrawlWeld:
    """The weld of a simulated joint, and the arc that burns.

    Parameters
    ----------
    joint : HullJoint
    settings : SimulatedWeldSettings
    seed : int
    """

    joint: HullJoint
    settings: SimulatedWeldSettings
    seed: int
    metal: WeldWorld = field(init=False)
    _samples: list[tuple[float, float, float]] = field(default_factory=list)
    _arcs: int = 0

    def __post_init__(self) -> None:
        joint, settings = self.joint, self.settings
        s = np.arange(-LENGTH_BEFORE, joint.length + STATION_STEP / 2, STATION_STEP)
        half = joint.width / 2 + PLATE_REACH
        u = np.arange(-half, half, COLUMN_STEP)
        # Without backing, the gap's bottom is where its root is.
        w = np.array([np.interp(u, *hull_section(joint, float(at)).T) for at in s])
        w = np.maximum(w, -joint.depth - abs(joint.high_low) / 2)
        toes = np.tile((-joint.width / 2, joint.width / 2), (len(s), 1))
        state = WeldState.of_groove(s, u, w, toes, np.full(len(s), settings.tilt))
        rng = np.random.default_rng([self.seed, WELD_RANDOM_STREAM])
        self.metal = WeldWorld(
            state,
            settings.wire_diameter,
            settings.efficiency,
            rng,
            faults=settings,
            held_length=HELD_LENGTH,
        )

    def burn(self, time: float, along: float, right: float) -> None:
        """Note where the torch truly is while its arc burns.

        Parameters
        ----------
        time : float
            Seconds.
        along, right : float
            Place on the joint, and to the right of it, metres.
        """
        if not self._samples or along > self._samples[-1][1]:
            self._samples.append((time, along, right))

    def end_arc(self, one: PassSettings) -> None:
        """Lay the bead of the arc that went out.

        Parameters
        ----------
        one : PassSettings
            Of the pass that it welded.
        """
        if len(self._samples) >= 2:
            time, s, right = np.array(self._samples).T
            swing = one.weave_period / max(float(np.median(np.diff(time))), 1e-6)
            middle = gaussian_filter1d(right, max(swing / 4, 1e-3), mode="nearest")
            smooth = max(swing / 4, 1.0)
            speed = gaussian_filter1d(np.gradient(s, time), smooth, mode="nearest")
            self._lay(one, s, middle, np.maximum(speed, LEAST_TRAVEL_SPEED))
        self._samples.clear()

    def _lay(self, one: PassSettings, s: Array, right: Array, speed: Array) -> None:
        """Lay a bead along a way of the torch, shape (k,): metres and m/s."""
        rows = one.table.at(s)
        feed = np.where(np.isfinite(rows.feed), rows.feed, self.settings.wire_feed)
        heat = self.settings.heat_power / speed
        weave = 2 * rows.weave
        if one.edge_gap is not None:
            state = self.metal.state
            opening = np.diff(state.toe_points[:, :, 0], axis=1)[:, 0]
            weave = np.maximum(np.interp(s, state.s, opening) - 2 * one.edge_gap, 0.0)
        # Of each arc by its number: those of an interrupted run are laid again as they were.
        self.metal.rng = np.random.default_rng([self.seed, WELD_RANDOM_STREAM, self._arcs])
        self._arcs += 1
        self.metal.weld(TorchTrace(s, right, speed, feed, heat, weave))

    def outline(self, along: float) -> Array:
        """Steel at a place, from plate to plate, shape (n, 2): across and height, metres."""
        section = self.metal.state.outline(along)
        ends = (-HALF_PLATE_WIDTH, section[0, 1]), (HALF_PLATE_WIDTH, section[-1, 1])
        return np.vstack((ends[:1], section, ends[1:]))
