"""What a reader has to know before relying on a run: gaps, half steps, what went wrong."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from tjscan.core.devices import Kind
from tjscan.report.material import Material, Place
from tjscan.report.stations import stitching_findings

GAP: Final = 2.5
"""Neighbouring sections farther apart than so many times the usual distance leave a gap."""

UNSURE: Final = 0.2
"""Standard deviation of a corner in mm that is worth a word."""

ORDINARY: Final = ("stop", "arm", "resumed")
"""Events that are no warning."""


def findings(material: Material) -> Iterator[str]:
    """One sentence each, the gravest first."""
    summary = material.summary
    if not summary.complete:
        yield f"The scan is not complete: {summary.detail}."
    if material.stitching is not None:
        yield from stitching_findings(material.stitching)
        missing = {one.name for one in material.stitching.stations} - {
            place.name for place in material.places
        }
        if missing:
            yield (
                f"The recordings of {', '.join(sorted(missing))} are not there any more: their "
                "profiles, events and calibration are not in this report."
            )
    yield from material.caveats
    if material.comparison is not None:
        yield from _compared(material)
    yield from _gaps(material)
    if summary.half_steps:
        times = "once" if summary.half_steps == 1 else f"{summary.half_steps} times"
        yield f"The groove was not found at the full step {times}, and sought at half of it."
    yield from _unsure(material)
    told = [list(_place(place)) for place in material.places]
    for words in dict.fromkeys(words for of_one in told for words in of_one):
        where = [
            place.name
            for place, of_one in zip(material.places, told, strict=True)
            if words in of_one
        ]
        # What holds for every station is said once, of none.
        named = "" if len(where) == len(material.places) else f"Station {', '.join(where)}: "
        yield f"{named}{words}"


def _place(place: Place) -> Iterator[str]:
    """What to know of a scan from one place."""
    names = [event.name for event in place.log.events if event.name not in ORDINARY]
    for name in dict.fromkeys(n for n in names if n != "half step"):
        count = names.count(name)
        yield f"There is word of: {name}{'' if count == 1 else f', {count} times'}. See the events."
    if place.calibration is None:
        yield (
            "Where the sensor sits on the hand is stated in the job and was not calibrated with "
            "this program: its error is in every point, and unknown."
        )
    kinds = {place.job.arm.kind, place.job.laser.kind}
    if kinds == {Kind.REPLAYED}:
        yield "Replayed from a recording: nothing moved."
    elif Kind.REPLAYED in kinds:
        yield "The profiles were replayed from a recording while the arm moved."
    elif Kind.SIMULATED in kinds:
        yield "Simulated: no real arm and laser saw this groove."


def coverage(material: Material) -> str:
    """Which part of the groove was scanned, in words."""
    azimuths = material.azimuths
    length = f"{material.summary.groove_length_mm:.0f} mm of groove"
    if azimuths is None:
        return f"{length}; azimuths are not known in frame {material.summary.frame}"
    if _closed(material):
        return f"all of it, 360°: {length}"
    low, high = azimuths.min(), azimuths.max()
    return f"{high - low:.0f}°, from azimuth {low:.0f}° to {high:.0f}°: {length}"


def _closed(material: Material) -> bool:
    azimuths = np.sort(np.mod(material.azimuths, 360)) if material.azimuths is not None else None
    if azimuths is None or len(azimuths) < 3:
        return False
    steps = np.diff(azimuths, append=azimuths[0] + 360)
    return bool(steps.max() <= max(GAP * np.median(steps), 5.0))


def _compared(material: Material) -> Iterator[str]:
    comparison = material.comparison
    if comparison is None:
        return
    if not comparison.passed and comparison.tolerance is not None:
        yield f"Outside the tolerance of {1e3 * comparison.tolerance:g} mm (95th percentile)."
    for deviation in comparison.deviations:
        if comparison.tolerance is None or not deviation.kind.startswith("corners"):
            continue
        over = int((deviation.distances > comparison.tolerance).sum())
        if over:
            yield (
                f"{over} of {len(deviation.distances)} corners lie farther than "
                f"{1e3 * comparison.tolerance:g} mm from {comparison.reference.name}."
            )
    yield from (f"{warning[:1].upper()}{warning[1:]}." for warning in comparison.warnings)


def _gaps(material: Material) -> Iterator[str]:
    origins = np.array([section.T_r_g[:3, 3] for section in material.sections])
    steps = 1e3 * np.linalg.norm(np.diff(origins, axis=0), axis=1)
    if len(steps) < 3:
        return
    for k in np.flatnonzero(steps > GAP * np.median(steps)):
        first, second = material.sections[k], material.sections[k + 1]
        where = ""
        if not np.isnan(first.azimuth):
            a, b = np.degrees((first.azimuth, second.azimuth))
            where = f", azimuth {a:.0f}° to {b:.0f}°"
        yield f"Between two sections {steps[k]:.0f} mm of groove were not seen{where}."


def _unsure(material: Material) -> Iterator[str]:
    traces = np.array([np.trace(s.covariances, axis1=1, axis2=2).max() for s in material.sections])
    sigma = 1e3 * np.sqrt(traces)
    if (bad := int((sigma > UNSURE).sum())) > 0:
        yield (
            f"In {bad} of {len(sigma)} sections a corner is known to worse than {UNSURE:g} mm (one "
            f"standard deviation); the worst to {sigma.max():.2f} mm."
        )
