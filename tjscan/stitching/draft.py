"""Intermediate results of a stitching, for its pictures and refusals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tjscan.core.frames import Array
from tjscan.stitching.overlaps import StationOverlap, arc_of_azimuths
from tjscan.stitching.registration import StationRegistration


@dataclass(frozen=True, slots=True, eq=False)
class StitchingDraft:
    """Stitching as far as it has come: stations, overlaps and registrations, for messages.

    Parameters
    ----------
    names : tuple of str
        Of the stations.
    azimuths : tuple of ndarray
        Of each station's sections, radians.
    overlaps : tuple of StationOverlap
        All of them, the small ones too.
    registrations : tuple of StationRegistration
        As far as it came.
    """

    names: tuple[str, ...]
    azimuths: tuple[Array, ...]
    overlaps: tuple[StationOverlap, ...]
    registrations: tuple[StationRegistration, ...] = ()

    def describe_overlap(self, overlap: StationOverlap) -> str:
        """Describe an overlap in a text: its stations, azimuth, length and sections."""
        a, b = self.names[overlap.first], self.names[overlap.second]
        one, other = overlap.sections
        return (
            f"stations {a} and {b} overlap at azimuth "
            f"{np.degrees(overlap.arc.middle_azimuth):.0f}° by "
            f"{np.degrees(overlap.arc.span_angle):.1f}° ({one} and {other} sections)"
        )

    def describe_coverage(self) -> str:
        """Describe in a text the azimuths that each station covers."""
        arcs = [arc_of_azimuths(azimuths) for azimuths in self.azimuths]
        return ", ".join(
            f"{name} reaches from {np.degrees(arc.start):.0f}° to {np.degrees(arc.end):.0f}°"
            for name, arc in zip(self.names, arcs, strict=True)
        )
