"""Simulated tows of the examples, held against the truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from _other_cable import CableTruth, other_cable

from tjscan.core.errors import TjscanError
from tjscan.job.tow.job import read_tow_job
from tjscan.runs.tow.results import TowOutcome
from tjscan.runs.tow.study import tow_for_study

EXAMPLES: Final = Path(__file__).parents[1] / "examples"

NOISE: Final[dict[str, Any]] = {
    "localisation.position_sigma_mm": 3.0,
    "localisation.heading_sigma_deg": 1.0,
    "simulation.localisation.position_noise_mm": 3.0,
    "simulation.localisation.heading_noise_deg": 1.0,
    "simulation.localisation.lost_percent": 20.0,
    "simulation.localisation.delay_s": 0.1,
}
"""Poses with 3 mm and 1° of noise, 20 % of them lost, one plan late."""


@dataclass(frozen=True, slots=True)
class Tow:
    """What a bench asks of a tow.

    Parameters
    ----------
    job : str
        Name of an example.
    keys : dict
        Of the job that differ.
    truth : CableTruth
        What cable is truly towed, on the plant of another make.
    """

    job: str
    keys: dict[str, Any] = field(default_factory=dict)
    truth: CableTruth = field(default_factory=CableTruth)


def seam_piece(job: str, share: float, length: float) -> dict[str, Any]:
    """Keys of a job whose seam is a piece of the example's, of a length in metres.

    Parameters
    ----------
    job : str
        Name of the example, whose seam is straight.
    share : float
        Where on the seam the piece lies: 0 at its beginning, 1 at its end.
    length : float
        Metres.
    """
    start, end = np.array(read_tow_job(EXAMPLES / f"{job}.toml").seam.points)
    whole = float(np.linalg.norm(end - start))
    way = (end - start) / whole
    begin = start + share * (whole - length) * way
    points = 1e3 * np.array((begin, begin + length * way))
    return {"seam.points_mm": points.round(6).tolist()}


def run_tow(tow: Tow, seed: int) -> TowOutcome:
    """Tow once on the plant of another make; what can't even begin is an outcome too."""
    try:
        keys = {**tow.keys, "simulation.seed": seed}
        with other_cable(tow.truth):
            return tow_for_study(read_tow_job(EXAMPLES / f"{tow.job}.toml", keys))
    except TjscanError as error:
        return TowOutcome(False, type(error).__name__, str(error))


def passer_by(seed: int) -> Tow:
    """A welder that stands, and somebody who heads for the cable from a side drawn by lot."""
    rng = np.random.default_rng(seed)
    # Across the cable somewhere along it, between the vehicles: the bulge lies south of both ends.
    towards = np.array((rng.uniform(0.6, 2.2), rng.uniform(-1.6, -0.6)))
    angle = rng.uniform(-np.pi, 0)
    start = towards + 2.0 * np.array((np.cos(angle), np.sin(angle)))
    end = towards - rng.uniform(-0.2, 1.5) * np.array((np.cos(angle), np.sin(angle)))
    path = {
        "name": "passer-by",
        "points_mm": (1e3 * np.array((start, end))).round(3).tolist(),
        "speed_mm_min": float(rng.uniform(300, 1500)),
        "radius_mm": 200.0,
    }
    return Tow("tow-passer-by", {"obstacles": [path], "seam.stand_s": 120.0})
