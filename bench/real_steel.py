"""How well grooves are read as yards leave them, and whether a stated uncertainty holds.

Sections of four tubular joints, both ways round, from poses off by up to 5 degrees and 5 mm,
with one fault a row; the bench casts its own rays (`_sections`) and draws its own faults
(`_steel`). A second ray caster of another make (`_second_caster`) draws other grooves with other
faults. Grooves of which each is read section by section, with what the sections before show, have
rows of their own (`_along_seam`). Forty real profiles of a shiny V-groove are read too, where they
are at hand, also as of a groove half as large and of one that is steeper.

Every row of a groove has these bars: the share that is read; the share with a corner off by more
than 1 mm that is stated to better than 0.4 mm; the share of corners that are given to better
than 0.4 mm, of those that are there and beside which the surface is seen, each corner and all
together; and the mean squared error over stated variance.
``--quick`` draws fewer profiles a row; ``--first N`` draws them from number N on; ``--times`` takes
the times alone.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import thread_time
from typing import Final

import numpy as np
from _along_seam import (
    ALONG_SEAM,
    FILLED_ALONG_SEAM,
    SECTION_STEP,
    SECTIONS_BEFORE,
    SeamFault,
)
from _earlier_reader import EARLIER_COMMIT, EARLIER_MEDIAN, EarlierReader
from _known_flanks import flanks_of_section, known_flanks
from _second_caster import SECOND_FILLED, SECOND_GROOVES, SecondFault, WedgeProfile
from _sections import EMITTER_Z, Array, look_at
from _steel import (
    FILLED,
    GROOVES,
    MM,
    NO_GROOVE,
    RHO,
    Fault,
    Groove,
    PosedProfile,
    area_left,
    draw,
    noise,
    shoot,
)
from _table import Row, main

from tjscan.core.errors import GrooveNotFound
from tjscan.groove.filled import KnownFlanks, read_filled_groove
from tjscan.groove.prior import GroovePrior, SectionEvidence
from tjscan.groove.read import fit_groove, read_groove
from tjscan.groove.section import GrooveSection
from tjscan.groove.settings import BUTT_V, GrooveSettings
from tjscan.laser.profile import Profile

MANY, FEW = 400, 60
"""Profiles a row; with ``--quick``."""

WRONG, SURE = 1 * MM, 0.4 * MM
CORNERS: Final = ("p2", "p3", "p4")
REAL: Final = Path("shared") / "data" / "v-groove-real"
"""Beside the checkout."""

MANY_COLUMNS: Final = 2048

LEAST_READ: Final = {
    "spatter": 95.0,
    "several at once": 95.0,
    "second caster, spatter": 95.0,
    "second caster, several": 95.0,
}
"""Per cent; 97 elsewhere."""

LEAST_GIVEN: Final = {
    "ghosts before and behind": 60.0,
    "several at once": 40.0,
    "second caster, reflections": 60.0,
    "sections before, ghosts": 60.0,
    "sections before, second caster, reflections": 60.0,
    "second caster, several": 40.0,
}
"""Per cent of all corners of a row that are to be given; 95 elsewhere."""

LEAST_FILLED_READ = 90
"""Per cent of the grooves with weld in them, as far as anything is left to fill."""

ALL_GROOVES: Final[tuple[Fault | SecondFault, ...]] = (*GROOVES, *SECOND_GROOVES)
ALL_FILLED: Final[tuple[Fault | SecondFault, ...]] = (*FILLED, *SECOND_FILLED)
FAULTS: Final[dict[str, Fault | SecondFault]] = {
    fault.name: fault for fault in (*ALL_GROOVES, *ALL_FILLED, *NO_GROOVE)
}
FEWEST_FOR_MEAN: Final = 20
"""Fewer corners than this have no mean worth a bar."""


@dataclass(frozen=True)
class Reading:
    """What the reader gave: corners (3, 2), their standard deviations, what it named, the area."""

    corners: Array
    sigmas: Array
    words: str
    area: tuple[float, float] = (math.nan, math.nan)

    @classmethod
    def of(cls, section: GrooveSection) -> Reading:
        """Corners that are not given are NaN, or have no finite uncertainty."""
        spread = np.trace(section.corner_covariances_s, axis1=1, axis2=2)
        words = [str(getattr(section, key, "")) for key in ("conditions", "model", "root")]
        area = section.area, section.area_sigma
        return cls(section.points_s[1:4, [0, 2]], np.sqrt(spread), " ".join(words).lower(), area)


def profile_of(points: Array) -> Profile:
    return Profile(points[:, 0], points[:, 1])


def read(points: Array, prior: GroovePrior | None = None) -> Reading | str:
    """The reading, or the words of the refusal."""
    try:
        return Reading.of(read_groove(profile_of(points), prior=prior))
    except GrooveNotFound as refusal:
        return str(refusal).lower()


def shot_of(name: str, k: int) -> PosedProfile | WedgeProfile:
    """The k-th profile of a row, by the ray caster that draws it."""
    fault = FAULTS[name]
    return fault.shoot(k) if isinstance(fault, SecondFault) else shoot(fault, k)


@dataclass(frozen=True)
class Verdict:
    """One profile judged.

    Parameters
    ----------
    read, named, sure_wrong : bool
    given : ndarray of float, shape (3,)
        Whether a corner that has to be given to better than `SURE` is; NaN where none has to.
    z_sq : ndarray, shape (3,)
        Squared error over stated variance; NaN where there is no corner or none is given.
    """

    read: bool
    named: bool
    sure_wrong: bool
    given: Array
    z_sq: Array


def judge(name: str, k: int) -> Verdict:
    """Read the k-th profile of a row."""
    shot = shot_of(name, k)
    return verdict_on(shot, read(shot.points), FAULTS[name].named)


def verdict_on(
    shot: PosedProfile | WedgeProfile, reading: Reading | str, word: str | None = None
) -> Verdict:
    """Judge a reading; a groove that is named has that word in what is said of it."""
    g = shot.groove
    due = np.where(g.there & ~g.affected, 0.0, np.nan)
    if isinstance(reading, str):
        named = word is not None and word in reading
        return Verdict(False, named, False, due, np.full(3, np.nan))
    off = np.linalg.norm(reading.corners - g.corners, axis=1)
    sure = np.isfinite(off) & (reading.sigmas < SURE)
    with np.errstate(divide="ignore", invalid="ignore"):
        z_sq = np.where(g.there, (off / reading.sigmas) ** 2, np.nan)
    return Verdict(
        read=True,
        named=word is not None and word in reading.words,
        sure_wrong=bool(np.any(sure & (off > WRONG))),
        given=np.where(np.isnan(due), np.nan, sure),
        z_sq=np.where(np.isfinite(reading.sigmas), z_sq, np.nan),
    )


def prior_along(fault: SeamFault, k: int, count: int, bare: bool = False) -> GroovePrior:
    """What the first sections of a row's k-th groove show of the next one, read in their order."""
    before: list[tuple[int, SectionEvidence]] = []
    for section in range(count + 1):
        prior = GroovePrior.from_sections(
            [(shown, (section - i) * SECTION_STEP) for i, shown in before]
        )
        if section == count:
            break
        with suppress(GrooveNotFound):
            profile = profile_of(fault.shoot(k, section, bare).points)
            shown = read_groove(profile, prior=prior).evidence
            before += [(section, shown)] if shown is not None else []
    return prior


def judge_along(name: str, k: int) -> Verdict:
    """Read a section of a row's k-th groove with what those before it show."""
    fault = next(one for one in ALONG_SEAM if one.name == name)
    shot = fault.shoot(k, SECTIONS_BEFORE)
    return verdict_on(shot, read(shot.points, prior_along(fault, k, SECTIONS_BEFORE)))


def rows_of(fault: Fault | SecondFault | SeamFault, verdicts: Sequence[Verdict]) -> list[Row]:
    """The bars of a row with a groove."""
    name, total = fault.name, len(verdicts)

    def share(values: Iterable[bool]) -> float:
        return 100 * sum(values) / total

    rows = [
        Row(
            f"{name}: read",
            share(v.read for v in verdicts),
            100,
            "%",
            at_least=LEAST_READ.get(name, 97.0),
        )
    ]
    if not isinstance(fault, SeamFault) and fault.named is not None:
        named = share(v.named for v in verdicts)
        rows.append(Row(f"{name}: named as {fault.named!r}", named, 100, "%", at_least=99))
    rows.append(Row(f"{name}: sure and wrong", share(v.sure_wrong for v in verdicts), 0.1, "%"))
    given = np.array([v.given for v in verdicts])
    z_sq = np.array([v.z_sq for v in verdicts])
    pooled = 100 * float(np.nanmean(given))
    rows.append(Row(f"{name}: given", pooled, 100, "%", at_least=LEAST_GIVEN.get(name, 95.0)))
    for i, corner in enumerate(CORNERS):
        due, z = given[:, i], z_sq[:, i]
        due, z = due[~np.isnan(due)], z[~np.isnan(z)]
        if len(due) >= FEWEST_FOR_MEAN:
            surely = 100 * float(due.mean())
            rows.append(Row(f"{name}: {corner} given", surely, 100, "%", at_least=95))
        if len(z) >= FEWEST_FOR_MEAN:
            mean = float(z.mean())
            rows.append(Row(f"{name}: {corner} mean z²", mean, 2, at_least=0.5))
    return rows


def no_groove_row(fault: Fault | SecondFault, verdicts: Sequence[Verdict]) -> Row:
    accepted = sum(v.read and not v.named for v in verdicts)
    return Row(f"{fault.name}: read, and not named", accepted, 0)


# --- grooves with weld in them


@dataclass(frozen=True)
class FillVerdict:
    """One profile of a groove with weld in it, judged.

    Parameters
    ----------
    left, read, sure_wrong : bool
        Whether there is area left to fill; the rest as of `Verdict`.
    error : float
        Of the area, as a share of it.
    z_sq : float
        The same squared, over the stated variance.
    """

    left: bool
    read: bool
    sure_wrong: bool = False
    error: float = math.nan
    z_sq: float = math.nan


def judge_fill(name: str, k: int) -> FillVerdict:
    """Read the k-th profile of a row of grooves with weld in them."""
    shot = shot_of(name, k)
    reading = read(shot.points)
    truth = shot.groove.area if isinstance(shot, WedgeProfile) else area_left(shot.groove)
    if isinstance(reading, str):
        return FillVerdict(truth > 0, read=False)
    off = np.linalg.norm(reading.corners - shot.groove.corners, axis=1)
    area, sigma = reading.area
    wrong = bool(np.any((reading.sigmas < SURE) & (off > WRONG)))
    z_sq = ((area - truth) / sigma) ** 2
    return FillVerdict(truth > 0, True, wrong, abs(area / truth - 1), z_sq)


def judge_with_flanks(name: str, k: int) -> FillVerdict:
    """Read the k-th profile of such a row with its bare groove known; the error is in m²."""
    return verdict_with_flanks(shot_of(name, k), known_flanks(FAULTS[name], k))


def judge_with_flanks_read(k: int) -> FillVerdict:
    """The same of a groove whose bare sections were read one after the other before."""
    fault, last = FILLED_ALONG_SEAM, SECTIONS_BEFORE
    shot, bare = (fault.shoot(k, last, as_scanned) for as_scanned in (False, True))
    prior = prior_along(fault, k, last, bare=True)
    try:
        section = read_groove(profile_of(bare.points), prior=prior)
    except GrooveNotFound:
        return FillVerdict(left=True, read=False)
    return verdict_with_flanks(shot, flanks_of_section(section, np.random.default_rng((k, 5))))


def verdict_with_flanks(shot: PosedProfile | WedgeProfile, flanks: KnownFlanks) -> FillVerdict:
    """Judge the reading of a profile of such a groove."""
    truth = shot.groove.area if isinstance(shot, WedgeProfile) else area_left(shot.groove)
    try:
        found = read_filled_groove(profile_of(shot.points), flanks)
    except GrooveNotFound:
        return FillVerdict(truth > 0, read=False)
    section = found.section
    off = np.linalg.norm(section.points_s[1, [0, 2]] - shot.groove.corners[0])
    wrong = bool(np.trace(section.covariance_s[:2, :2]) < SURE**2 and off > WRONG)
    error = abs(section.area - truth)
    return FillVerdict(truth > 0, True, wrong, error, (error / section.area_sigma) ** 2)


def rows_with_flanks(name: str, verdicts: Sequence[FillVerdict]) -> list[Row]:
    """The bars of such a row with its bare groove known."""
    name, read_ = f"{name}, flanks known", [v for v in verdicts if v.read]
    errors = 1e6 * np.array([v.error for v in read_])
    wrong = 100 * float(np.mean([v.sure_wrong for v in verdicts]))
    z_sq = float(np.mean([v.z_sq for v in read_]))
    share = 100 * len(read_) / len(verdicts)
    return [
        Row(f"{name}: read", share, 100, "%", at_least=LEAST_FILLED_READ),
        Row(f"{name}: sure and wrong", wrong, 0.5, "%"),
        Row(f"{name}: area left, mean error", float(errors.mean()), 2, "mm²"),
        Row(f"{name}: area left, 95 %", float(np.percentile(errors, 95)), 5, "mm²"),
        Row(f"{name}: area left, mean z²", z_sq, 2, at_least=0.5),
    ]


def fill_rows(name: str, verdicts: Sequence[FillVerdict]) -> list[Row]:
    """The bars of a row: where nothing is left to fill, a profile is to be refused."""
    wrong = 100 * float(np.mean([v.sure_wrong for v in verdicts]))
    over = sum(v.read and not v.left for v in verdicts)
    rows = [
        Row(f"{name}: sure and wrong", wrong, 0.5, "%"),
        Row(f"{name}: read, though nothing is left", 100 * over / len(verdicts), 2, "%"),
    ]
    due = [v for v in verdicts if v.left]
    errors = 100 * np.array([v.error for v in due if v.read])
    if len(errors) >= FEWEST_FOR_MEAN:
        z_sq = float(np.mean([v.z_sq for v in due if v.read]))
        rows += [
            Row(f"{name}: area left, mean error", float(errors.mean()), 2, "%"),
            Row(f"{name}: area left, 95 %", float(np.percentile(errors, 95)), 5, "%"),
            Row(f"{name}: area left, mean z²", z_sq, 2, at_least=0.5),
        ]
    if len(due) >= FEWEST_FOR_MEAN:
        share = 100 * len(errors) / len(due)
        rows.append(Row(f"{name}: read", share, 100, "%", at_least=LEAST_FILLED_READ))
    return rows


# --- the best there can be


def against_bound(k: int) -> tuple[Array, Array]:
    """Squared errors and Cramér-Rao bounds of the corners of an ideal groove, each (3,)."""
    sigma = 30e-6
    rng = np.random.default_rng((k, 77))
    g = draw(rng, k)
    seen = look_at(g.lines, g.pose.second_eye)
    found = read(noise(seen, seen.points, rng, sigma, gaps=False))
    if isinstance(found, str):
        return np.full(3, np.nan), np.full(3, np.nan)
    errors = np.sum((found.corners - g.corners) ** 2, axis=1)
    return errors, corner_bounds(g, seen.points, sigma)


STRAIGHT: Final = 2e-6
"""A side that a polynomial leaves by less needs no higher one, in metres."""


def corner_bounds(g: Groove, points: Array, sigma: float) -> Array:
    """Cramér-Rao bounds of each corner's squared error in metres squared, shape (3,).

    Points are known to belong to their true sides, which are polynomials of the lowest degree
    that leaves no more than `STRAIGHT`. Noise along a ray displaces a side by the part
    square to it; its covariance is that of a first-order autoregression over the columns.
    """
    tangents = points[:, 0] / (points[:, 1] - EMITTER_Z)
    limits = g.corners[:, 0] / (g.corners[:, 1] - EMITTER_Z)
    # Sides from the wall to the leg run towards falling x.
    side = np.searchsorted(-limits, -tangents)
    normals, variances = np.empty((4, 2, 2)), np.empty((4, 2))
    for i in range(4):
        index = np.flatnonzero((side == i) & np.isfinite(tangents))
        p = points[index]
        along = (p[-1] - p[0]) / np.linalg.norm(p[-1] - p[0])
        n = np.array((-along[1], along[0]))
        ends = g.corners[[max(i - 1, 0), min(i, 2)]]
        middle = p.mean(axis=0)
        s, h = (p - middle) @ along, (p - middle) @ n
        powers = np.arange(2)
        while np.ptp(h - np.polyval(np.polyfit(s, h, len(powers) - 1), s)) > STRAIGHT:
            powers = np.arange(len(powers) + 1)
        square = n[0] * tangents[index] + n[1]
        lag = np.abs(index[:, None] - index)
        R = sigma**2 * RHO**lag * np.outer(square, square)
        basis = s[:, None] ** powers
        spread = np.linalg.inv(basis.T @ np.linalg.solve(R, basis))
        at = ((ends - middle) @ along)[:, None] ** powers
        variances[i] = np.einsum("ki,ij,kj->k", at, spread, at)
        normals[i] = n
    bounds = np.empty(3)
    for c in range(3):
        w = np.linalg.inv(np.array((normals[c][0], normals[c + 1][0])))
        bounds[c] = np.trace(w @ np.diag((variances[c][1], variances[c + 1][0])) @ w.T)
    return bounds


def bound_rows(results: Sequence[tuple[Array, Array]]) -> list[Row]:
    errors, bounds = (np.array(column) for column in zip(*results, strict=True))
    read_ = np.isfinite(errors[:, 0])
    rows = [Row("noise alone: read", 100 * float(read_.mean()), 100, "%", at_least=100)]
    ratio = np.sqrt(errors[read_].mean(axis=0) / bounds[read_].mean(axis=0))
    return rows + [
        Row(f"noise alone: {c}, RMS error / Cramér-Rao bound", float(r), 1.3)
        for c, r in zip(CORNERS, ratio, strict=True)
    ]


# --- real profiles


def real_rows(count: int) -> list[Row]:
    """Forty real profiles of a V-groove; columns are 0.04 mm apart, heights about 0.1 mm."""
    above = (folder / REAL for folder in Path(__file__).resolve().parents)
    real = next((folder for folder in above if folder.is_dir()), None)
    if real is None:
        print(f"real V-grooves: skipped, there is no {REAL} beside the checkout", file=sys.stderr)
        return []
    heights = np.loadtxt(real / "profiles.csv", delimiter=",", skiprows=1)[:count]
    labels = np.loadtxt(real / "labels.csv", delimiter=",", skiprows=1)[:count]
    rows: list[Row] = []
    for name, pitch, unit in REAL_SIZES:
        off = [
            _columns_off(r, label, pitch, unit) for r, label in zip(heights, labels, strict=True)
        ]
        found = np.array([o for o in off if o is not None]).reshape(-1, 3)
        near_tops = 100 * float((found[:, [0, 2]] <= 15).mean()) if len(found) else math.nan
        near_root = 100 * float((found[:, 1] <= 25).mean()) if len(found) else math.nan
        least, far = 100 * 39 / 40, int((found > 40).any(axis=1).sum())
        rows += [
            Row(f"{name}: read", 100 * len(found) / len(off), 100, "%", at_least=least),
            Row(f"{name}: tops within 15 columns", near_tops, 100, "%", at_least=95),
            Row(f"{name}: root within 25 columns", near_root, 100, "%", at_least=95),
            Row(f"{name}: over 40 columns off", far, 0),
        ]
    return rows


REAL_SIZES: Final = (
    ("real V-grooves", 0.04 * MM, 0.1 * MM),
    ("real V-grooves at half the scale", 0.02 * MM, 0.05 * MM),
    ("real V-grooves at 0.6 of the pitch", 0.024 * MM, 0.1 * MM),
)
"""What one column and one unit of height are taken for, in metres."""


def _columns_off(heights: Array, label: Array, pitch: float, unit: float) -> Array | None:
    """How many columns off the labels both tops and the root are; None where it is refused."""
    z = np.where(heights == 0, np.nan, unit * heights) + 0.15
    x = pitch * (np.arange(len(heights)) - len(heights) / 2)
    profile = Profile(np.where(np.isnan(z), np.nan, x), z)
    corners = _butt_corners(profile)
    if corners is None:
        return None
    columns = np.sort(corners[:, 0] / pitch + len(heights) / 2)
    # With a root face the root lies between its two corners.
    found = np.array((columns[0], columns[1:-1].mean(), columns[-1]))
    return np.asarray(np.abs(found - label))


def _butt_corners(profile: Profile) -> Array | None:
    """Corners from top to top, shape (n, 2)."""
    try:
        fitted = fit_groove(profile, GrooveSettings(model=BUTT_V)).fitted
    except GrooveNotFound:
        return None
    return np.asarray(fitted.corners)


# --- time


def time_rows(count: int, first: int) -> list[Row]:
    """Times of one reading: of all rows in turns, and of sound grooves with many columns."""
    every = (*GROOVES, *FILLED, *NO_GROOVE)
    usual = [shoot(every[k % len(every)], first + k).points for k in range(count)]
    wide = [shoot(GROOVES[0], first + k, MANY_COLUMNS).points for k in range(count // 5)]
    try:
        with EarlierReader() as earlier:
            taken = [_interleaved_times(rows, earlier) for rows in (usual, wide)]
    except FileNotFoundError as missing:
        print(f"time: skipped, {missing}", file=sys.stderr)
        return []
    (own, other), (own_wide, other_wide) = taken
    slowdown = float(np.median(other)) / EARLIER_MEDIAN
    rows = [
        Row("time per profile, median", 1e3 * float(np.median(own)), 0.8, "ms", slowdown=slowdown),
        Row(
            "time per profile, 99 %",
            1e3 * float(np.percentile(own, 99)),
            3,
            "ms",
            slowdown=slowdown,
        ),
        Row(
            f"time per profile of {MANY_COLUMNS} columns, median",
            1e3 * float(np.median(own_wide)),
            1.5,
            "ms",
            slowdown=slowdown,
        ),
    ]
    for name, statistic, least in (("median", 50, 5), ("99 %", 99, 25)):
        faster = float(np.percentile(other, statistic) / np.percentile(own, statistic))
        rows.append(_faster_row(name, faster, least))
    faster = float(np.median(other_wide) / np.median(own_wide))
    return [*rows, _faster_row(f"{MANY_COLUMNS} columns", faster, 7)]


def _faster_row(name: str, faster: float, least: float) -> Row:
    name = f"time per profile, {name}: that of {EARLIER_COMMIT} over it"
    return Row(name, faster, math.inf, at_least=least)


def _interleaved_times(rows: Sequence[Array], earlier: EarlierReader) -> tuple[Array, Array]:
    """Seconds of each reading, and of the earlier reader's, taken in turns."""
    taken = np.empty((2, len(rows)))
    read(rows[0])
    for k, points in enumerate(rows):
        taken[1, k] = earlier.seconds(points)
        profile = profile_of(points)
        start = thread_time()
        with suppress(GrooveNotFound):
            read_groove(profile)
        taken[0, k] = thread_time() - start
    return taken[0], taken[1]


def measure(count: int, first: int) -> list[Row]:
    rows: list[Row] = []
    numbers = range(first, first + count)
    with ProcessPoolExecutor(max_workers=os.cpu_count()) as pool:
        work = partial(pool.map, chunksize=20)
        faults = (*ALL_GROOVES, *NO_GROOVE)
        waiting = [(f, work(partial(judge, f.name), numbers)) for f in faults]
        along = [(f, work(partial(judge_along, f.name), numbers)) for f in ALONG_SEAM]
        read_before = work(judge_with_flanks_read, numbers)
        filled = [(f, work(partial(judge_fill, f.name), numbers)) for f in ALL_FILLED]
        known = [(f, work(partial(judge_with_flanks, f.name), numbers)) for f in ALL_FILLED]
        bounds = work(against_bound, range(count))
        of_grooves: list[Verdict] = []
        for fault, found in waiting:
            verdicts = list(found)
            if fault in ALL_GROOVES:
                of_grooves += verdicts
                rows += rows_of(fault, verdicts)
            else:
                rows.append(no_groove_row(fault, verdicts))
        wrong = 100 * float(np.mean([v.sure_wrong for v in of_grooves]))
        rows.append(Row("all rows of grooves: sure and wrong", wrong, 0.1, "%"))
        for seam_fault, found in along:
            rows += rows_of(seam_fault, list(found))
        rows += rows_with_flanks(FILLED_ALONG_SEAM.name, list(read_before))
        for bars, readings in ((fill_rows, filled), (rows_with_flanks, known)):
            fills = {fault: list(found) for fault, found in readings}
            for fault, one in fills.items():
                rows += bars(fault.name, one)
            # A row of grooves that weld nearly fills has a mean of errors over nearly nothing.
            rows += bars("all fills and shapes", [v for f in FILLED for v in fills[f]])
        rows += bound_rows(list(bounds))
    return rows + real_rows(min(count, 40)) + time_rows(3 * count, first)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word not in ("--quick", "--times")]
    start = 0
    if "--first" in words:
        at = words.index("--first")
        start = int(words[at + 1])
        words = words[:at] + words[at + 2 :]
    profiles = FEW if "--quick" in sys.argv else MANY
    measured = (
        partial(time_rows, 3 * profiles) if "--times" in sys.argv else partial(measure, profiles)
    )
    sys.exit(main("grooves on real steel", partial(measured, start), words))
