"""How wire feed, stick-out, current and voltage of a constant-voltage arc hang together."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Annotated

from annotated_types import Ge, Gt

from tjscan.core.units import SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcLaw(SettingsTable):
    """Melting of the wire, v = a I + b L I², and voltage along the load line, U = U0 + r I.

    The defaults are for steel wire of 1.2 mm, as Lesnewich (1958) has the form of the law, and for
    the load line of metal active gas welding in IEC 60974-1. Fit them to the wire in use.

    Parameters
    ----------
    arc_melting : float
        a, m/(A s).
    resistive_melting : float
        b, 1/(A² s).
    open_voltage : float
        U0, V.
    load_resistance : float
        r, ohm.
    """

    arc_melting: Annotated[float, Gt(0)] = 0.29e-3
    resistive_melting: Annotated[float, Gt(0)] = 5.2e-5
    open_voltage: Annotated[float, Ge(0)] = 14.0
    load_resistance: Annotated[float, Ge(0)] = 0.05

    def current(self, feed: float, stick_out: float) -> float:
        """Current, A, at which as much wire melts as is fed.

        Parameters
        ----------
        feed : float
            Of the wire, m/s.
        stick_out : float
            From the contact tip to the arc, metres.
        """
        a, b = self.arc_melting, self.resistive_melting * stick_out
        return 2 * feed / (a + sqrt(a * a + 4 * b * feed))

    def stick_out(self, feed: float, current: float) -> float:
        """Stick-out, metres, that a feed, m/s, and a current, A, show."""
        return (feed - self.arc_melting * current) / (self.resistive_melting * current**2)

    def voltage(self, current: float) -> float:
        """Voltage, V, at a current, A."""
        return self.open_voltage + self.load_resistance * current
