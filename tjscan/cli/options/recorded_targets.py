"""What the laser looked at, from the options of ``tjscan calibrate`` for recorded profiles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.calibration.fits.posed_profile import PosedProfile
from tjscan.calibration.fits.recorded import read_points_in_base_frame
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.offline import RecordedTarget
from tjscan.calibration.plucker import PluckerPlane
from tjscan.calibration.targets import (
    SphereTarget,
    UnknownRoof,
    fit_plane,
    plane_stated_beforehand,
)
from tjscan.cli.options.recorded import RecordedProfileOptions, comma_separated_options
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array

TARGETS: Final = {
    "plane": "plane=",
    "touched": "touched=",
    "unknown_plane": "plane",
    "sphere_radius_mm": "ball=",
    "unknown_sphere": "ball",
    "roof_edge": "roof",
}
"""Options that name the target of a single recording, and the word that says the same."""
WORDS: Final = "roof, ball, ball=RADIUS, plane, plane=A,B,C,D, touched=FILE"


def target_words(options: RecordedProfileOptions, count: int) -> list[str]:
    """What each recording shows, in the words of ``--target``.

    Parameters
    ----------
    options : RecordedProfileOptions
        As given.
    count : int
        How many recordings there are.

    Raises
    ------
    ConfigurationError
        If not every recording has its target.
    """
    given = [name for name in options.given_option_names if name in TARGETS]
    if options.target is not None and not given:
        if len(options.target) != count:
            raise ConfigurationError(
                f"each --lines has its --target (found: {count} and {len(options.target)}), one of "
                f"{WORDS}"
            )
        return list(options.target)
    if len(given) != 1 or options.target is not None or count != 1:
        found = given + (["target"] if options.target is not None else [])
        raise ConfigurationError(
            f"what the laser looked at takes one of {comma_separated_options(TARGETS)}, or one "
            f"--target for each --lines (found: {comma_separated_options(found) or 'none'})"
        )
    word, value = TARGETS[given[0]], getattr(options, given[0])
    return [f"{word}{value}" if word.endswith("=") else word]


def read_target(word: str, shots: Sequence[PosedProfile], noise: NoiseModel) -> RecordedTarget:
    """Read what a recording shows.

    Parameters
    ----------
    word : str
        As for ``--target``.
    shots : sequence of PosedProfile
        The recording: a board is seen from its flange poses.
    noise : NoiseModel
        For how well a board was touched.

    Raises
    ------
    ConfigurationError
        If the word is none of them, or what follows it is wrong.
    """
    kind, equals, value = word.partition("=")
    flange_b = np.mean([shot.T_b_f[:3, 3] for shot in shots], axis=0)
    match kind, bool(equals):
        case "roof", False:
            return UnknownRoof()
        case "ball", False:
            return SphereTarget()
        case "ball", True:
            return SphereTarget(1e-3 * _radius(value))
        case "plane", False:
            return None
        case "plane", True:
            return plane_stated_beforehand(
                _plane(value), flange_b, noise.touch, geometry=noise.geometry
            )
        case "touched", True:
            points = read_points_in_base_frame(Path(value))
            return fit_plane(points, noise.touch, flange_b, geometry=noise.geometry)
    raise ConfigurationError(f"{word!r} is no target; {WORDS} are", key="--target")


def _radius(text: str) -> float:
    try:
        radius = float(text)
    except ValueError:
        radius = float("nan")
    if not 0 < radius < np.inf:
        raise ConfigurationError(
            f"a ball has a positive radius in millimetres, not {text!r}", key="--sphere-radius-mm"
        )
    return radius


def _plane(text: str) -> PluckerPlane:
    """A x + B y + C z + D = 0, D in millimetres."""
    try:
        numbers: Array = np.array([float(part) for part in text.split(",")])
        if numbers.shape != (4,) or not np.isfinite(numbers).all():
            raise ValueError("four finite numbers are needed")
        return PluckerPlane(numbers[:3], 1e-3 * float(numbers[3]))
    except ValueError as error:
        raise ConfigurationError(
            f"{text!r} is no plane A,B,C,D in millimetres: {error}", key="--plane"
        ) from None
