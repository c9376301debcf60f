"""Whole welds with the reader in the loop: scan, weld and look as the program ships it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from _weld_worlds import SurfaceErrors

from tjscan.core.sourced import NumberSource
from tjscan.job.weld import read_weld_job
from tjscan.runs.weld.journal import LookMessage, read_weld
from tjscan.runs.weld.results import WELD_LOG_FILE
from tjscan.runs.weld.run import LookSchedule, Weld, WeldContext, run_weld

EXAMPLES = Path(__file__).parents[1] / "examples"
JOB = EXAMPLES / "weld.toml"
STATIONS_JOB = EXAMPLES / "whole-joint.toml"
"""Of a scan of the whole joint from two stations."""

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
    unsourced : int
        Numbers of its log that do not state where they come from.
    """

    surface: SurfaceErrors
    offset_error: float
    deviations: tuple[float, ...]
    unsourced: int


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
    return _weld_and_compare(JOB, keys, true, LookSchedule.PASS)


def weld_ring(seed: int, looks: LookSchedule) -> ChainOutcome:
    """Weld all of the paper's joint from two stations, with sections every 4 mm and faults.

    Parameters
    ----------
    seed : int
        Of everything.
    looks : LookSchedule
    """
    true = float(np.random.default_rng(seed).choice((-OFFSET, OFFSET)))
    keys = {
        "simulation.seed": seed,
        "weld.simulation.seed": seed,
        "weld.simulation.offset_mm": 1e3 * true,
        "weld.wps": str(EXAMPLES / "wps.toml"),
        "weld.station_step_mm": 4.0,
        "weld.look_step_mm": 8.0,
    }
    text, weld = STATIONS_JOB.read_text(), JOB.read_text()
    text = text.replace('"../cad/', f'"{EXAMPLES.parent}/cad/') + weld[weld.index("[weld]") :]
    with TemporaryDirectory() as folder:
        file = Path(folder) / "ring.toml"
        file.write_text(text)
        return _weld_and_compare(file, keys, true, looks)


def _weld_and_compare(
    job: Path, keys: dict[str, Any], true: float, looks: LookSchedule
) -> ChainOutcome:
    with TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        run_weld(WeldContext(read_weld_job(job, keys), job), run, arc=True, looks=looks)
        log = json.loads((run / WELD_LOG_FILE).read_text())
        file = run / "job.toml"
        weld = Weld.of_scan(WeldContext(read_weld_job(file), file), run)
        messages = list(_replay(weld, run))
    looked = [one for one in messages if isinstance(one, LookMessage)]
    stated = [
        (now.deviation - (true - before.offset)) / now.deviation_sigma
        for before, now in pairwise(looked)
        if now.deviation is not None and now.deviation_sigma is not None
    ]
    closed = weld.world.period > 0
    surface = SurfaceErrors.of_weld(weld.world.state, weld.order.cap_height, closed=closed)
    return ChainOutcome(
        surface, abs(looked[-1].offset - true), tuple(stated), numbers_without_source(log)
    )


def numbers_without_source(entry: Any) -> int:
    """Numbers in JSON that are not the value of an object with a source."""
    if isinstance(entry, list):
        return sum(map(numbers_without_source, entry))
    if not isinstance(entry, dict):
        return int(isinstance(entry, int | float) and not isinstance(entry, bool))
    sourced = entry.get("source") in set(NumberSource) and "value" in entry
    return sum(
        numbers_without_source(value)
        for key, value in entry.items()
        if not (sourced and key == "value")
    )


def _replay(weld: Weld, run: Path) -> Iterator[object]:
    """Let the metal of a recorded weld lie again, as it did."""
    for message in read_weld(run):
        weld.replay(message)
        yield message
