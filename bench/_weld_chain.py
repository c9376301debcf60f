"""Whole welds with the reader in the loop: scan, weld and look as the program ships it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from _weld_worlds import SurfaceErrors

from tjscan.job.weld import read_weld_job
from tjscan.runs.weld.journal import LookMessage, read_weld
from tjscan.runs.weld.run import Weld, WeldContext, run_weld

JOB = Path(__file__).parents[1] / "examples" / "weld.toml"
OFFSET = 0.5e-3
"""Of the wire, to either side, metres."""


@dataclass(frozen=True, slots=True)
class ChainOutcome:
    """A finished weld against the truth.

    Parameters
    ----------
    surface : SurfaceErrors
    offset_error : float
        Of the offset learnt, metres.
    deviations : tuple of float
        Errors of the torch's deviations that looks stated, in their standard deviations.
    """

    surface: SurfaceErrors
    offset_error: float
    deviations: tuple[float, ...]


def weld_chain(seed: int, length: float) -> ChainOutcome:
    """Weld a length of the example's joint; its wire points to the leg or to the brace by chance.

    Parameters
    ----------
    seed : int
        Of everything.
    length : float
        Metres.
    """
    true = float(np.random.default_rng(seed).choice((-OFFSET, OFFSET)))
    keys = {
        "scan.length_mm": 1e3 * length,
        "simulation.seed": seed,
        "weld.simulation.seed": seed,
        "weld.simulation.offset_mm": 1e3 * true,
    }
    with TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        run_weld(WeldContext(read_weld_job(JOB, keys), JOB), run, arc=True)
        file = run / "job.toml"
        weld = Weld.of_scan(WeldContext(read_weld_job(file), file), run)
        looks = list(_replay(weld, run))
    stated = [
        (now.deviation - (true - before.offset)) / now.deviation_sigma
        for before, now in pairwise(looks)
        if now.deviation is not None and now.deviation_sigma is not None
    ]
    surface = SurfaceErrors.of_weld(weld.world.state, weld.order.cap_height)
    return ChainOutcome(surface, abs(looks[-1].offset - true), tuple(stated))


def _replay(weld: Weld, run: Path) -> Iterator[LookMessage]:
    """Let the metal of a recorded weld lie again, as it did."""
    for message in read_weld(run):
        weld.replay(message)
        if isinstance(message, LookMessage):
            yield message
