"""Reading a section with what the sections before it say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Protocol

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.prior import GroovePrior
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile
from tjscan.scanning.section import ProfileView, ScannedSection
from tjscan.scanning.tacks import with_tack_named

MOST_SECTIONS: Final = 30
"""Sections that are looked back upon."""


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
