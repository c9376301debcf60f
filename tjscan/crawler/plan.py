"""What a crawl job asks of the crawler: the course, how to align, the passes, what stops it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen

from tjscan.core.bead_segments import BeadSegments, weave_swing
from tjscan.core.units import (
    DEG,
    LIST_OR_WORD_IN_FILE,
    M_PER_MIN,
    MM,
    MM_S,
    SECONDS,
    FileUnit,
    SettingsTable,
)
from tjscan.power.height import ArcHeightSettings
from tjscan.power.sequence import ArcLimits

NEWTON_METRE_UNIT = FileUnit("n_m")
METRE_UNIT = FileUnit("m")


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignmentSettings(SettingsTable):
    """The table [alignment]: the way out and back before the first pass.

    Parameters
    ----------
    speed : float
        Out, m/s.
    return_speed : float
        Back to the start, before the first pass and after each, m/s.
    length, longest : float
        It goes out as far as `length`, and on up to `longest` until it is aligned; metres. From
        where the joint was found to bend, `longest` counts from zero.
    offset, offset_sigma : float
        Aligned is a torch within `offset` of the joint, known to `offset_sigma`; metres.
    in_view : float
        Seconds for which the joint must have been seen before anything moves.
    """

    speed: Annotated[float, Gt(0), Le(100), MM_S] = 0.020
    return_speed: Annotated[float, Gt(0), Le(100), MM_S] = 0.020
    length: Annotated[float, Ge(50), Le(1e5), MM] = 0.6
    longest: Annotated[float, Ge(50), Le(1e5), MM] = 1.2
    offset: Annotated[float, Gt(0), Le(50), MM] = 1e-3
    offset_sigma: Annotated[float, Gt(0), Le(50), MM] = 5e-3
    in_view: Annotated[float, Ge(0), Le(60), SECONDS] = 1.0

    def __post_init__(self) -> None:
        if not self.length <= self.longest:
            raise ValueError("length_mm must not be greater than longest_mm")


@dataclass(frozen=True, slots=True, kw_only=True)
class WeldSettings(SettingsTable):
    """The table [weld]: from where to where, and who answers for it.

    Parameters
    ----------
    length : float
        Of the weld, metres.
    run_up : float
        The vehicle starts so far before the weld, metres: what is left of a reversal dies out.
    procedure, welder, joint : str
        What the weld's log names: welding procedure specification, welder, and the joint.
    wps : str, optional
        File of the welding procedure specification, counted from the job's folder; an arc by
        ``[power]``, and passes planned from looks, need one.
    layers : tuple of int
        Beads of each layer, from the root on: each pass is planned when the vehicle is back at the
        start, from what it saw on its way. Without, passes stay as the job states them.
    tilt : float
        Of gravity in the section, to the left plate; zero if the joint is level or climbs; radians.
    arc : ArcLimits
        Of an arc by ``[power]``.
    height : ArcHeightSettings, optional
        How the torch's height follows that arc's current; without, it stays as planned.
    """

    length: Annotated[float, Gt(0), Le(1000), METRE_UNIT] = 1.0
    run_up: Annotated[float, Ge(0), Le(5000), MM] = 0.4
    procedure: str = ""
    welder: str = ""
    joint: str = ""
    wps: Annotated[str | None, MinLen(1)] = None
    layers: Annotated[tuple[Annotated[int, Ge(1)], ...], MaxLen(50), LIST_OR_WORD_IN_FILE] = ()
    tilt: Annotated[float, Ge(-90), Le(90), DEG] = 0.0
    arc: ArcLimits = field(default_factory=ArcLimits)
    height: ArcHeightSettings | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardSettings(SettingsTable):
    """The table [guards]: what stops the crawler.

    Parameters
    ----------
    blind_travel : float
        How far it may go without a reading of the joint, metres.
    blind_time : float
        How long, seconds.
    filled_travel : float
        How far it may go along a joint that a tack fills up to the plates, metres.
    field : float
        How far from the middle of the laser's line the joint may be, metres.
    torque : float
        Of a motor at its sprocket, N m: what it has, or less.
    torch_off : float
        How far beside its path the torch may be while the arc burns, metres: what its axis leaves
        of the estimate. 1 mm is what Kermorgant (2018) allows a first pass.
    torch_sigma : float
        How well its place must be known meanwhile, as a standard deviation, metres: by default
        as well as the paper starts a weld.
    """

    blind_travel: Annotated[float, Gt(0), Le(1000), MM] = 0.020
    blind_time: Annotated[float, Gt(0), Le(60), SECONDS] = 2.0
    filled_travel: Annotated[float, Gt(0), Le(1000), MM] = 0.060
    field: Annotated[float, Gt(0), Le(500), MM] = 0.022
    torque: Annotated[float, Gt(0), Le(1000), NEWTON_METRE_UNIT] = 84.0
    torch_off: Annotated[float, Gt(0), Le(50), MM] = 1e-3
    torch_sigma: Annotated[float, Gt(0), Le(50), MM] = 0.6e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class CourseSettings(SettingsTable):
    """The table [course]: how the joint runs in the hull, as drawings or templates show.

    Parameters
    ----------
    radius : float or None
        In the hull's surface, metres, positive if it bends to the right of who goes along it;
        None if it is straight.
    radius_sigma : float
        Its standard deviation, as a share of it.
    """

    radius: Annotated[float | None, METRE_UNIT] = None
    radius_sigma: Annotated[float, Gt(0), Le(1)] = 0.02

    @property
    def curvature(self) -> float:
        """1/m, positive to the right."""
        return 0.0 if self.radius is None else 1.0 / self.radius

    @property
    def curvature_sigma(self) -> float:
        """Standard deviation of the curvature, 1/m: a straight joint is straight to 1 in 10 km."""
        return max(abs(self.curvature) * self.radius_sigma, 1e-4)


@dataclass(frozen=True, slots=True, kw_only=True)
class PassRow(SettingsTable):
    """How a pass is welded, all along or at a place.

    Parameters
    ----------
    speed : float
        Along the joint, m/s.
    offset : float
        Of the torch's path from the joint's centre, positive to the right, metres.
    height : float
        Of the torch over the hull, out of it, metres; below zero inside the groove.
    weave : float
        How far it swings to either side of that, metres; 0 for a stringer bead.
    feed : float, optional
        Wire feed, m/s; not stated if left out.
    """

    speed: Annotated[float, Gt(0), Le(100), MM_S] = 5e-3
    offset: Annotated[float, Ge(-50), Le(50), MM] = 0.0
    height: Annotated[float, Ge(-100), Le(100), MM] = 0.0
    weave: Annotated[float, Ge(0), Le(50), MM] = 0.0
    feed: Annotated[float | None, Gt(0), Le(100), M_PER_MIN] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PassSegment(PassRow):
    """A row of the list `segments` of a pass; between two rows all is linear.

    Parameters
    ----------
    s : float
        Along the joint from where the weld begins, metres.
    """

    s: Annotated[float, Ge(-1e4), Le(1e6), MM]


@dataclass(frozen=True, slots=True, kw_only=True)
class PassSettings(PassRow):
    """One welding pass, a table [[pass]]: a row that holds all along, or `segments`.

    Parameters
    ----------
    weave_period : float
        Of a whole swing there and back, dwells included, seconds.
    dwell : float
        How long it stays at each end, seconds.
    edge_gap : float, optional
        Weave from edge to edge of the joint, as these were read there, and turn so far inside of
        each, metres; `weave` is not stated then.
    procedure : str, optional
        Which welding procedure specification holds; the job's if left out.
    segments : tuple of PassSegment
        Rows along the pass, in their order.
    """

    weave_period: Annotated[float, Gt(0), Le(60), SECONDS] = 2.0
    dwell: Annotated[float, Ge(0), Le(10), SECONDS] = 0.0
    edge_gap: Annotated[float | None, Ge(0), Le(50), MM] = None
    procedure: Annotated[str | None, MinLen(1)] = None
    segments: Annotated[tuple[PassSegment, ...], MaxLen(1000), LIST_OR_WORD_IN_FILE] = ()

    def __post_init__(self) -> None:
        own = {field.name: getattr(self, field.name) for field in fields(PassRow)}
        if self.segments and PassRow(**own) != PassRow():
            raise ValueError("segments state speed, offset, height, weave and feed: state no other")
        if self.edge_gap is not None and (self.table.weave.any() or self.table.offset.any()):
            raise ValueError(
                "edge_gap_mm states where a swing ends: state no weave_mm and no offset_mm"
            )
        weaves = self.edge_gap is not None or self.table.weave.max() > 0
        if weaves and not 2 * self.dwell < self.weave_period:
            raise ValueError("two dwell_s leave no time to swing: make weave_period_s longer")

    @property
    def table(self) -> BeadSegments:
        """What holds along the pass; one row if it has no segments."""
        rows: tuple[PassRow, ...] = self.segments or (self,)
        names = [field.name for field in fields(BeadSegments)]
        values = [[getattr(row, name, 0.0) for row in rows] for name in names]
        return BeadSegments(*np.array(values, dtype=np.float64))  # of a feed None: NaN

    def swing(self, time: float) -> float:
        """How a weave swings, from -1 to 1, a time after the arc was struck, seconds."""
        return float(weave_swing(np.array(time), self.weave_period, self.dwell))


def with_rows(one: PassSettings, table: BeadSegments) -> PassSettings:
    """A pass with other rows, shape (n,) each; its weave's times and its procedure stay."""
    columns = [getattr(table, name.name).tolist() for name in fields(BeadSegments)]
    names = [name.name for name in fields(BeadSegments)]
    rows = tuple(
        PassSegment(**dict(zip(names, row, strict=True))) for row in zip(*columns, strict=True)
    )
    kept = {name: getattr(one, name) for name in ("weave_period", "dwell", "procedure")}
    return PassSettings(segments=rows, **kept)
