"""What is known of a stitching so far: what its pictures and its refusals show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tjscan.core.frames import Array
from tjscan.stitching.overlaps import Overlap, arc_of
from tjscan.stitching.registration import Registration


@dataclass(frozen=True, slots=True, eq=False)
class Draft:
    """Stations, where they meet, and how they fit there.

    Parameters
    ----------
    names : tuple of str
        Of the stations.
    azimuths : tuple of ndarray
        Of each station's sections, radians.
    overlaps : tuple of Overlap
        All of them, the small ones too.
    registrations : tuple of Registration
        As far as it came.
    """

    names: tuple[str, ...]
    azimuths: tuple[Array, ...]
    overlaps: tuple[Overlap, ...]
    registrations: tuple[Registration, ...] = ()

    def words(self, overlap: Overlap) -> str:
        """An overlap in words."""
        a, b = self.names[overlap.first], self.names[overlap.second]
        one, other = overlap.sections
        return (
            f"stations {a} and {b} overlap at azimuth {np.degrees(overlap.arc.middle):.0f}° by "
            f"{np.degrees(overlap.arc.length):.1f}° ({one} and {other} sections)"
        )

    def reach(self) -> str:
        """What each station reaches over, in words."""
        arcs = [arc_of(azimuths) for azimuths in self.azimuths]
        return ", ".join(
            f"{name} reaches from {np.degrees(arc.start):.0f}° to {np.degrees(arc.end):.0f}°"
            for name, arc in zip(self.names, arcs, strict=True)
        )
