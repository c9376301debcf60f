"""What is at the root along the groove: a root bead or face, an opening, tacks, or passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.root import OPEN_ROOT, ROOT_NOT_SEEN
from tjscan.groove.section import TACK_WELD
from tjscan.planning.bead import PlannedBead
from tjscan.planning.wps import WeldingProcedure

RootKind = Literal["closed", "open", "welded"]
"""Closed by a bead or by the faces themselves, open, or under passes that are welded."""

Span = tuple[float, float]

HIDDEN_ROOT_CONDITIONS: Final = (TACK_WELD, ROOT_NOT_SEEN)
"""Conditions of a section that does not show whether its root is open."""


@dataclass(frozen=True, slots=True, eq=False)
class RootAlongGroove:
    """The root at places along a groove.

    Parameters
    ----------
    s : ndarray, shape (k,)
        Lengths along the groove, metres.
    openness : ndarray, shape (k,)
        1 for open and 0 for closed; between both if a section does not show it and its neighbours
        differ.
    tacked : ndarray of bool, shape (k,)
        Whether a tack weld covers it.
    length : float
        Of the groove, metres.
    closed : bool
        Whether the groove closes.
    """

    s: Array
    openness: Array
    tacked: NDArray[np.bool_]
    length: float
    closed: bool

    def openness_at(self, s: Array) -> Array:
        """The same at lengths (m,), changing smoothly between sections.

        A corner in it would be one in the beads' paths, which no finer sampling would straighten.
        """
        period = self.length if self.closed else None
        linear = np.interp(s, self.s, self.openness, period=period)
        return np.asarray(linear**2 * (3 - 2 * linear))

    def is_open_between(self, begin: float, end: float) -> bool:
        """Whether the root is open anywhere between two lengths."""
        inside = self.s[(self.s > begin) & (self.s < end)]
        return bool((self.openness_at(np.concatenate(((begin,), inside, (end,)))) > 0).any())

    def tack_spans(self, tack_length: float) -> tuple[Span, ...]:
        """From where to where tacks may reach, metres: half their length beyond where they show."""
        flagged = np.concatenate(((False,), self.tacked, (False,)))
        changes = np.flatnonzero(flagged[1:] != flagged[:-1])
        return tuple(
            (float(self.s[a] - 0.5 * tack_length), float(self.s[b - 1] + 0.5 * tack_length))
            for a, b in zip(changes[::2], changes[1::2], strict=True)
        )


def closed_root(s: Array, length: float, *, closed: bool) -> RootAlongGroove:
    """A root that is closed everywhere, without tacks; parameters as of `RootAlongGroove`."""
    return RootAlongGroove(s, np.zeros(len(s)), np.zeros(len(s), dtype=bool), length, closed)


def root_of_sections(
    sections: Sequence[MeasuredSection], s: Array, length: float, *, closed: bool
) -> RootAlongGroove:
    """The root as sections show it; for one that does not, the sections beside it count.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In their order along the groove.
    s : ndarray, shape (k,)
        Their lengths along the groove, metres.
    length : float
        Of the groove, metres.
    closed : bool
        Whether it closes.
    """
    tacked = np.array([TACK_WELD in section.conditions for section in sections])
    shown = np.array(
        [not set(HIDDEN_ROOT_CONDITIONS) & set(section.conditions) for section in sections]
    )
    openness = np.array([float(OPEN_ROOT in section.conditions) for section in sections])
    if shown.any():
        period = length if closed else None
        openness = np.interp(s, s[shown], openness[shown], period=period)
    return RootAlongGroove(s, openness, tacked, length, closed)


def check_passes_are_there(root: RootAlongGroove, after_pass: int) -> None:
    """Refuse sections that show no weld where passes were welded.

    Raises
    ------
    ConfigurationError
        If the root is open somewhere.
    """
    if after_pass > 0 and (root.openness > 0).any():
        at = 1e3 * root.s[int(np.argmax(root.openness > 0))]
        raise ConfigurationError(
            f"at s = {at:.0f} mm the sections show an open root: was it scanned before the first "
            "pass?",
            key="--after-pass",
        )


def spans_to_skip(root: RootAlongGroove, span: Span, wps: WeldingProcedure) -> tuple[Span, ...]:
    """Parts of a bead's path over which it is not laid because of tacks; metres.

    It ends `overlap` on each tack, and goes on as much before its end.

    Parameters
    ----------
    root : RootAlongGroove
        Where tacks are.
    span : tuple of float
        Begin and end of the bead along the groove; beyond its length if it closes.
    wps : WeldingProcedure
        Whether tacks are skipped.
    """
    if wps.root.tacks == "fuse":
        return ()
    turns = (-root.length, 0.0, root.length) if root.closed else (0.0,)
    over = wps.sequence.overlap
    inner = [(a + over, b - over) for a, b in root.tack_spans(wps.root.tack_length)]
    shifted = [(max(a + t, span[0]), min(b + t, span[1])) for t in turns for a, b in inner]
    return tuple(sorted((a, b) for a, b in shifted if b > a))


def without_spans(bead: PlannedBead, spans: Sequence[Span]) -> tuple[PlannedBead, ...]:
    """A bead in parts, without some spans at whose ends it has points."""
    middles = 0.5 * (bead.s[1:] + bead.s[:-1])
    laid = np.ones(len(middles), dtype=bool)
    for a, b in spans:
        laid &= (middles < a) | (middles > b)
    changes = np.flatnonzero(np.diff(np.concatenate(((False,), laid, (False,))).astype(int)))
    return bead.cut([(int(a), int(b)) for a, b in zip(changes[::2], changes[1::2], strict=True)])
