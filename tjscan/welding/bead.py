"""The shape of a weld bead in cross-sections: a pool of given area under surface tension.

Coordinates of a cross-section: u across the groove, from the brace (or the left plate) to the leg
(or the right one), and w out of it. A surface is a row of columns, u growing and one w each, so
many sections are arrays of shape (sections, columns). Metres and radians.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le
from scipy.ndimage import gaussian_filter1d

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.core.units import DEG, MM, SettingsTable

CONTACT_STEPS: Final = 9
"""Rounds in which the toes move until both contact angles are allowed."""

CONTACT_STEP_GAIN: Final = 0.22
"""Way of a toe in a round, by the bead's width and the contact angle's excess in radians: a flat
bead's angle falls by four times the excess over a width that grows by one."""

SOLID_REACH: Final = 0.4e-3
"""The slope of the solid at a toe is measured this far to both sides along it, metres."""

NARROWEST_BEAD: Final = 2e-3
"""A bead does not recede to less, metres."""

LEAST_STIFFNESS: Final = 1e-4
"""Least gravity over surface tension, by the square of the width: below, the series is exact."""

POOL_LENGTH: Final = 4e-3
"""Standard deviation of the length along the groove over which the toes of a pool move together,
metres (assumption): a pool is one body, and does not run aside at one section alone."""

STEEPEST_OVERHANG: Final = 0.9
"""Share of π by which a pool that hangs may be wide in capillary lengths: at π it falls."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BeadModel(SettingsTable):
    """What decides the shape of beads. The defaults are assumptions: fit them to beads of yours.

    Parameters
    ----------
    width_factor : float
        Width along the surface of a bead of 1 kJ/mm without weave, metres: the width grows with
        the square root of the heat input.
    least_contact, largest_contact : float
        Between the pool's surface and the solid, inside the liquid, radians.
    capillary_length : float
        Square root of the surface tension over density and gravity, metres: 4.2 mm for
        1.2 N/m and 7000 kg/m³.
    start_excess, start_length : float
        Share of the area that an ignition adds, and the length over which that fades, metres.
    crater_deficit, crater_length : float
        Share of the area that is missing where the arc ends, and its length, metres.
    """

    width_factor: Annotated[float, Gt(0), Le(50), MM] = 10e-3
    least_contact: Annotated[float, DEG] = radians(25.0)
    largest_contact: Annotated[float, DEG] = radians(70.0)
    capillary_length: Annotated[float, Gt(0), Le(50), MM] = 4.2e-3
    start_excess: Annotated[float, Ge(0), Le(2)] = 0.25
    start_length: Annotated[float, Gt(0), Le(50), MM] = 6e-3
    crater_deficit: Annotated[float, Ge(0), Le(1)] = 0.35
    crater_length: Annotated[float, Gt(0), Le(50), MM] = 5e-3

    def bead_width(self, heat_input: Array, weave: Array | float = 0.0) -> Array:
        """Width along the surface, metres, of heat inputs in J/m and weaves in metres."""
        return np.asarray(self.width_factor * np.sqrt(heat_input / 1e6) + weave)

    def widest_on_slope(self, tilt: Array) -> Array:
        """Width of the pools that gravity does not let run down, metres; as `lay_beads` tilts.

        Gravity across a pool of width B turns its surface by sin(tilt) B² / 12 over the squared
        capillary length at either toe, which is the odd part of the meniscus. Both contact angles
        are then allowed if twice that is less than the range of them.
        """
        allowed = 6 * (self.largest_contact - self.least_contact)
        aside = np.maximum(np.abs(np.sin(tilt)), 1e-6)
        return np.asarray(self.capillary_length * np.sqrt(allowed / aside))

    def area_along_bead(self, from_start: Array, to_end: Array) -> Array:
        """Area over that of the middle of a bead, by the distances from both ends, metres."""
        start = 1 + self.start_excess * np.exp(-from_start / self.start_length)
        crater = 1 - self.crater_deficit * np.exp(-to_end / self.crater_length)
        return np.asarray(start * crater)


@array_dataclass
class LaidBeads:
    """Beads on n sections.

    Parameters
    ----------
    w : ndarray, shape (n, m)
        The surfaces with the beads.
    left, right : ndarray, shape (n,)
        u of their toes, metres.
    contact : ndarray, shape (n, 2)
        Contact angles at both toes, radians.
    falls : ndarray of bool, shape (n,)
        Where the pool hangs and is too wide for its surface tension: its shape is that of one that
        just holds.
    """

    w: Array
    left: Array
    right: Array
    contact: Array
    falls: Mask

    def held(self) -> LaidBeads:
        """These beads, if all their pools hold.

        Raises
        ------
        ConfigurationError
            If one would fall.
        """
        if self.falls.any():
            worst = float((self.right - self.left)[self.falls].max())
            raise ConfigurationError(
                f"a pool {1e3 * worst:.1f} mm wide would fall out of the overhead groove: lay "
                "narrower beads there",
                key="bead.weave_limit_mm",
            )
        return self


def column_widths(u: Array) -> Array:
    """Width that each column stands for, shape (n, m): half the way to both neighbours."""
    steps = np.diff(u, axis=-1)
    widths = np.zeros_like(u)
    widths[..., :-1] += 0.5 * steps
    widths[..., 1:] += 0.5 * steps
    return widths


def interpolate_rows(at: Array, x: Array, *values: Array) -> tuple[Array, ...]:
    """Interpolate rows of values linearly; beyond a row's ends its end counts.

    Parameters
    ----------
    at : ndarray, shape (n,)
        One place in each row.
    x : ndarray, shape (n, m)
        Growing along each row.
    *values : ndarray, shape (n, m)

    Returns
    -------
    tuple of ndarray, shape (n,)
    """
    rows = np.arange(len(x))
    low = np.clip((x < at[:, None]).sum(axis=1) - 1, 0, x.shape[1] - 2)
    a, b = x[rows, low], x[rows, low + 1]
    share = np.clip((at - a) / (b - a), 0.0, 1.0)
    return tuple(v[rows, low] + share * (v[rows, low + 1] - v[rows, low]) for v in values)


def surface_lengths(u: Array, w: Array) -> Array:
    """Length along each surface from its first column, shape (n, m)."""
    found = np.zeros_like(u)
    np.cumsum(np.hypot(np.diff(u, axis=1), np.diff(w, axis=1)), axis=1, out=found[:, 1:])
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Meniscus:
    """A pool's surface between toes at x = ±B/2: chord + odd + P even, of linearised Young–Laplace.

    With k, gravity square to the chord over the squared capillary length: even'' = k even - 1 and
    odd'' = k odd + x drive, zero at both toes.
    """

    half: Array
    root: Array
    hangs: Mask
    drive: Array

    def _functions(self, x: Array) -> tuple[Array, Array]:
        """Cosine and sine, hyperbolic unless the pool hangs."""
        if not self.hangs.any():
            return np.cosh(x), np.sinh(x)
        return np.where(self.hangs, np.cos(x), np.cosh(x)), np.where(
            self.hangs, np.sin(x), np.sinh(x)
        )

    def shapes(self, x: Array) -> tuple[Array, Array]:
        """`odd` and `even` at places x, shape (n, m)."""
        k = np.where(self.hangs, -1.0, 1.0) * self.root**2
        top, toe = self._functions(self.root * x), self._functions(self.root * self.half)
        even = (1 - top[0] / toe[0]) / k
        odd = self.drive * (self.half * top[1] / toe[1] - x) / k
        return odd, even

    def end_slopes(self) -> tuple[Array, Array]:
        """Slopes at the right toe of `odd`, the same at the left, and `even`, (n, 1)."""
        sign = np.where(self.hangs, -1.0, 1.0)
        cosine, sine = self._functions(self.root * self.half)
        odd = self.drive * (self.half * self.root * cosine / sine - 1) * sign / self.root**2
        return odd, -(sine / cosine) / self.root


def lay_beads(
    model: BeadModel,
    u: Array,
    w: Array,
    *,
    centre: Array,
    width: Array,
    area: Array,
    tilt: Array,
    s: Array | None = None,
) -> LaidBeads:
    """Lay a bead on each of n sections.

    The area is exact (summed by `column_widths`); what stands out of the pool's surface melts.
    The meniscus is linearised about the chord between its toes.

    Parameters
    ----------
    model : BeadModel
    u, w : ndarray, shape (n, m)
        Surfaces of the sections, metres.
    centre, width, area : ndarray, shape (n,)
        u where the wire meets the surface, width along the surface, m, and area, m².
    tilt : ndarray, shape (n,)
        Of gravity in the section, from -w towards -u, radians: 0 is level, π/2 across.
    s : ndarray, shape (n,), optional
        Lengths along the groove, growing, metres: the toes of neighbours then move together.
        Where more than a step lies between two, a stretch ends: it moves by itself.
    """
    lengths = surface_lengths(u, w)
    widths = column_widths(u)
    (middle,) = interpolate_rows(centre, u, lengths)
    toes = np.stack((middle - 0.5 * width, middle + 0.5 * width))
    steps = np.diff([] if s is None else s)
    step = float(steps.min(initial=np.inf))
    stretches = np.split(np.arange(len(u)), np.flatnonzero(steps > 1.5 * step) + 1)
    cosine, sine = np.cos(tilt), np.sin(tilt)
    for turn in range(CONTACT_STEPS + 1):
        toes = np.clip(toes, lengths[:, 0] + 2 * SOLID_REACH, lengths[:, -1] - 2 * SOLID_REACH)
        ends = [interpolate_rows(toe, lengths, u, w) for toe in toes]
        (u_left, w_left), (u_right, w_right) = ends
        half = 0.5 * (u_right - u_left)
        chord = (w_right - w_left) / (2 * half)
        meniscus, falls = _pool_between_toes(model, half, chord, cosine, sine)
        x = u - 0.5 * (u_left + u_right)[:, None]
        inside = np.abs(x) < half[:, None]
        x = np.where(inside, x, 0.0)
        odd, even = meniscus.shapes(x)
        base = 0.5 * (w_left + w_right)[:, None] + chord[:, None] * x + odd
        weights = np.where(inside, widths, 0.0)
        fills = np.einsum("ij,ij->i", weights, base - w)
        pressure = (area - fills) / np.maximum(np.einsum("ij,ij->i", weights, even), 1e-18)
        odd_slope, even_slope = (slope[:, 0] for slope in meniscus.end_slopes())
        rise = np.arctan(
            chord + odd_slope + np.stack((-pressure * even_slope, pressure * even_slope))
        )
        solid = _solid_angles(lengths, u, w, toes)
        contact = (rise - solid) * np.array((1.0, -1.0))[:, None]
        if turn == CONTACT_STEPS:
            break
        excess = contact - np.clip(contact, model.least_contact, model.largest_contact)
        way = CONTACT_STEP_GAIN * width * excess
        if len(steps):
            for on in stretches:
                way[:, on] = gaussian_filter1d(
                    way[:, on], POOL_LENGTH / step, axis=1, mode="nearest"
                )
        # A toe does not pass the other one.
        spare = np.maximum(0.5 * (toes[1] - toes[0] - NARROWEST_BEAD), 0.0)
        toes = toes + np.maximum(way, -spare) * np.array((-1.0, 1.0))[:, None]
    surface = np.where(inside, base + pressure[:, None] * even, w)
    return LaidBeads(surface, u_left, u_right, contact.T, falls)


def _pool_between_toes(
    model: BeadModel, half: Array, chord: Array, cosine: Array, sine: Array
) -> tuple[_Meniscus, Mask]:
    # Linearised about the chord: curvature is w'' / (1 + chord²)^1.5. What gravity does to a pool
    # that bulges is decided by its part square to the chord: hanging from a steep one is none.
    bending = (1 + chord**2) ** 1.5 / model.capillary_length**2
    stiffness = (cosine - chord * sine) / (1 + chord**2) * bending
    least = LEAST_STIFFNESS / half**2
    hangs = stiffness < -least
    root = np.sqrt(np.maximum(np.abs(stiffness), least))
    holds = STEEPEST_OVERHANG * pi / (2 * half)
    falls = hangs & (root > holds)
    root = np.where(falls, holds, root)
    drive = (chord * cosine + sine) * bending
    return _Meniscus(half[:, None], root[:, None], hangs[:, None], drive[:, None]), falls


def _solid_angles(lengths: Array, u: Array, w: Array, toes: Array) -> Array:
    """Slope angles of the solid at both toes, shape (2, n)."""
    found = []
    for toe in toes:
        a = interpolate_rows(toe - SOLID_REACH, lengths, u, w)
        b = interpolate_rows(toe + SOLID_REACH, lengths, u, w)
        found.append(np.arctan2(b[1] - a[1], b[0] - a[0]))
    return np.array(found)
