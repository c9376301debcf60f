"""Sections along one groove, by either ray caster: what lasts along it lasts, the rest does not.

Shape, thickness of scale, and gloss of the faces are those of the groove, but for a few per cent;
pose, noise, patches, spatter and reflections are each section's own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from _second_caster import SecondFault, WedgeProfile, between_faces, draw_wedge
from _second_caster import reflections as mirrored
from _steel import (
    FILL_SHAPES,
    MM,
    Fault,
    PosedProfile,
    draw,
    ghosts,
    interreflection,
    mill_scale,
    partly_filled,
    shoot_groove,
)

SECTION_STEP: Final = 25 * MM
"""Between neighbouring sections."""

SECTIONS_BEFORE: Final = 6

Drawn = Callable[[np.random.Generator], Fault | SecondFault]
"""Gives what is wrong with one groove, from what lasts along it."""


@dataclass(frozen=True)
class SeamFault:
    """A row of grooves of which each is read section by section."""

    name: str
    drawn: Drawn

    def shoot(self, k: int, section: int, bare: bool = False) -> PosedProfile | WedgeProfile:
        """A section of the k-th groove of this row: always the same one.

        A bare one is as it was before anything was laid in it, seen from the same pose.
        """
        lasting = np.random.default_rng((k, 7, *self.name.encode()))
        own = np.random.default_rng((k, section, 8, *self.name.encode()))
        fault = self.drawn(np.random.default_rng((k, 9, *self.name.encode())))
        if isinstance(fault, Fault):
            fault = replace(fault, steel=()) if bare else fault
            g = draw(lasting, k, further=section * SECTION_STEP, own=own)
            return shoot_groove(fault, g, own)
        wedge = draw_wedge(lasting)
        c, s = math.cos(turn := math.radians(own.uniform(-2, 2))), math.sin(turn)
        turned, middle = np.array(((c, -s), (s, c))), wedge.corners.mean(axis=0)
        shift = MM * own.uniform(-3, 3, 2)
        wedge.corners = middle + shift + (wedge.corners - middle) @ turned.T
        wedge.wall, wedge.leg = turned @ wedge.wall, turned @ wedge.leg
        return fault.shoot_groove(wedge, own)


def about(value: float) -> tuple[float, float]:
    """What a section may have of something that lasts: within 5 %."""
    return 0.95 * value, 1.05 * value


def light(least: float, most: float) -> Drawn:
    """Light between the faces, as strong and as far all along the groove."""

    def drawn(lasting: np.random.Generator) -> Fault:
        pull, reach = lasting.uniform(least, most), lasting.uniform(3, 5)
        return Fault("light", sensing=(interreflection(*about(pull), about(reach)),))

    return drawn


def second_light(lasting: np.random.Generator) -> SecondFault:
    """The same by the second ray caster."""
    pull, width = lasting.uniform(0.5, 1.5), lasting.uniform(1.4, 2.4)
    return SecondFault("light", light=(between_faces(*about(pull), about(width)),))


def scaled(lasting: np.random.Generator) -> Fault:
    """Scale as thick all along the groove, in patches of each section."""
    return Fault("scale", (mill_scale(*(about(t) for t in lasting.uniform(0.2, 0.4, 2))),))


def filled(lasting: np.random.Generator) -> Fault:
    """Weld of one shape, as high all along the groove."""
    shape = FILL_SHAPES[lasting.integers(len(FILL_SHAPES))]
    return Fault("filled", (partly_filled(lasting.uniform(0.1, 0.75), shape),))


ALONG_SEAM: Final = (
    SeamFault("sections before, sound", lambda lasting: Fault("sound")),
    SeamFault("sections before, light 0.4 mm", light(0.4, 0.4)),
    SeamFault("sections before, light 0.5-1.5 mm", light(0.5, 1.5)),
    SeamFault("sections before, mill scale", scaled),
    SeamFault("sections before, ghosts", lambda lasting: Fault("ghosts", sensing=(ghosts,))),
    SeamFault("sections before, second caster, light 0.5-1.5 mm", second_light),
    SeamFault(
        "sections before, second caster, reflections",
        lambda lasting: SecondFault("reflections", light=(mirrored,)),
    ),
)
"""Rows of grooves whose last section is judged, read with what the others show."""

FILLED_ALONG_SEAM: Final = SeamFault("sections before, partly filled", filled)
"""Grooves that were scanned bare, section by section, and then welded in part."""
