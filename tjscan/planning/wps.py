"""The tables of a welding procedure specification (WPS): windows and values that the user states.

Nothing here has a default: the user states what may be welded, and how. A plan states what was
computed; it never claims to comply with anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from pydantic import AfterValidator, model_validator

from tjscan.core.config import StrictFileModel, read_toml, validate_table
from tjscan.core.frames import Array
from tjscan.core.units import (
    DEG,
    LIST_OR_WORD_IN_FILE,
    LITRE_PER_MINUTE,
    M_PER_MIN,
    MM,
    MM2,
    SECONDS,
    FileUnit,
    PoseSettings,
)
from tjscan.core.units import SettingsTable as Table
from tjscan.robot.settings import SolidSettings

MM_PER_MIN: Final = FileUnit("mm_min", 1e-3 / 60)
KJ_PER_MM: Final = FileUnit("kJ_mm", 1e6)
KG_PER_CUBIC_METRE: Final = FileUnit("kg_m3")
CELSIUS_UNIT: Final = FileUnit("C")

Position = Literal["PA", "PB", "PC", "PD", "PE", "PF", "PG"]
"""Welding positions by the letters of ISO 6947."""


def _check_window(limits: tuple[float, float]) -> tuple[float, float]:
    """Return a window, and refuse an empty one.

    Raises
    ------
    ValueError
        If its second number is not larger than its first.
    """
    if limits[0] >= limits[1]:
        raise ValueError("is an empty window: its second number must be larger than its first")
    return limits


def _check_power_table(rows: Any) -> Any:
    """Refuse a table of the power source whose wire feed does not grow."""
    if any(a[0] >= b[0] for a, b in pairwise(rows)):
        raise ValueError("its wire feed, the first number of a row, must grow from row to row")
    return rows


Window = tuple[float, float]

_Positive = Annotated[float, Gt(0)]
_Window = Annotated[tuple[_Positive, _Positive], AfterValidator(_check_window)]
_Share = Annotated[float, Gt(0), Le(1)]
_Tilt = Annotated[float, Ge(-60), Le(60)]
_Angle = Annotated[float, Ge(0), Le(180)]
_Length = Annotated[float, Ge(0), Le(200)]
_PowerRow = tuple[_Positive, _Positive, _Positive]


@dataclass(frozen=True, slots=True, kw_only=True)
class WireSettings(Table):
    """Settings of the wire.

    Parameters
    ----------
    diameter : float
        Of the wire, metres.
    density : float
        kg/m³, for the mass that is reported.
    deposition_efficiency : float
        Share of the molten wire that ends in the weld.
    """

    diameter: Annotated[float, Gt(0), Le(10), MM]
    density: Annotated[float, Ge(1500), Le(25e3), KG_PER_CUBIC_METRE]
    deposition_efficiency: _Share


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcSettings(Table):
    """Settings of the arc: what may be set, and what it gives.

    Parameters
    ----------
    wire_feed, travel_speed : tuple of float
        Windows, m/s.
    power : tuple
        Rows of wire feed (m/min, as in the file), current (A) and voltage (V); linear between.
    thermal_efficiency : float
        The factor k of the heat input k U I / v.
    heat_input : tuple of float
        Window of the heat input, J/m.
    gas_flow : float
        Shielding gas, m³/s.
    """

    wire_feed: Annotated[_Window, M_PER_MIN]
    travel_speed: Annotated[_Window, MM_PER_MIN]
    power: Annotated[
        tuple[_PowerRow, ...],
        MinLen(2),
        MaxLen(100),
        AfterValidator(_check_power_table),
        LIST_OR_WORD_IN_FILE,
    ]
    thermal_efficiency: _Share
    heat_input: Annotated[_Window, KJ_PER_MM]
    gas_flow: Annotated[float, Ge(0), LITRE_PER_MINUTE]

    def __post_init__(self) -> None:
        if not self.has_power_for(self.wire_feed):
            raise ValueError("power must reach from end to end of the window wire_feed_m_min")

    def has_power_for(self, feeds: tuple[float, float]) -> bool:
        """Whether the table of power reaches from end to end of a window of wire feeds, m/s."""
        lowest, highest = self.power[0][0] * M_PER_MIN.factor, self.power[-1][0] * M_PER_MIN.factor
        return feeds[0] >= lowest * (1 - 1e-9) and feeds[1] <= highest * (1 + 1e-9)

    def power_at(self, feed: Array) -> Array:
        """Power of the arc in watts at wire feeds in m/s: current and voltage linear between."""
        rows = np.array(self.power)
        at = rows[:, 0] * M_PER_MIN.factor
        return np.asarray(np.interp(feed, at, rows[:, 1]) * np.interp(feed, at, rows[:, 2]))


@dataclass(frozen=True, slots=True, kw_only=True)
class BeadSettings(Table):
    """Settings of beads and layers.

    Parameters
    ----------
    root_area, fill_area, cap_area : tuple of float
        Windows of a bead's cross-section in the first, the inner and the last layer, m².
    layer_height : tuple of float
        Window of a layer's height in the middle of its width, metres.
    cap_height : float
        Height of the middle of the weld above the line of the brace's wall, metres.
    weave_limit : float
        Width of the widest bead that may be laid, metres.
    """

    root_area: Annotated[_Window, MM2]
    fill_area: Annotated[_Window, MM2]
    cap_area: Annotated[_Window, MM2]
    layer_height: Annotated[_Window, MM]
    cap_height: Annotated[float, Ge(0), Le(20), MM]
    weave_limit: Annotated[float, Gt(0), Le(100), MM]


@dataclass(frozen=True, slots=True, kw_only=True)
class WeaveSettings(Table):
    """Settings of a weave: beads wider than the arc alone makes them are woven.

    Parameters
    ----------
    stringer_width : float
        Of the widest bead that is laid without a weave, metres.
    period : float
        Of a whole swing there and back, dwells included, seconds.
    dwell : float
        How long the torch stays at each end, seconds.
    """

    stringer_width: Annotated[float, Gt(0), Le(100), MM]
    period: Annotated[float, Gt(0), Le(60), SECONDS]
    dwell: Annotated[float, Ge(0), Le(10), SECONDS]

    def __post_init__(self) -> None:
        if not 2 * self.dwell < self.period:
            raise ValueError("two dwell_s leave no time to swing: make period_s longer")

    def amplitude(self, width: Array) -> Array:
        """How far to either side to swing for beads of widths, shape (m,), metres."""
        return np.maximum(0.5 * (width - self.stringer_width), 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class StartStopSettings(Table):
    """Settings of how every bead begins and ends.

    Parameters
    ----------
    run_in, crater : float
        Lengths of both along the bead, metres.
    run_in_speed : float
        Travel speed at the very start, as a share of the bead's own; it comes to that linearly.
    crater_feed : float
        Wire feed at the very end, as a share of the bead's own, to which it goes linearly.
    crater_time : float
        How long the arc then burns in one place, seconds.
    """

    run_in: Annotated[float, Gt(0), Le(200), MM]
    run_in_speed: Annotated[float, Gt(0), Le(5)]
    crater: Annotated[float, Gt(0), Le(200), MM]
    crater_feed: _Share
    crater_time: Annotated[float, Ge(0), Le(60), SECONDS]

    def speed_and_feed_shares(self, along: Array) -> tuple[Array, Array]:
        """Shares of a bead's own speed and feed at lengths (q,) along it, from 0 to its whole."""
        from_start = np.minimum(along / self.run_in, 1.0)
        to_end = np.minimum((along[-1] - along) / self.crater, 1.0)
        speed = self.run_in_speed + (1 - self.run_in_speed) * from_start
        return speed, self.crater_feed + (1 - self.crater_feed) * to_end


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionLimits(Table):
    """A row of the table ``[[position]]``: what holds where a bead is welded in a position.

    Parameters
    ----------
    name : str
        PA to PG.
    wire_feed : tuple of float
        Window of the wire feed there, m/s.
    """

    name: Position
    wire_feed: Annotated[_Window, M_PER_MIN]


@dataclass(frozen=True, slots=True, kw_only=True)
class TorchSolidSettings(SolidSettings):
    """A solid that is part of the torch or its mount, in the flange frame.

    Parameters
    ----------
    in_groove : bool
        Whether it enters the groove, as a nozzle does: it is then checked against the measured
        groove alone, for the tubes of the job have no groove in them.
    """

    in_groove: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class RootSettings(Table):
    """Settings of a root pass over an opening, and of tack welds.

    Parameters
    ----------
    opening : tuple of float
        Window of the root opening, metres.
    backing : bool
        Whether something backs the opening: then the windows of the arc hold for its bead too.
    penetration : float
        How far the root bead goes below the line from p3 to p4 over an opening, as a mean over
        its width: through the land, and beyond it; metres.
    wire_feed, travel_speed : tuple of float
        Windows of the bead over an opening that nothing backs, m/s.
    heat_input : tuple of float
        Window of its heat input, J/m.
    tacks : str
        ``fuse``, the root bead goes over tack welds, or ``skip``, it ends on each and goes on
        behind it.
    tack_length : float
        Of a tack weld, metres: a section shows that one is there, not how far it reaches.
    """

    opening: Annotated[_Window, MM]
    backing: bool
    penetration: Annotated[float, Ge(0), Le(20), MM]
    wire_feed: Annotated[_Window, M_PER_MIN]
    travel_speed: Annotated[_Window, MM_PER_MIN]
    heat_input: Annotated[_Window, KJ_PER_MM]
    tacks: Literal["fuse", "skip"]
    tack_length: Annotated[float, Gt(0), Le(500), MM]


@dataclass(frozen=True, slots=True, kw_only=True)
class TorchSettings(Table):
    """Settings of the torch.

    Parameters
    ----------
    tcp : PoseSettings
        Tip of the wire on the flange; its z points along the wire, into the work.
    work_angle : float
        From the middle of a bead's free angle towards the bevel, radians.
    travel_angle : float
        Lean in the direction of travel, radians; positive: the wire points forward (pushing).
    stick_out : float
        From the contact tip to the wire's tip, metres: printed, part of `tcp` already.
    retract : float
        How far the torch is drawn back along the wire between beads, metres.
    margin : float
        How far the torch keeps from everything but the groove that it enters, metres.
    solid : tuple of TorchSolidSettings
        The torch and its mount, for the check of its reach.
    """

    tcp: PoseSettings
    work_angle: Annotated[_Tilt, DEG]
    travel_angle: Annotated[_Tilt, DEG]
    stick_out: Annotated[float, Gt(0), Le(60), MM]
    retract: Annotated[float, Gt(0), Le(500), MM]
    margin: Annotated[float, Ge(0), Le(500), MM]
    solid: Annotated[tuple[TorchSolidSettings, ...], MinLen(1), MaxLen(100), LIST_OR_WORD_IN_FILE]

    def __post_init__(self) -> None:
        names = [one.name for one in self.solid]
        if len(set(names)) < len(names):
            raise ValueError("solid: each needs a name of its own")


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceSettings(Table):
    """Settings of where beads start and stop, and in which position they may be welded.

    Parameters
    ----------
    longest_step : float
        Sections further apart than this are refused, as one is missing; metres.
    start_spread : float
        Between the starts of a layer and of the one below it, metres.
    stop_distance : float
        How far starts and stops keep from crown and saddle of a tubular joint, metres.
    shortest_bead : float
        A shorter bead is named, metres.
    overlap : float
        How far a bead goes on over its own start, or over the end of the zone before it, metres.
    ends : str
        Of a groove that does not close: ``square``, every layer from end to end, or ``cascade``,
        every layer shorter than the one below by `start_spread` at both ends.
    reverse : bool
        Whether beads run against the order of the sections.
    slope_limit : float
        Up to this slope a bead is welded in one of PA to PE; steeper in PF if it climbs, in PG if
        it falls; radians.
    positions : tuple of str
        Positions that may be welded in.
    interpass_temperature : float
        °C, printed.
    interpass_wait : float
        From the end of a bead to the start of the next, at least, seconds.
    hold_after_layers : tuple of int
        Layers after which welding waits until an operator lets it go on.
    """

    longest_step: Annotated[float, Gt(0), Le(1000), MM]
    start_spread: Annotated[float, Ge(0), Le(1000), MM]
    stop_distance: Annotated[float, Ge(0), Le(1000), MM]
    shortest_bead: Annotated[float, Gt(0), Le(1000), MM]
    overlap: Annotated[float, Ge(0), Le(200), MM]
    ends: Literal["square", "cascade"]
    reverse: bool
    positions: Annotated[tuple[Position, ...], MinLen(1), LIST_OR_WORD_IN_FILE]
    slope_limit: Annotated[float, Ge(0), Le(90), DEG]
    interpass_temperature: Annotated[float, Ge(0), Le(600), CELSIUS_UNIT]
    interpass_wait: Annotated[float, Ge(0), Le(3600), SECONDS]
    hold_after_layers: Annotated[tuple[Annotated[int, Ge(1)], ...], LIST_OR_WORD_IN_FILE]


@dataclass(frozen=True, slots=True, kw_only=True)
class JointDetail(Table):
    """A row of the table ``[[detail]]``: a joint detail as the user's code or drawing has it.

    Parameters
    ----------
    name : str
        Of the detail.
    dihedral : tuple of float
        Window of the local dihedral angle in which it may be used; windows may overlap.
    groove_angle : tuple of float
        Window of the angle between bevel and leg, radians.
    root_opening : tuple of float
        Window of an open root, metres.
    size : tuple of float
        Window of the distance from the middle of p3 and p4 to the line from p2 to g, metres.
    """

    name: Annotated[str, MinLen(1)]
    dihedral: Annotated[tuple[_Angle, _Angle], AfterValidator(_check_window), DEG]
    groove_angle: Annotated[tuple[_Angle, _Angle], AfterValidator(_check_window), DEG]
    root_opening: Annotated[tuple[_Length, _Length], AfterValidator(_check_window), MM]
    size: Annotated[tuple[_Length, _Length], AfterValidator(_check_window), MM]


class WeldingProcedure(StrictFileModel):
    """A welding procedure specification, as its file states it."""

    name: str
    wire: WireSettings
    arc: ArcSettings
    bead: BeadSettings
    root: RootSettings
    torch: TorchSettings
    sequence: SequenceSettings
    weave: WeaveSettings | None = None
    start_stop: StartStopSettings | None = None
    position: Annotated[tuple[PositionLimits, ...], MaxLen(7), LIST_OR_WORD_IN_FILE] = ()
    detail: Annotated[tuple[JointDetail, ...], MaxLen(50), LIST_OR_WORD_IN_FILE] = ()

    @model_validator(mode="after")
    def _check_root_and_tacks(self) -> Self:
        if not self.arc.has_power_for(self.root.wire_feed):
            raise ValueError("arc.power must reach from end to end of root.wire_feed_m_min")
        least = 2 * self.sequence.overlap
        if self.root.tacks == "skip" and self.root.tack_length <= least:
            raise ValueError(
                f"root.tack_length_mm must be more than twice sequence.overlap_mm, {1e3 * least:g},"
                ' or nothing of a tack is skipped: fuse them (root.tacks = "fuse"), or overlap less'
            )
        return self

    @model_validator(mode="after")
    def _check_windows_overlap(self) -> Self:
        """Refuse windows of which wire, arc and speed allow nothing: as of a wrong unit."""
        for name, limits in (("arc", self.arc), ("root", self.root)):
            feeds = np.array(limits.wire_feed)
            slow, fast = limits.travel_speed
            heats = self.heat_input(feeds, np.array((fast, slow))) / KJ_PER_MM.factor
            window = tuple(limit / KJ_PER_MM.factor for limit in limits.heat_input)
            if window[0] > heats[1] or window[1] < heats[0]:
                raise ValueError(
                    f"{name}.heat_input_kJ_mm allows {window[0]:g} to {window[1]:g}, and wire "
                    f"feed, travel speed and power of the file give {heats[0]:.2g} to "
                    f"{heats[1]:.2g}: is one in another unit?"
                )
        low, high = self.arc.wire_feed
        for one in self.position:
            if one.wire_feed[0] > high or one.wire_feed[1] < low:
                reason = "lies outside arc.wire_feed_m_min"
                raise ValueError(f"position: wire_feed_m_min of {one.name} {reason}")
        return self

    @property
    def crater_time(self) -> float:
        """How long the arc burns in one place at the end of a bead, seconds."""
        return 0.0 if self.start_stop is None else self.start_stop.crater_time

    def feed_in_positions(self, feed: float, positions: Sequence[str]) -> Array:
        """The wire feed at points, shape (q,), m/s: one, or the nearest that a position allows."""
        windows: dict[str, Window] = {one.name: one.wire_feed for one in self.position}
        limits = np.array([windows.get(name, (0.0, np.inf)) for name in positions])
        return np.asarray(np.clip(feed, *limits.T))

    def limits_of_bead(self, *, open_root: bool) -> tuple[str, ArcSettings | RootSettings]:
        """Table, and its name, that holds the windows of a bead's feed, speed and heat input.

        Parameters
        ----------
        open_root : bool
            Whether it is laid over an open root.
        """
        if open_root and not self.root.backing:
            return "root", self.root
        return "arc", self.arc

    def deposition_rate(self, feed: Array) -> Array:
        """Volume that wire feeds (m/s) deposit in a second, m³/s: π d²/4 · feed · efficiency."""
        wire = self.wire
        return np.asarray(0.25 * np.pi * wire.diameter**2 * feed * wire.deposition_efficiency)

    def heat_input(self, feed: Array, speed: Array) -> Array:
        """Heat input k U I / v in J/m, of wire feeds and travel speeds in m/s."""
        return np.asarray(self.arc.thermal_efficiency * self.arc.power_at(feed) / speed)


def read_wps(file: Path) -> WeldingProcedure:
    """Read a WPS file.

    Parameters
    ----------
    file : Path
        TOML; `docs/planning.md` lists its keys.

    Raises
    ------
    ConfigurationError
        If it can't be read, or for the first key that is unknown, missing or wrong.
    """
    return validate_table(WeldingProcedure, read_toml(file), file)
