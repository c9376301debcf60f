"""The weld of a simulation: metal lies where the torch truly was, and simulated lasers see it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from math import exp, pi, sqrt
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.random import Generator
from scipy.signal import lfilter

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, array_dataclass
from tjscan.core.units import MM, PERCENT_UNIT, SettingsTable
from tjscan.welding.bead import BeadModel, LaidBeads, lay_beads
from tjscan.welding.shrinkage import ShrinkageModel
from tjscan.welding.state import Rows, WeldState


@array_dataclass
class TorchTrace:
    """What a torch truly did while its arc burned: k samples in their order.

    Parameters
    ----------
    s : ndarray, shape (k,)
        Lengths along the groove, metres; they grow, or fall if it went backwards. In a groove
        that closes they go on beyond its length.
    u : ndarray, shape (k,)
        Across, where the wire points straight into the groove, metres.
    speed, feed : ndarray, shape (k,)
        Of travel and of the wire, m/s.
    heat_input : ndarray, shape (k,)
        J/m.
    weave : ndarray, shape (k,)
        Width of the weave, metres.
    """

    s: Array
    u: Array
    speed: Array
    feed: Array
    heat_input: Array
    weave: Array

    def at(self, s: Array) -> TorchTrace:
        """The samples interpolated at lengths along the groove."""
        order = np.argsort(self.s, kind="stable")
        columns = (getattr(self, one.name)[order] for one in fields(self)[1:])
        return TorchTrace(s, *(np.interp(s, self.s[order], column) for column in columns))


SLIP_LENGTH, WANDER_LENGTH = 30e-3, 15e-3
"""Lengths of correlation of the wire's slip and of the arc's wander, metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WeldFaults(SettingsTable):
    """What goes otherwise than set in a simulated weld; the defaults are none.

    Parameters
    ----------
    gain : float
        Share by which more metal is laid down than wire and speed give.
    slip : float
        Standard deviation of the wire's slip along a bead, as a share.
    offset : float
        Of the wire's tip from where the torch's pose has it, along u, metres.
    wander : float
        Standard deviation of the arc's place about the wire, metres.
    width_sigma : float
        Standard deviation of a bead's width as a share, one value a bead.
    shrinkage : float
        Share by which the groove shrinks more than the model has it.
    """

    gain: Annotated[float, Ge(-50), Le(50), PERCENT_UNIT] = 0.0
    slip: Annotated[float, Ge(0), Le(30), PERCENT_UNIT] = 0.0
    offset: Annotated[float, Ge(-5), Le(5), MM] = 0.0
    wander: Annotated[float, Ge(0), Le(5), MM] = 0.0
    width_sigma: Annotated[float, Ge(0), Le(30), PERCENT_UNIT] = 0.0
    shrinkage: Annotated[float, Ge(-100), Le(100), PERCENT_UNIT] = 0.0


def correlated_noise(s: Array, length: float, sigma: float, rng: Generator) -> Array:
    """Noise of first order along evenly spaced places, shape (n,).

    Parameters
    ----------
    s : ndarray, shape (n,)
        Metres.
    length : float
        Of correlation, metres.
    sigma : float
        Standard deviation.
    rng : numpy.random.Generator
    """
    step = float(np.median(np.diff(s))) if len(s) > 1 else length
    rho = exp(-step / length)
    drive = rng.standard_normal(len(s))
    drive[1:] *= sqrt(1 - rho**2)
    return np.asarray(sigma * lfilter([1.0], [1.0, -rho], drive))


@dataclass(slots=True)
class WeldWorld:
    """A simulated weld: beads lie where the torch truly was.

    Parameters
    ----------
    state : WeldState
        Now.
    wire_diameter, efficiency : float
        Of the wire, metres, and the share of it that ends in the weld.
    model : BeadModel
    shrinkage : ShrinkageModel
    faults : WeldFaults
    rng : numpy.random.Generator
        Of what wanders.
    period : float
        Length of a groove that closes, metres; zero for one that does not.
    held_length : float
        Over which the cold plates before and behind an arc hold the groove open, metres: with zero
        it closes by a step at either end.
    """

    state: WeldState
    wire_diameter: float
    efficiency: float
    rng: Generator
    model: BeadModel = field(default_factory=BeadModel)
    shrinkage: ShrinkageModel = field(default_factory=ShrinkageModel)
    faults: WeldFaults = field(default_factory=WeldFaults)
    period: float = 0.0
    held_length: float = 0.0

    def weld(self, trace: TorchTrace) -> Array:
        """Lay the bead of one arc, from its ignition to its crater.

        Returns
        -------
        ndarray, shape (n,)
            Area that it added at each station, m².

        Raises
        ------
        ConfigurationError
            If the torch stood still or ran without wire.
        """
        if not ((trace.speed > 0).all() and (trace.feed > 0).all()):
            raise ConfigurationError("a torch that burns needs wire and has to move", key="weld")
        before, count = self.state.metal_area, len(self.state.s)
        low, high = float(trace.s.min()), float(trace.s.max())
        turns = np.zeros(1)
        if self.period > 0:
            turns = np.arange(np.floor(low / self.period), high // self.period + 1)
        s = (self.state.s + self.period * turns[:, None]).ravel()
        on = np.flatnonzero((s >= low) & (s <= high))
        for first in range(0, len(on), count):  # no station twice at once
            passed = on[first : first + count]
            self._lay(passed % count, s[passed], trace)
        return self.state.metal_area - before

    def lay_shape(self, part: WeldState, centre: Array, width: Array, area: Array) -> LaidBeads:
        """Shape of the beads; a world of other equations has its own."""
        of_bead = {"centre": centre, "width": width, "area": area}
        return lay_beads(self.model, part.u, part.w, **of_bead, tilt=part.tilt, s=part.s).held()

    def _lay(self, rows: Rows, s: Array, trace: TorchTrace) -> None:
        """Lay the bead at some stations, which the torch passed at lengths s along its way."""
        part, faults = replace(self.state.part(rows), s=s), self.faults
        torch = trace.at(s)
        slip = correlated_noise(s, SLIP_LENGTH, faults.slip, self.rng)
        wander = correlated_noise(s, WANDER_LENGTH, faults.wander, self.rng)
        ends = self.model.area_along_bead(np.abs(s - trace.s[0]), np.abs(trace.s[-1] - s))
        wire = 0.25 * pi * self.wire_diameter**2 * self.efficiency
        area = (1 + faults.gain) * (1 + slip) * ends * wire * torch.feed / torch.speed
        width = self.model.bead_width(torch.heat_input, torch.weave)
        width = width * (1 + faults.width_sigma * self.rng.standard_normal())
        centre = torch.u + faults.offset + wander
        laid = self.lay_shape(part, centre, width, area)
        factor = (1 + faults.shrinkage) * np.ones(len(s))
        if self.held_length > 0:
            from_end = np.minimum(np.abs(s - trace.s[0]), np.abs(trace.s[-1] - s))
            factor *= -np.expm1(-((from_end / self.held_length) ** 2))
        after = part.with_beads(laid, self.shrinkage, factor)
        self.state = self.state.replaced(rows, replace(after, s=self.state.s[rows]))
