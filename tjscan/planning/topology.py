"""How many beads in how many layers: one arrangement for a whole length of groove.

Counting beads afresh in every section would let beads start and stop along the groove. So the
count stays, each bead has a constant share of the section's area, and the travel speed follows the
area, with a wire feed that is constant for each kind of bead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.planning.edges import RootKind
from tjscan.planning.path import BeadLines, GrooveStations
from tjscan.planning.template import SectionTemplate
from tjscan.planning.wps import ArcSettings, RootSettings, WeldingProcedure

MOST_BEADS_IN_SECTION: Final = 400
"""More in one section are no weld of a tubular joint."""

LIMIT_TOLERANCE: Final = 1e-9
"""Share of a limit by which a number may pass it: all are computed, none is measured."""

BEAD_KIND_NAMES: Final = ("root", "fill", "cap")

AREA_TOLERANCE_BETWEEN_STATIONS: Final = 2e-3
"""Share by which a bead's area may pass, between two stations, what it is at the stations."""

TRIED_FEED_COUNT: Final = 101
"""Number of wire feeds that are tried, evenly over their window."""

WPS_KEYS_IN_CHECK_ORDER: Final = (
    "cap_height_mm",
    "root",
    "cap",
    "fill",
    "layer_height_mm",
    "wire_feed_m_min",
    "travel_speed_mm_min",
)
"""Keys of the WPS, without their tables, in the order in which an arrangement is checked."""

Window = tuple[float, float]


class NoArrangementFits(ConfigurationError):
    """No arrangement of beads fits some sections; its key is of the WPS."""


@dataclass(frozen=True, slots=True)
class BeadKind:
    """What beads of one kind (root, fill or cap) have in common.

    Parameters
    ----------
    share : float
        Of a bead in the section's area, reinforcement included.
    feed : float
        Wire feed, m/s.
    heat_fits : bool
        Whether the heat input stays in its window everywhere.
    """

    share: float
    feed: float
    heat_fits: bool


@dataclass(frozen=True, slots=True)
class Arrangement:
    """Layers, beads, and how each kind of bead is welded.

    Parameters
    ----------
    counts : tuple of int
        Beads in each layer, from the lowest on.
    root_kind : str
        What is at the root; where passes are welded already, there is no root bead.
    root, fill, cap : BeadKind
        Of the root bead, which is the first layer, of the last layer, and of those between.
    """

    counts: tuple[int, ...]
    root_kind: RootKind
    root: BeadKind
    fill: BeadKind
    cap: BeadKind

    @property
    def kinds(self) -> tuple[BeadKind, ...]:
        """Kind of every bead, layer by layer, from the bevel to the leg."""
        return tuple(getattr(self, name) for name in self.kind_names)

    @property
    def kind_names(self) -> tuple[str, ...]:
        """Name of each bead's kind."""
        return bead_kinds(self.counts, self.root_kind)

    @property
    def shares(self) -> Array:
        """Share of each bead in the section's area, shape (n,); together one."""
        return np.array([kind.share for kind in self.kinds])

    @property
    def feeds(self) -> Array:
        """Wire feed of each bead, shape (n,), m/s."""
        return np.array([kind.feed for kind in self.kinds])


def bead_kinds(counts: tuple[int, ...], root: RootKind) -> tuple[str, ...]:
    """Name of the kind of every bead, layer by layer, of counts in layers over a root."""
    roots = int(root != "welded")
    return ("root",) * roots + ("fill",) * sum(counts[roots:-1]) + ("cap",) * counts[-1]


@dataclass(frozen=True)
class BeadArranger:
    """Chooses layers, beads and wire feeds that fit all of some sections.

    Parameters
    ----------
    template : SectionTemplate
        Sections square to the groove.
    stations : GrooveStations
        The same sections in space.
    wps : WeldingProcedure
        The windows.
    root : str
        What is at their root.
    """

    template: SectionTemplate
    stations: GrooveStations
    wps: WeldingProcedure
    root: RootKind

    def find_best_arrangement(self) -> Arrangement:
        """Find the best arrangement that fits.

        The one that comes nearest to the highest wire feeds of its beads, and so takes least time
        with the arc on; then the one with the fewest beads, then the fewest layers. If the heat
        input fits nowhere, the rest still does.

        Raises
        ------
        NoArrangementFits
            If no number of beads fits.
        """
        found: list[tuple[tuple[bool, float, int, int], Arrangement]] = []
        problems: list[NoArrangementFits] = []
        if self.root != "welded" and self._deposit_to_area_ratios:
            self._check_root_layer(self._deposit_to_area_ratios["root"])
        for n, group in self._layer_counts_by_beads.items():
            for counts in group:
                try:
                    one = self._arrange_bead_counts(counts)
                except NoArrangementFits as problem:
                    problems.append(problem)
                    continue
                heat = all(kind.heat_fits for kind in one.kinds)
                limits = [self._arc_limits(name)[1] for name in one.kind_names]
                highest = np.array([limit.wire_feed[1] for limit in limits])
                time = float(np.sum(one.shares * highest / one.feeds))
                found.append(((not heat, round(time, 9), n, len(counts)), one))
            if any(rank[:2] == (False, 1.0) for rank, _ in found):
                break  # no wire feed is higher, and more beads take no less time
        if found:
            return min(found, key=lambda item: item[0])[1]
        if problems:
            # The one that came nearest to a plan: what is checked last.
            keys = [str(one.key).split(".")[1].split("_area")[0] for one in problems]
            raise problems[int(np.argmax([WPS_KEYS_IN_CHECK_ORDER.index(key) for key in keys]))]
        low, high = (1e3 * height for height in self.wps.bead.layer_height)
        reason = f"no number of layers has heights of {low:g} to {high:g} mm"
        raise NoArrangementFits(reason, key="bead.layer_height_mm")

    def _area_window(self, kind: str) -> Window:
        window: Window = getattr(self.wps.bead, f"{kind}_area")
        return window

    def _arc_limits(self, kind: str) -> tuple[str, ArcSettings | RootSettings]:
        """Table, and its name, of the windows of a kind of bead."""
        return self.wps.limits_of_bead(open_root=kind == "root" and self.root == "open")

    @cached_property
    def _layer_counts_by_beads(self) -> dict[int, list[tuple[int, ...]]]:
        """Counts of the beads in layers, for each number of beads that may fit."""
        smallest, largest = float(self.template.area.min()), float(self.template.area.max())
        lows, highs = zip(*map(self._area_window, BEAD_KIND_NAMES), strict=True)
        low, high = min(lows), max(highs)
        first = max(1 if self.root == "welded" else 3, ceil(largest / high - 1e-9))
        last = min(MOST_BEADS_IN_SECTION, floor(smallest / low + 1e-9))
        if first > last:
            raise NoArrangementFits(
                f"no number of beads fits: {1e6 * smallest:.1f} to {1e6 * largest:.1f} mm² of "
                f"groove take {first} beads of {1e6 * high:g} mm² or more, and at most {last} of "
                f"{1e6 * low:g} mm²",
                key="bead.fill_area_mm2",
            )
        layers, corners = self._possible_layer_counts(), self.template.corners
        bottom = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).mean())
        widths = bottom, float(self.template.opening.mean())
        roots = (1,) if self.root != "welded" else ()
        return {n: _spread_over_layers(n, layers, widths, roots) for n in range(first, last + 1)}

    def _possible_layer_counts(self) -> range:
        """Numbers of layers whose mean height is in its window."""
        depth = self.template.layer_heights(
            self.template.layer_lines(np.empty((len(self.template.corners), 0)))
        )
        lowest, highest = self.wps.bead.layer_height
        fewest = ceil(float(depth.max()) / highest * (1 - LIMIT_TOLERANCE))
        most = floor(float(depth.min()) / lowest * (1 + LIMIT_TOLERANCE))
        return range(max(1 if self.root == "welded" else 2, fewest), most + 1)

    @cached_property
    def _deposit_to_area_ratios(self) -> dict[str, Window]:
        """Least and largest ratio of what is laid down, a metre of the tip's path, to its area.

        For each kind of bead, computed for beads of equal areas: the place of a bead in the section
        decides it. Empty if there is no way to arrange any.
        """
        ways = self._layer_counts_by_beads.values()
        counts = next((counts for group in ways for counts in group), None)
        if counts is None:
            return {}
        names = np.array(bead_kinds(counts, self.root))
        equal = np.repeat(self.template.area[:, None] / len(names), len(names), axis=1)
        try:
            cells = self.template.cut_into_beads(counts, equal)
        except ValueError:
            return dict.fromkeys(BEAD_KIND_NAMES, (1.0, 1.0))
        shares = BeadLines(self.stations, cells).areas / equal
        found = {name: shares[:, names == name] for name in BEAD_KIND_NAMES}
        return {
            name: (float(x.min()), float(x.max())) if x.size else (1.0, 1.0)
            for name, x in found.items()
        }

    def _check_root_layer(self, laid: Window) -> None:
        """Refuse a root that one bead can't span: the template lays one across all of it."""
        template, (low, high) = self.template, self.wps.bead.layer_height
        smallest, largest = self.wps.bead.root_area
        # The largest bead allowed at its thinnest, and the smallest at its thickest.
        for area, share, too in ((largest, laid[0], "wide"), (smallest, laid[1], "narrow")):
            inside = (area / share - template.root_area) / template.groove_area
            below = template.root_area + np.clip(inside, 1e-3, 0.999) * template.groove_area
            heights = template.layer_heights(template.layer_lines(below[:, None]))[:, 0]
            worst = int(np.argmin(heights) if too == "wide" else np.argmax(heights))
            height = float(heights[worst])
            if height < low if too == "wide" else height > high:
                p3, p4 = template.corners[worst, :2]
                raise NoArrangementFits(
                    f"a root of {1e3 * float(np.linalg.norm(p4 - p3)):.1f} mm is too {too} for the "
                    f"template, which lays one root bead across all of it: {1e6 * area:g} mm² would"
                    f" be {1e3 * height:.2f} mm high, and bead.layer_height_mm allows {1e3 * low:g}"
                    f" to {1e3 * high:g}",
                    key="bead.root_area_mm2",
                )

    def _arrange_bead_counts(self, counts: tuple[int, ...]) -> Arrangement:
        template, area = self.template, self.template.area
        names = np.array(bead_kinds(counts, self.root))
        shares = dict(zip(BEAD_KIND_NAMES, self._bead_share_by_kind(counts), strict=True))
        for name in dict.fromkeys(names.tolist()):  # before it is cut: what is to be expected
            ends, ratios = np.array((area.min(), area.max())), self._deposit_to_area_ratios[name]
            expected = shares[name] * ends * ratios
            self._choose_wire_feed(name, *expected.tolist())
        wanted = area[:, None] * np.array([shares[name] for name in names])
        below = wanted.cumsum(axis=1)[:, np.cumsum(counts)[:-1] - 1]
        try:
            heights = template.layer_heights(template.layer_lines(below))
        except ValueError as error:
            raise NoArrangementFits(str(error), key="bead.cap_height_mm") from None
        least, most = float(heights.min()), float(heights.max())
        low, high = self.wps.bead.layer_height
        if least < low * (1 - LIMIT_TOLERANCE) or most > high * (1 + LIMIT_TOLERANCE):
            raise NoArrangementFits(
                f"{sum(counts)} beads in {len(counts)} layers are {1e3 * least:.2f} to "
                f"{1e3 * most:.2f} mm high",
                key="bead.layer_height_mm",
            )
        laid = BeadLines(self.stations, template.cut_into_beads(counts, wanted)).areas
        kinds = {}
        for name in BEAD_KIND_NAMES:
            of_kind = laid[:, names == name] if name in names else laid
            low, high = self._area_window(name)
            least = float(of_kind.min() * (1 - AREA_TOLERANCE_BETWEEN_STATIONS))
            most = float(of_kind.max() * (1 + AREA_TOLERANCE_BETWEEN_STATIONS))
            if name in names and not low <= least <= most <= high:
                raise NoArrangementFits(
                    f"a {name} bead is {1e6 * least:.1f} to {1e6 * most:.1f} mm²",
                    key=f"bead.{name}_area_mm2",
                )
            kinds[name] = BeadKind(shares[name], *self._choose_wire_feed(name, least, most))
        return Arrangement(counts, self.root, **kinds)

    def _choose_wire_feed(self, kind: str, least: float, most: float) -> tuple[float, bool]:
        """Highest wire feed, m/s, at which speed and heat input stay in their windows.

        For beads of the least and the largest area, m²: the speed is deposition rate / area. If the
        heat input fits at no wire feed, which is the second value, the speed alone decides.
        """
        table, limits = self._arc_limits(kind)
        feeds = np.linspace(*limits.wire_feed, TRIED_FEED_COUNT)
        rate = self.wps.deposition_rate(feeds)
        slowest, fastest = rate / most, rate / least
        can = (slowest >= limits.travel_speed[0]) & (fastest <= limits.travel_speed[1])
        if not can.any():
            low, high = (
                f"{60e3 * slowest[i]:.0f} to {60e3 * fastest[i]:.0f} mm/min" for i in (0, -1)
            )
            raise NoArrangementFits(
                f"a {kind} bead of {1e6 * least:.1f} to {1e6 * most:.1f} mm² needs {low} at the "
                f"lowest wire feed and {high} at the highest",
                key=f"{table}.travel_speed_mm_min",
            )
        warmest, coldest = (self.wps.heat_input(feeds, speed) for speed in (slowest, fastest))
        warm = can & (coldest >= limits.heat_input[0]) & (warmest <= limits.heat_input[1])
        return float(feeds[warm if warm.any() else can].max()), bool(warm.any())

    def _nearest_allowed_share(self, kind: str, share: float) -> float:
        """The nearest share to one that keeps a bead's area in its window in every section."""
        low, high = self._area_window(kind)
        smallest, largest = float(self.template.area.min()), float(self.template.area.max())
        less, more = self._deposit_to_area_ratios[kind]
        lowest = low * (1 + 2 * AREA_TOLERANCE_BETWEEN_STATIONS) / (smallest * less)
        highest = high * (1 - 2 * AREA_TOLERANCE_BETWEEN_STATIONS) / (largest * more)
        if lowest > highest * (1 + 1e-12):
            raise NoArrangementFits(
                f"the groove's area changes by {largest / smallest:.2f} times, more than the "
                f"window of a {kind} bead",
                key=f"bead.{kind}_area_mm2",
            )
        return min(max(share, lowest), highest)

    def _bead_share_by_kind(self, counts: tuple[int, ...]) -> tuple[float, float, float]:
        """Shares of a root, a fill and a cap bead: equal, unless their windows part them.

        A kind without a bead has the share of another.
        """
        n, capped, roots = sum(counts), counts[-1], int(self.root != "welded")
        inner = n - roots - capped
        root = self._nearest_allowed_share("root", 1 / n) if roots else 0.0
        cap = self._nearest_allowed_share("cap", (1 - root) / (n - roots))
        if inner == 0:
            rest = (1 - root) / capped
            if abs(self._nearest_allowed_share("cap", rest) - rest) > 1e-12:
                reason = f"{n} beads are too large or too small"
                raise NoArrangementFits(reason, key="bead.cap_area_mm2")
            return root or rest, rest, rest
        fill = (1 - root - capped * cap) / inner
        if fill <= 0 or abs(self._nearest_allowed_share("fill", fill) - fill) > 1e-12:
            low, high = 1e6 * fill * self.template.area.min(), 1e6 * fill * self.template.area.max()
            raise NoArrangementFits(
                f"with {n} beads in {len(counts)} layers a fill bead has {low:.1f} to {high:.1f} "
                "mm²",
                key="bead.fill_area_mm2",
            )
        return root or fill, fill, cap


def _spread_over_layers(
    n: int, layers: Sequence[int], widths: Window, roots: tuple[int, ...]
) -> list[tuple[int, ...]]:
    """Counts of n beads in layers: the root bead, then by the layers' width at even heights."""
    bottom, top = widths
    rest, found = n - len(roots), []
    for count in layers:
        at = (np.arange(len(roots), count) + 0.5) / count
        width = bottom + at * (top - bottom)
        ideal = rest * width / width.sum()
        counts = np.maximum(1, np.floor(ideal).astype(int))
        for k in np.argsort(-(ideal - counts), kind="stable")[: max(0, rest - counts.sum())]:
            counts[k] += 1
        if counts.sum() == rest:
            found.append((*roots, *counts.tolist()))
    return found
