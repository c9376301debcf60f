"""A finished weld's surface against a table of limits: values, places, lengths, sigmas.

It states what was measured beside what a table allows; whether a weld complies with anything is
for its inspector to say.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen

from tjscan.core.config import StrictFileModel, read_toml, validate_table
from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.core.units import DEG, LIST_OR_WORD_IN_FILE, MM, SettingsTable
from tjscan.welding.look import LEAST_SEEN_SHARE, UNSEEN_SIGMA, resample_rows
from tjscan.welding.state import WeldState

Imperfection = Literal["excess", "sag", "undercut", "toe angle", "misalignment", "throat"]

WHAT_A_LASER_CANNOT_SEE: Final = (
    "A laser line shows no crack, no lack of fusion, no pore below about 1 mm and nothing of the "
    "root's side."
)

TOE_COVER: Final = 0.2e-3
"""A weld begins where its surface is so far over the groove's face, metres."""

TOE_GAP, TOE_LINE_LENGTH = 0.4e-3, 1.5e-3
"""Lines beside a toe begin so far from it, and are so long, metres."""

UNDERCUT_REACH: Final = 4e-3
"""An undercut lies no farther beside a toe, metres."""

LEAST_SIGMA: Final = 0.03e-3
"""Standard deviation of heights that look and first scan share, metres (assumption)."""

CLEAR_SIGMAS: Final = 2.0
"""A value is called within or beyond a limit if it is so many standard deviations from it."""

WINDOW_LENGTH: Final = 0.1
"""Imperfections are summed over this length, metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit(SettingsTable):
    """A row of the table ``[[limit]]``: base + share of a measure, and no more than a most.

    Parameters
    ----------
    imperfection : str
        What is limited. A toe angle and a throat have a least value, the others a largest one.
    number, level : str
        As the table's source has it, such as ``502`` and ``B``.
    base, most : float
        Metres.
    share : float
        Of `of`.
    of : str
        ``width`` of the weld between its toes, or ``thickness`` of the plate.
    least : float
        Of a throat, metres.
    least_angle : float
        Of a toe angle, radians.
    remark : str
        Such as where the number comes from.
    """

    imperfection: Imperfection
    number: str = ""
    level: str = ""
    base: Annotated[float, Ge(0), MM] = 0.0
    share: Annotated[float, Ge(0), Le(5)] = 0.0
    of: Literal["width", "thickness"] = "width"
    most: Annotated[float, Gt(0), MM] = 1.0
    least: Annotated[float, Ge(0), MM] = 0.0
    least_angle: Annotated[float, Ge(0), Le(180), DEG] = 0.0
    remark: str = ""

    @property
    def is_least(self) -> bool:
        """Whether values below it are beyond it."""
        return self.imperfection in ("toe angle", "throat")

    def at(self, width: Array, thickness: float) -> Array:
        """The limit at stations whose welds have widths, shape (n,), metres or radians."""
        if self.imperfection == "toe angle":
            return np.full_like(width, self.least_angle)
        if self.imperfection == "throat":
            return np.full_like(width, self.least)
        measure = width if self.of == "width" else np.full_like(width, thickness)
        return np.minimum(self.base + self.share * measure, self.most)


class LimitTable(StrictFileModel):
    """A file of limits, as its user states them."""

    name: str
    remark: str = ""
    limit: Annotated[tuple[Limit, ...], MinLen(1), MaxLen(200), LIST_OR_WORD_IN_FILE]


def read_limits(file: Path) -> LimitTable:
    """Read a table of limits; ConfigurationError for the first key that is wrong."""
    return validate_table(LimitTable, read_toml(file), file)


@array_dataclass
class WeldMeasures:
    """What the surface of a finished weld shows at n stations; NaN where it shows nothing.

    Parameters
    ----------
    s, width : ndarray, shape (n,)
        Along the groove, and between the toes, metres.
    values, sigmas : dict
        By imperfection: shape (n,), metres, or radians for toe angles.
    """

    s: Array
    width: Array
    values: dict[str, Array]
    sigmas: dict[str, Array]


def measure_weld(
    state: WeldState, u: Array, w: Array, sigma: Array, read: Mask, *, butt: bool
) -> WeldMeasures:
    """Measure a finished weld.

    Parameters
    ----------
    state : WeldState
        With the groove's faces where they are now.
    u, w, sigma, read : ndarray
        The last look, as `WeldPlanner.take_look` takes it.
    butt : bool
        Whether it joins two plates: only these are misaligned; a throat is a T-joint's.
    """
    seen = resample_rows(state.u, u, w)
    sigma = resample_rows(state.u, u, np.broadcast_to(sigma.T, w.T.shape).T)
    over = seen - state.base
    rows = np.arange(len(state.s))
    inside = (state.u >= u[:, :1]) & (state.u <= u[:, -1:])
    metal = (state.w - state.base > TOE_COVER) & inside
    first, last = metal.argmax(axis=1), metal.shape[1] - 1 - metal[:, ::-1].argmax(axis=1)
    # The toe is on the first column beside that.
    first, last = np.maximum(first - 1, 0), np.minimum(last + 1, metal.shape[1] - 1)
    toes = np.stack((state.u[rows, first], state.u[rows, last]))
    heights = np.stack((seen[rows, first], seen[rows, last]))
    slope = (heights[1] - heights[0]) / np.maximum(toes[1] - toes[0], 1e-6)
    line = heights[0][:, None] + slope[:, None] * (state.u - toes[0][:, None])
    tilt = 1 / np.hypot(1, slope)
    planned = state.toe_points
    rise = (planned[:, 1, 1] - planned[:, 0, 1]) / (planned[:, 1, 0] - planned[:, 0, 0])
    edge = planned[:, 0, 1:] + rise[:, None] * (state.u - planned[:, 0, :1])
    between = (state.u > planned[:, 0, :1]) & (state.u < planned[:, 1, :1])
    face = np.hypot(1, np.gradient(state.base, axis=1) / np.gradient(state.u, axis=1))
    beside = ((state.u < toes[0][:, None]) & (state.u > toes[0][:, None] - UNDERCUT_REACH)) | (
        (state.u > toes[1][:, None]) & (state.u < toes[1][:, None] + UNDERCUT_REACH)
    )
    seen_columns = sigma < UNSEEN_SIGMA / 2
    sigma = np.hypot(sigma, LEAST_SIGMA)
    found = {
        "excess": _largest(seen - line, metal, seen_columns, sigma),
        "sag": _largest(edge - seen, between & inside, seen_columns, sigma),
        "undercut": _largest(-over / face, beside & inside, seen_columns, sigma),
        "toe angle": _toe_angles(state, seen, toes, np.where(seen_columns, sigma, np.nan)),
    }
    found["excess"] *= tilt
    found["sag"] /= np.hypot(1, rise)
    found["undercut"][0] = np.maximum(found["undercut"][0], 0.0)
    if butt:  # the plates are where the first scan shows them
        ends = [np.median(part, axis=1) for part in (state.base[:, 2:12], state.base[:, -12:-2])]
        square = np.sum(sigma**2, axis=1, where=seen_columns)
        row_sigma = np.sqrt(square / np.maximum(seen_columns.sum(axis=1), 1))
        found["misalignment"] = np.stack((np.abs(ends[1] - ends[0]), row_sigma))
    else:
        found["throat"] = _largest(-_from_root(state, seen), metal, seen_columns, sigma)
        found["throat"][0] *= -1
    shown = read & metal.any(axis=1)
    values = {name: np.where(shown, value, np.nan) for name, (value, _) in found.items()}
    sigmas = {name: one for name, (_, one) in found.items()}
    return WeldMeasures(state.s, (toes[1] - toes[0]) / tilt, values, sigmas)


def _largest(values: Array, columns: Mask, seen: Mask, sigma: Array) -> Array:
    """The largest over columns of each row, and its sigma, shape (2, n); NaN where few are seen."""
    rows, known = np.arange(len(values)), columns & seen
    at = np.where(known, values, -np.inf).argmax(axis=1)
    enough = known.any(axis=1) & (known.sum(axis=1) >= LEAST_SEEN_SHARE * columns.sum(axis=1))
    return np.asarray(np.where(enough, (values[rows, at], sigma[rows, at]), np.nan))


def _from_root(state: WeldState, seen: Array) -> Array:
    """Distance of the weld's surface from the groove's root, shape (n, m), metres."""
    rows, root = np.arange(len(state.s)), state.base.argmin(axis=1)
    du, dw = state.u - state.u[rows, root][:, None], seen - state.base[rows, root][:, None]
    return np.asarray(np.hypot(du, dw))


def _toe_angles(state: WeldState, seen: Array, toes: Array, sigma: Array) -> Array:
    """Smaller angle between weld and face at both toes, and its sigma, shape (2, n), radians."""
    found = []
    for toe, out in zip(toes, (-1.0, 1.0), strict=True):
        way = out * (state.u - toe[:, None])
        slopes, variance = [], np.zeros(len(toe))
        for values, side in ((state.base, 1.0), (seen, -1.0)):
            near = (side * way > TOE_GAP) & (side * way < TOE_GAP + TOE_LINE_LENGTH)
            count = np.maximum(near.sum(axis=1), 1)[:, None]
            du = np.where(near, way - np.where(near, way, 0).sum(axis=1)[:, None] / count, 0.0)
            lever = np.maximum((du**2).sum(axis=1), 1e-12)
            slopes.append((du * values).sum(axis=1) / lever)
            variance = np.sum((du * sigma) ** 2, axis=1, where=near) / lever**2
        found.append((np.pi + np.arctan(slopes[1]) - np.arctan(slopes[0]), np.sqrt(variance)))
    left, right = np.array(found)
    both = np.isfinite(left[1]) & np.isfinite(right[1])
    return np.asarray(np.where(both, np.where(left[0] < right[0], left, right), np.nan))


@dataclass(frozen=True, slots=True)
class InspectionRow:
    """A limit, and the value nearest to it or farthest beyond it.

    Parameters
    ----------
    limit : Limit
    value, sigma, allowed : float
        There, metres or radians.
    s : float
        Where, metres along the groove.
    length : float
        Of all stretches beyond the limit, metres.
    longest_in_window : float
        Largest such length in any `WINDOW_LENGTH` of the weld, metres.
    unseen : float
        Length that the look does not show, metres.
    state : str
        ``within``, ``beyond`` or ``undecided``: nearer to the limit than `CLEAR_SIGMAS`.
    """

    limit: Limit
    value: float
    sigma: float
    allowed: float
    s: float
    length: float
    longest_in_window: float
    unseen: float
    state: Literal["within", "beyond", "undecided"]


def inspect_weld(
    measures: WeldMeasures, table: LimitTable, thickness: float
) -> tuple[InspectionRow, ...]:
    """Hold a weld's measures against each limit of a table that is about one of them.

    Parameters
    ----------
    measures : WeldMeasures
    table : LimitTable
    thickness : float
        Of the thinner part, metres.
    """
    step = float(np.median(np.diff(measures.s)))
    kernel = np.ones(max(round(WINDOW_LENGTH / step), 1))
    rows = []
    for limit in table.limit:
        value = measures.values.get(limit.imperfection)
        if value is None or not np.isfinite(value).any():
            continue
        allowed = limit.at(measures.width, thickness)
        excess = (allowed - value) if limit.is_least else (value - allowed)
        worst = int(np.nanargmax(excess))
        beyond = np.nan_to_num(excess, nan=-1.0) > 0
        sigma = float(measures.sigmas[limit.imperfection][worst])
        clear = abs(float(excess[worst])) > CLEAR_SIGMAS * sigma
        judged: Literal["within", "beyond"] = "beyond" if excess[worst] > 0 else "within"
        rows.append(
            InspectionRow(
                limit,
                float(value[worst]),
                sigma,
                float(allowed[worst]),
                float(measures.s[worst]),
                step * int(beyond.sum()),
                step * float(np.convolve(beyond, kernel).max()),
                step * int(np.isnan(value).sum()),
                judged if clear else "undecided",
            )
        )
    return tuple(rows)
