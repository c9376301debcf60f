"""Size a crawler: whether its magnets, motors and tracks carry it, and how tightly it can turn.

Kermorgant (2018), 2.2, and what it leaves out: friction, peel, and the torque of a turn. All are
closed forms of the job's numbers, but the torque of a turn, which comes of the friction of pads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import ceil, cos, inf, isfinite, pi, sin
from typing import Annotated, Any, Final

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core.units import DEG, M_PER_MIN, FileUnit, SettingsTable
from tjscan.crawler.plan import NEWTON_METRE_UNIT
from tjscan.vehicle.pad_plant import GRAVITY_M_S2, PadPlant, PadSettings
from tjscan.vehicle.tracks import TrackGeometry

WATT_UNIT: Final = FileUnit("w")
STEPS_PER_CONTACT_LENGTH: Final = 140
"""Steps in which a pad goes from the front of its track to the rear."""

REPORTED_TURN_RADII: Final = (2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
"""Metres at which the torque of a turn is reported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClimbingPadSettings(PadSettings):
    """The table [size.pads]: wet pads of a vehicle that climbs, unless a key states otherwise."""

    friction: Annotated[float, Gt(0), Le(2)] = 0.3
    down: Annotated[float, Ge(-360), Le(360), DEG] = pi


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeSettings(SettingsTable):
    """The table [size]: magnets, masses and motors.

    The defaults are the paper's, but for its motors' gear: behind 1:195 they give 42 N m at
    6 m/min, too little to turn on less than some 90 m. They have half that gear here.

    Parameters
    ----------
    pads : ClimbingPadSettings
        Of each track, with the vehicle's mass and the hull's inclination.
    gear : float
        Turns of a motor for one of its sprocket.
    torque : float
        Of a motor behind its gear, N m.
    top_speed : float
        m/s.
    power : float
        Of the supply, W.
    safety : float
        How many times its weight the magnets must hold, with one track broken too.
    """

    pads: ClimbingPadSettings = field(default_factory=ClimbingPadSettings)
    gear: Annotated[float, Gt(0), Le(1e4)] = 390.0
    torque: Annotated[float, Gt(0), Le(1e5), NEWTON_METRE_UNIT] = 84.0
    top_speed: Annotated[float, Gt(0), Le(100), M_PER_MIN] = 0.05
    power: Annotated[float, Gt(0), Le(1e6), WATT_UNIT] = 600.0
    safety: Annotated[float, Ge(1), Le(100)] = 5.0


@dataclass(frozen=True, slots=True)
class SizeFigure:
    """A figure of a sizing, and the rule it has to keep, if there is one.

    Parameters
    ----------
    name : str
        What it is.
    value : float
        In `unit`.
    unit : str
    least, most : float or None
        Bounds in the same unit.
    advice : str
        What to do if it is out of them.
    """

    name: str
    value: float
    unit: str
    least: float | None = None
    most: float | None = None
    advice: str = ""

    @property
    def holds(self) -> bool:
        """Whether it is within its bounds."""
        above = self.least is None or self.value >= self.least
        return above and (self.most is None or self.value <= self.most)

    @property
    def rule(self) -> str:
        """The bounds in words; empty if there are none."""
        if self.most is not None:
            return f"at most {self.most:.4g}"
        return "" if self.least is None else f"at least {self.least:g}"


def size_crawler(
    size: SizeSettings, tracks: TrackGeometry, least_radius: float
) -> tuple[SizeFigure, ...]:
    """Every figure of a crawler's sizing.

    Parameters
    ----------
    size : SizeSettings
    tracks : TrackGeometry
    least_radius : float
        Of the turns that the job allows, metres.
    """
    return (*_closed_form_figures(size, tracks), *_turn_torque_figures(size, tracks, least_radius))


def broken_rules(
    size: SizeSettings, tracks: TrackGeometry, least_radius: float
) -> tuple[SizeFigure, ...]:
    """Figures of a sizing that break their rule; see `size_crawler`, which takes longer."""
    holds = torque_of_turn(size.pads, tracks, least_radius) <= size.torque
    turns = () if holds else _turn_torque_figures(size, tracks, least_radius)
    return tuple(one for one in (*_closed_form_figures(size, tracks), *turns) if not one.holds)


def _closed_form_figures(size: SizeSettings, tracks: TrackGeometry) -> tuple[SizeFigure, ...]:
    pads, radius = size.pads, tracks.sprocket_radius
    weight = pads.mass * GRAVITY_M_S2
    share = pads.pads * pads.grip / pads.mass
    along, pressing = sin(pads.inclination), cos(pads.inclination)  # shares of the weight
    pull = size.torque / radius
    rpm = size.top_speed / radius * size.gear * 60 / (2 * pi)
    on_both, on_one = (_friction_needed(along, n * share + pressing) for n in (2, 1))
    grip = {"least": size.safety, "advice": "take more pads, or stronger magnets"}
    friction = {"most": pads.friction, "advice": grip["advice"]}
    climb = {"most": size.power, "advice": "climb more slowly, or take a stronger supply"}
    gear = {"least": 1.0, "advice": "take a lower gear, or smaller sprockets"}
    lever = {
        "most": pads.grip * GRAVITY_M_S2,
        "advice": "bring the mass closer to the hull, or lengthen the tracks",
    }
    rows: tuple[tuple[str, float, str, dict[str, Any]], ...] = (
        ("grip of both tracks over the weight", 2 * share, "", grip),
        ("the same with one track broken", share, "", grip),
        ("least pads of a track for that", size.safety * pads.mass / pads.grip, "", {}),
        ("friction needed on both tracks", on_both, "", friction),
        ("friction needed on one track", on_one, "", friction),
        ("pull of a track", pull, "N", {}),
        ("pull of both tracks over the weight", 2 * pull / weight, "", gear),
        ("speed of a motor at top speed", rpm, "rpm", {}),
        ("power of a track at full pull", pull * size.top_speed, "W", {}),
        ("power to climb at top speed", weight * size.top_speed, "W", climb),
        ("peel of the top pad", peel_of_top_pad(pads), "N", lever),
    )
    return tuple(SizeFigure(name, value, unit, **rule) for name, value, unit, rule in rows)


def _friction_needed(along: float, pressing: float) -> float:
    """Friction that holds what pulls along the hull by what presses on it; none holds a fall."""
    return along / pressing if pressing > 0 else inf


def _turn_torque_figures(
    size: SizeSettings, tracks: TrackGeometry, least_radius: float
) -> tuple[SizeFigure, ...]:
    """Torque against radius, and the rule of the tightest turn that the job allows."""
    radii = sorted({*REPORTED_TURN_RADII, least_radius})
    torques = [torque_of_turn(size.pads, tracks, turn) for turn in radii]
    tightest = tightest_turn(radii, torques, size.torque)
    advice = (
        f"take a lower gear, or turn no tighter than {ceil(tightest)} m (steering.least_radius_mm)"
        if isfinite(tightest)
        else "take a lower gear: no turn is as easy as that"
    )
    rules: dict[float, dict[str, Any]] = {least_radius: {"most": size.torque, "advice": advice}}
    turns = [
        SizeFigure(f"torque of a turn of {turn:g} m", torque, "N m", **rules.get(turn, {}))
        for turn, torque in zip(radii, torques, strict=True)
    ]
    return (*turns, SizeFigure("tightest turn at full torque", tightest, "m"))


def tightest_turn(radii: Sequence[float], torques: Sequence[float], most: float) -> float:
    """Radius from which on a torque suffices, metres, between those for which it is known.

    Parameters
    ----------
    radii : sequence of float
        Rising, metres.
    torques : sequence of float
        Of these turns, N m.
    most : float
        What the motors have, N m.

    Returns
    -------
    float
        The least radius of all if it suffices everywhere, infinity if nowhere.
    """
    enough = [torque <= most for torque in torques]
    if all(enough):
        return radii[0]
    if not enough[-1]:
        return inf
    k = len(enough) - 1 - enough[::-1].index(False)  # the widest turn that is too hard
    share = (torques[k] - most) / (torques[k] - torques[k + 1])
    bend = (1 - share) / radii[k] + share / radii[k + 1]
    return 1 / bend


def peel_of_top_pad(pads: PadSettings) -> float:
    """Force that pulls the top pad off the hull, N, if one track holds the vehicle alone.

    The weight's lever is borne by forces that grow with the distance from the middle:
    W h x_max / sum of x². What hangs from an overhead hull pulls at all pads alike.
    """
    places = ((np.arange(pads.pads) + 0.5) / pads.pads - 0.5) * pads.contact_length
    weight = pads.mass * GRAVITY_M_S2
    lever = weight * sin(pads.inclination) * pads.mass_height
    hanging = max(-weight * cos(pads.inclination), 0.0) / pads.pads
    return float(lever * np.abs(places).max() / np.sum(places**2)) + hanging


@lru_cache
def torque_of_turn(pads: PadSettings, tracks: TrackGeometry, radius: float) -> float:
    """Torque of the harder working motor while its tracks are driven along a circle, N m.

    Taken from `PadPlant` once every pad has been renewed twice; the vehicle, which slips, runs
    a wider circle.

    Parameters
    ----------
    pads : PadSettings
        The hull's inclination too: it climbs, or runs level.
    tracks : TrackGeometry
    radius : float
        Of the circle that the tracks are driven on, metres.
    """
    plant = PadPlant(pads, tracks, np.zeros(3))
    step, half = pads.contact_length / STEPS_PER_CONTACT_LENGTH, tracks.gauge / (2 * radius)
    torques = []
    for k in range(3 * STEPS_PER_CONTACT_LENGTH):
        plant.advance(step * (1 + half), step * (1 - half), 1.0)
        if k >= 2 * STEPS_PER_CONTACT_LENGTH:
            torques.append(np.abs(plant.torques).max())
    return float(np.mean(torques))
