"""A weld along its groove: sections at stations, the metal in them, and how a bead changes them."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.welding.bead import BeadModel, LaidBeads, column_widths, interpolate_rows, lay_beads
from tjscan.welding.shrinkage import ShrinkageModel, close_groove

Rows = NDArray[np.intp] | Mask | slice
"""Some of the stations."""


@array_dataclass
class WeldState:
    """Sections of a weld at n stations. Columns are points of the material.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Lengths along the groove, growing, metres.
    u, base, w : ndarray, shape (n, m)
        Columns of each section, from brace or left plate to leg or right plate: place across,
        height of the groove's face, and of the surface over it, metres.
    toes : ndarray, shape (n, 2)
        Columns (fractions count) at which the finished weld shall meet brace and leg.
    tilt : ndarray, shape (n,)
        Of gravity in the section, as `lay_beads` takes it, radians.
    first_area : ndarray, shape (n,)
        Of the first bead, zero before it, m².
    closed : ndarray, shape (n,)
        Transverse shrinkage so far, metres.
    """

    s: Array
    u: Array
    base: Array
    w: Array
    toes: Array
    tilt: Array
    first_area: Array
    closed: Array

    @classmethod
    def of_groove(cls, s: Array, u: Array, w: Array, toes_u: Array, tilt: Array) -> WeldState:
        """The state before the first bead.

        Parameters
        ----------
        s, u, w, tilt : ndarray
            As above; u may be one row for all.
        toes_u : ndarray, shape (n, 2)
            u of both toes, metres.
        """
        u = np.broadcast_to(u, w.shape)
        index = np.broadcast_to(np.arange(u.shape[1], dtype=float), u.shape)
        toes = np.column_stack([interpolate_rows(toe, u, index)[0] for toe in toes_u.T])
        none = np.zeros(len(s))
        return cls(s, u, w, w, toes, np.broadcast_to(tilt, s.shape), none, none)

    def part(self, rows: Rows) -> WeldState:
        """The same at some of the stations."""
        return WeldState(*(getattr(self, one.name)[rows] for one in fields(self)))

    def replaced(self, rows: Rows, part: WeldState) -> WeldState:
        """The same with other values at some of the stations."""
        values = {one.name: getattr(self, one.name).copy() for one in fields(self)}
        for name, array in values.items():
            array[rows] = getattr(part, name)
        return WeldState(**values)

    @property
    def toe_points(self) -> Array:
        """Both toes, u and w, on the groove's faces, shape (n, 2, 2), metres."""
        index = np.broadcast_to(np.arange(self.u.shape[1], dtype=float), self.u.shape)
        ends = [interpolate_rows(toe, index, self.u, self.base) for toe in self.toes.T]
        return np.moveaxis(np.array(ends), 2, 0)

    @property
    def metal_area(self) -> Array:
        """Area of weld metal, shape (n,), m²."""
        return np.asarray(np.einsum("ij,ij->i", column_widths(self.u), self.w - self.base))

    def with_beads(
        self, laid: LaidBeads, shrinkage: ShrinkageModel, factor: float | Array
    ) -> WeldState:
        """The state after beads, and after what they shrink.

        Parameters
        ----------
        laid : LaidBeads
            At these stations.
        shrinkage : ShrinkageModel
        factor : float or ndarray, shape (n,)
            Shrinkage over that of the model.
        """
        after = replace(self, w=laid.w)
        metal = after.metal_area
        first = np.where(self.first_area > 0, self.first_area, metal)
        closed = np.maximum(factor * shrinkage.transverse(metal, first), self.closed)
        by = closed - self.closed
        u, base, w = close_groove(self.u, self.base, laid.w, by, shrinkage.turn_per_metre * by)
        return replace(self, u=u, base=base, w=w, first_area=first, closed=closed)

    def lay(
        self,
        model: BeadModel,
        shrinkage: ShrinkageModel,
        *,
        centre: Array,
        width: Array,
        area: Array,
        factor: float = 1.0,
    ) -> WeldState:
        """The state after one more bead; arguments as of `lay_beads` and `with_beads`.

        Raises
        ------
        ConfigurationError
            If a pool would fall.
        """
        laid = lay_beads(
            model, self.u, self.w, centre=centre, width=width, area=area, tilt=self.tilt, s=self.s
        )
        return self.with_beads(laid.held(), shrinkage, factor)

    def outline(self, s: float) -> Array:
        """Surface of the section at a length along the groove, shape (m, 2), metres."""
        at = float(np.clip(np.interp(s, self.s, np.arange(len(self.s))), 0, len(self.s) - 1))
        low = min(int(at), len(self.s) - 2) if len(self.s) > 1 else 0
        share = at - low
        high = min(low + 1, len(self.s) - 1)
        rows = np.stack((self.u, self.w), axis=-1)[[low, high]]
        return np.asarray((1 - share) * rows[0] + share * rows[1])
