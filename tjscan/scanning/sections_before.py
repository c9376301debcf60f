"""Reading a section with what the sections before it show: a prior, and tack welds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isnan
from typing import Final, Protocol

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.prior import GroovePrior
from tjscan.groove.root import BURIED_CHORDS, WELD_IN_ROOT
from tjscan.groove.section import TACK_WELD, GrooveSection, section_from_points
from tjscan.laser.profile import Profile
from tjscan.scanning.checks import BEAD_HEIGHT, largest_root_width_change
from tjscan.scanning.section import ProfileView, ScannedSection

MOST_SECTIONS: Final = 30
"""Sections that are looked back upon."""

KNOWN_ROOT: Final = 1e-3
"""Standard deviation of a corner of the root in metres from which a view does not show it well: a
fifth of a usual root's width."""

STEADY_LENGTH: Final = 0.02
"""Metres of groove over which a root may go on widening: round a joint it goes to and fro."""


class GrooveReader(Protocol):
    """Reads the groove in a profile, or raises GrooveNotFound."""

    def __call__(self, profile: Profile, *, prior: GroovePrior | None = None) -> GrooveSection:
        """Read, with what the sections before the profile's say of it; with None, without."""
        ...


def prior_for_view(view: ProfileView, sections: Sequence[ScannedSection]) -> GroovePrior:
    """What the finished sections say of the one that a view is taken for."""
    before = [one for one in sections if one.view.index < view.index][-MOST_SECTIONS:]
    if not before:
        return GroovePrior()
    origins = np.array([one.T_b_g[:3, 3] for one in before])
    steps = np.linalg.norm(np.diff(origins, axis=0), axis=1)
    # To where the groove is not read yet, the sensor has gone as far as it.
    last = float(np.linalg.norm(view.T_b_s[:3, 3] - before[-1].view.T_b_s[:3, 3]))
    aways = np.append(steps, last)[::-1].cumsum()[::-1]
    return GroovePrior.from_sections(
        [
            (one.groove.evidence, float(away))
            for one, away in zip(before, aways, strict=True)
            if one.groove.evidence is not None
        ]
    )


def read_section(
    read: GrooveReader,
    view: ProfileView,
    T_s_t: Array | Callable[[GrooveSection], Array],
    before: Sequence[ScannedSection],
) -> ScannedSection:
    """Read a section as a scan does: with what the sections before it say, tack welds named.

    Parameters
    ----------
    read : callable
        The reader of the scan.
    view : ProfileView
    T_s_t : ndarray, shape (4, 4), or callable
        Frame t in the sensor, or what gives it for a groove.
    before : sequence of ScannedSection
        The finished sections.

    Raises
    ------
    GrooveNotFound
        As the reader does.
    """
    groove = read(view.profile, prior=prior_for_view(view, before))
    T = T_s_t(groove) if callable(T_s_t) else T_s_t
    return with_tack_named(ScannedSection(view, groove, T), before)


def root_is_seen(groove: GrooveSection) -> bool:
    """Whether the root shows, or what covers it; another view may show one that does not."""
    return not groove.absent or groove.on_tack or not isnan(groove.root_opening)


def root_is_known(groove: GrooveSection) -> bool:
    """Whether the root's corners are known well, as far as they are there."""
    variances = np.trace(groove.corner_covariances_s[1:], axis1=1, axis2=2)
    known = bool(np.sqrt(variances.max()) < KNOWN_ROOT)
    return known if not groove.absent else root_is_seen(groove)


def with_tack_named(found: ScannedSection, before: Sequence[ScannedSection]) -> ScannedSection:
    """Name a tack weld where weld metal lies higher in the root than before it.

    One profile shows a convex face in the root; whether that is the root bead or a tack over it
    shows the root that was seen last: no groove widens and grows shallower so fast.

    Parameters
    ----------
    found : ScannedSection
        As its profile alone was read.
    before : sequence of ScannedSection
        The sections before it.
    """
    groove = found.groove
    last = next((one for one in reversed(before) if _shows_root(one.groove)), None)
    if last is None or WELD_IN_ROOT not in groove.conditions:
        return found
    away = float(np.linalg.norm(found.T_b_g[:3, 3] - last.T_b_g[:3, 3]))
    wider = groove.root_width - last.groove.root_width
    shallower = last.groove.depth - groove.depth
    if (
        wider < largest_root_width_change(last.groove, min(away, STEADY_LENGTH))
        or shallower < BEAD_HEIGHT
    ):
        return found
    return replace(found, groove=_buried(groove))


def _shows_root(groove: GrooveSection) -> bool:
    return not groove.absent and root_is_known(groove)


def _buried(groove: GrooveSection) -> GrooveSection:
    """The same section with its root under a tack weld."""
    covariance = np.zeros((8, 8))
    covariance[:6, :6], covariance[6:, 6:] = groove.covariance_s, groove.tangent_covariance
    up = groove.points_s[1] - groove.points_s[2]
    for k, along in ((2, up / np.linalg.norm(up)), (4, groove.leg_s)):
        way = BURIED_CHORDS * groove.root_width * along[[0, 2]]
        covariance[k : k + 2, k : k + 2] += np.outer(way, way)
    section = section_from_points(
        groove.points_s,
        wall_s=groove.wall_s,
        leg_s=groove.leg_s,
        rms=groove.rms,
        covariance=covariance,
    )
    others = tuple(one for one in groove.conditions if one != WELD_IN_ROOT)
    return replace(
        section,
        model=groove.model,
        conditions=(TACK_WELD, *others),
        absent=("p3", "p4"),
        evidence=groove.evidence,
    )
