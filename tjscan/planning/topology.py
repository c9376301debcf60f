"""How many beads in how many layers: one arrangement for a whole length of groove.

Counting beads afresh in every section would let beads start and stop along the groove. So the
count stays, each bead has a constant share of the section's area, and the travel speed follows the
area, with a wire feed that is constant for each kind of bead.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.planning.path import GrooveStations, bead_lines
from tjscan.planning.root import RootKind
from tjscan.planning.template import SectionTemplate
from tjscan.planning.wire_feed import NoArrangementFits, choose_wire_feed
from tjscan.planning.wps import WeldingProcedure

MOST_BEADS: Final = 400
"""More in one section are no weld of a tubular joint."""

LIMIT_TOLERANCE: Final = 1e-9
"""Share of a limit by which a number may pass it: all are computed, none is measured."""

KIND_NAMES: Final = ("root", "fill", "cap")

BETWEEN_STATIONS: Final = 2e-3
"""Share by which a bead's area may pass, between two stations, what it is at the stations."""

Window = tuple[float, float]


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


def arrange_beads(
    template: SectionTemplate,
    stations: GrooveStations,
    wps: WeldingProcedure,
    root: RootKind = "closed",
) -> Arrangement:
    """Choose layers, beads and wire feeds that fit all of some sections.

    Of those that fit, the one that comes nearest to the highest wire feeds of its beads, and so
    takes least time with the arc on; then the one with the fewest beads, then the fewest layers.
    Where the heat input fits nowhere, the rest still does.

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

    Raises
    ------
    NoArrangementFits
        If no number of beads fits.
    """
    area = template.area
    smallest, largest = float(area.min()), float(area.max())
    beads = wps.bead
    low = min(beads.root_area[0], beads.fill_area[0], beads.cap_area[0])
    high = max(beads.root_area[1], beads.fill_area[1], beads.cap_area[1])
    first = max(1 if root == "welded" else 3, ceil(largest / high - 1e-9))
    last = min(MOST_BEADS, floor(smallest / low + 1e-9))
    if first > last:
        raise NoArrangementFits(
            f"no number of beads fits: {1e6 * smallest:.1f} to {1e6 * largest:.1f} mm² of groove "
            f"take {first} beads of {1e6 * high:g} mm² or more, and at most {last} of "
            f"{1e6 * low:g} mm²",
            key="bead.fill_area_mm2",
        )
    layers, widths = _layers(template, wps, root), _widths(template)
    found: list[tuple[tuple[bool, float, int, int], Arrangement]] = []
    problems: list[NoArrangementFits] = []
    ways = {n: _layer_counts(n, layers, widths, root) for n in range(first, last + 1)}
    some = next((counts for group in ways.values() for counts in group), None)
    laid_shares = {} if some is None else _laid_shares(template, stations, some, root)
    if some is not None and root != "welded":
        _check_root_layer(template, wps, laid_shares["root"])
    for n, group in ways.items():
        for counts in group:
            try:
                one = _arrange(template, stations, wps, counts, root, laid_shares)
            except NoArrangementFits as problem:
                problems.append(problem)
                continue
            heat = all(kind.heat_fits for kind in one.kinds)
            time = float(np.sum(one.shares * _highest_feeds(one, wps) / one.feeds))
            found.append(((not heat, round(time, 9), n, len(counts)), one))
        if any(rank[:2] == (False, 1.0) for rank, _ in found):
            break  # no wire feed is higher, and more beads take no less time
    if found:
        return min(found, key=lambda item: item[0])[1]
    if problems:
        # The one that came nearest to a plan: what is checked last.
        raise max(
            problems, key=lambda p: _CHECK_ORDER.index(str(p.key).split(".")[1].split("_area")[0])
        )
    height = 1e3 * wps.bead.layer_height[0], 1e3 * wps.bead.layer_height[1]
    raise NoArrangementFits(
        f"no number of layers has heights of {height[0]:g} to {height[1]:g} mm",
        key="bead.layer_height_mm",
    )


_CHECK_ORDER: Final = (
    "cap_height_mm",
    "root",
    "cap",
    "fill",
    "layer_height_mm",
    "wire_feed_m_min",
    "travel_speed_mm_min",
)


def _highest_feeds(arrangement: Arrangement, wps: WeldingProcedure) -> Array:
    """Highest wire feed that each bead's window allows, shape (n,), m/s."""
    over = arrangement.root_kind == "open"
    return np.array(
        [
            wps.limits(open_root=over and name == "root")[1].wire_feed[1]
            for name in arrangement.kind_names
        ]
    )


def _layer_counts(
    n: int, layers: range, widths: tuple[float, float], root: RootKind
) -> list[tuple[int, ...]]:
    """Counts of n beads in layers: the root bead, then by the layers' width at even heights."""
    bottom, top = widths
    roots = (1,) if root != "welded" else ()
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


def _layers(template: SectionTemplate, wps: WeldingProcedure, root: RootKind) -> range:
    """Numbers of layers whose mean height is in its window."""
    whole = template.layer_lines(np.empty((len(template.corners), 0)))
    depth = template.layer_heights(whole)
    lowest, highest = wps.bead.layer_height
    fewest = max(
        1 if root == "welded" else 2, ceil(float(depth.max()) / highest * (1 - LIMIT_TOLERANCE))
    )
    return range(fewest, floor(float(depth.min()) / lowest * (1 + LIMIT_TOLERANCE)) + 1)


def _widths(template: SectionTemplate) -> tuple[float, float]:
    """Mean width of root and opening, metres."""
    root = np.linalg.norm(template.corners[:, 1] - template.corners[:, 0], axis=1)
    return float(root.mean()), float(template.opening.mean())


def _laid_shares(
    template: SectionTemplate, stations: GrooveStations, counts: tuple[int, ...], root: RootKind
) -> dict[str, Window]:
    """Least and largest ratio of deposited area, a metre of the tip's path, to each kind's area.

    Computed for beads of equal areas: the place of a bead in the section decides it.
    """
    names = np.array(bead_kinds(counts, root))
    equal = np.repeat(template.area[:, None] / len(names), len(names), axis=1)
    try:
        cells = template.cut_into_beads(counts, equal)
    except ValueError:
        return dict.fromkeys(KIND_NAMES, (1.0, 1.0))
    shares = bead_lines(stations, cells).areas / equal
    found = {name: shares[:, names == name] for name in KIND_NAMES}
    return {
        name: (float(x.min()), float(x.max())) if x.size else (1.0, 1.0)
        for name, x in found.items()
    }


def _check_root_layer(template: SectionTemplate, wps: WeldingProcedure, laid: Window) -> None:
    """Refuse a root that one bead can't span: the template lays one across all of it."""
    low, high = wps.bead.layer_height
    # The largest bead allowed at its thinnest, and the smallest at its thickest.
    for area, share, too in (
        (wps.bead.root_area[1], laid[0], "wide"),
        (wps.bead.root_area[0], laid[1], "narrow"),
    ):
        inside = np.clip((area / share - template.root_area) / template.groove_area, 1e-3, 0.999)
        below = template.root_area + inside * template.groove_area
        heights = template.layer_heights(template.layer_lines(below[:, None]))[:, 0]
        worst = int(np.argmin(heights) if too == "wide" else np.argmax(heights))
        height = float(heights[worst])
        if (too == "wide" and height < low) or (too == "narrow" and height > high):
            width = float(np.linalg.norm(template.corners[worst, 1] - template.corners[worst, 0]))
            raise NoArrangementFits(
                f"a root of {1e3 * width:.1f} mm is too {too} for the template, which lays one "
                f"root bead across all of it: {1e6 * area:g} mm² would be {1e3 * height:.2f} mm "
                f"high, and bead.layer_height_mm allows {1e3 * low:g} to {1e3 * high:g}",
                key="bead.root_area_mm2",
            )


def _arrange(
    template: SectionTemplate,
    stations: GrooveStations,
    wps: WeldingProcedure,
    counts: tuple[int, ...],
    root: RootKind,
    laid_shares: dict[str, Window],
) -> Arrangement:
    area, names = template.area, np.array(bead_kinds(counts, root))
    shares = dict(zip(KIND_NAMES, _shares(area, wps, counts, root, laid_shares), strict=True))
    for name in dict.fromkeys(names.tolist()):  # before it is cut: what is to be expected
        expected = shares[name] * np.array((area.min(), area.max())) * laid_shares[name]
        choose_wire_feed(name, expected, wps, open_root=name == "root" and root == "open")
    wanted = area[:, None] * np.array([shares[name] for name in names])
    below = wanted.cumsum(axis=1)[:, np.cumsum(counts)[:-1] - 1]
    try:
        heights = template.layer_heights(template.layer_lines(below))
    except ValueError as error:
        raise NoArrangementFits(str(error), key="bead.cap_height_mm") from None
    least, most = float(heights.min()), float(heights.max())
    low, high = wps.bead.layer_height
    if least < low * (1 - LIMIT_TOLERANCE) or most > high * (1 + LIMIT_TOLERANCE):
        raise NoArrangementFits(
            f"{sum(counts)} beads in {len(counts)} layers are {1e3 * least:.2f} to "
            f"{1e3 * most:.2f} mm high",
            key="bead.layer_height_mm",
        )
    laid = bead_lines(stations, template.cut_into_beads(counts, wanted)).areas
    kinds = {}
    for name in KIND_NAMES:
        of_kind = laid[:, names == name] if name in names else laid
        low, high = getattr(wps.bead, f"{name}_area")
        least, most = of_kind.min() * (1 - BETWEEN_STATIONS), of_kind.max() * (1 + BETWEEN_STATIONS)
        if name in names and not low <= least <= most <= high:
            raise NoArrangementFits(
                f"a {name} bead is {1e6 * least:.1f} to {1e6 * most:.1f} mm²",
                key=f"bead.{name}_area_mm2",
            )
        over_opening = name == "root" and root == "open"
        feed = choose_wire_feed(name, np.array((least, most)), wps, open_root=over_opening)
        kinds[name] = BeadKind(shares[name], *feed)
    return Arrangement(counts, root, **kinds)


def _shares(
    area: Array,
    wps: WeldingProcedure,
    counts: tuple[int, ...],
    root_kind: RootKind,
    laid_shares: dict[str, Window],
) -> tuple[float, float, float]:
    """Shares of a root, a fill and a cap bead: equal, unless their windows part them.

    A kind without a bead has the share of another.
    """
    n, capped, roots = sum(counts), counts[-1], int(root_kind != "welded")
    inner = n - roots - capped

    def nearest(kind: str, window: Window, share: float) -> float:
        less, more = laid_shares[kind]
        lowest = window[0] * (1 + 2 * BETWEEN_STATIONS) / (float(area.min()) * less)
        highest = window[1] * (1 - 2 * BETWEEN_STATIONS) / (float(area.max()) * more)
        if lowest > highest * (1 + 1e-12):
            raise NoArrangementFits(
                f"the groove's area changes by {float(area.max() / area.min()):.2f} times, more "
                f"than the window of a {kind} bead",
                key=f"bead.{kind}_area_mm2",
            )
        return min(max(share, lowest), highest)

    root = nearest("root", wps.bead.root_area, 1 / n) if roots else 0.0
    cap = nearest("cap", wps.bead.cap_area, (1 - root) / (n - roots))
    if inner == 0:
        rest = (1 - root) / capped
        if abs(nearest("cap", wps.bead.cap_area, rest) - rest) > 1e-12:
            raise NoArrangementFits(
                f"{n} beads are too large or too small", key="bead.cap_area_mm2"
            )
        return root or rest, rest, rest
    fill = (1 - root - capped * cap) / inner
    if fill <= 0 or abs(nearest("fill", wps.bead.fill_area, fill) - fill) > 1e-12:
        raise NoArrangementFits(
            f"with {n} beads in {len(counts)} layers a fill bead has "
            f"{1e6 * fill * float(area.min()):.1f} to {1e6 * fill * float(area.max()):.1f} mm²",
            key="bead.fill_area_mm2",
        )
    return root or fill, fill, cap
