"""Where a chain's error comes from: the chain again, with each source alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tjscan.core.errors import CalibrationRefused, StitchingRefused
from tjscan.runs.chain.run import ChainOutcome, run_chain
from tjscan.runs.chain.settings import Chain

OFF: Final[Mapping[str, Mapping[str, float]]] = {
    "arm: zeros, lengths, twists": {
        "simulation.arm.errors.offset_deg": 0.0,
        "simulation.arm.errors.length_mm": 0.0,
        "simulation.arm.errors.twist_deg": 0.0,
    },
    "arm: gears": {
        "simulation.arm.errors.eccentricity_deg": 0.0,
        "simulation.arm.errors.backlash_deg": 0.0,
    },
    "arm: warmth": {"simulation.arm.errors.growth": 0.0},
    "arm: repeatability": {
        "simulation.arm.repeatability_mm": 0.0,
        "simulation.arm.repeatability_deg": 0.0,
    },
    "laser: scale, tilt, lens": {"simulation.laser.linearity_mm": 0.0},
    "laser: noise, bias, outliers": {
        "simulation.laser.noise_mm": 0.0,
        "simulation.laser.bias_mm": 0.0,
        "simulation.laser.ghosts": 0.0,
        "simulation.laser.flyers": 0.0,
        "simulation.laser.missing": 0.0,
    },
}
"""Sources of error, and the keys that switch each of them off."""

ALL: Final = "all together"
NONE: Final = "none: touches, reading and stitching alone"


@dataclass(frozen=True, slots=True)
class SourceRow:
    """What is left where one source of error alone is there.

    Parameters
    ----------
    source : str
        Its name, or `ALL`, or `NONE`.
    directory : Path
        With the calibration's run directory, `CALIBRATION_RUN`.
    outcome : ChainOutcome or None
        What came of the chain; None where it was refused.
    refusal : str
        Why; empty where it was not.
    """

    source: str
    directory: Path
    outcome: ChainOutcome | None
    refusal: str = ""


def run_sources(
    chain: Chain,
    directory: Path,
    *,
    arm: bool,
    begin: Callable[[str], None],
    alone: bool = True,
) -> Iterator[SourceRow]:
    """Run a chain with all its errors, then with each source alone, then with none.

    Parameters
    ----------
    chain : Chain
        What to run.
    directory : Path
        Gets a directory for each.
    arm : bool
        Whether the arm is calibrated with the sensor.
    begin : callable
        Is told the name of each source before its chain runs.
    alone : bool
        Whether to run each source alone, or all of them together and no more.
    """
    everything = {key: value for keys in OFF.values() for key, value in keys.items()}
    runs: dict[str, Mapping[str, float]] = {ALL: {}}
    if alone:
        for source, keys in OFF.items():
            runs[source] = {key: 0.0 for key in everything if key not in keys}
        runs[NONE] = everything
    for number, (source, keys) in enumerate(runs.items()):
        begin(source)
        own = directory / str(number)
        try:
            outcome = run_chain(chain.with_keys(dict(keys)), own, arm=arm)
            yield SourceRow(source, own, outcome)
        except (CalibrationRefused, StitchingRefused) as refused:
            yield SourceRow(source, own, None, str(refused))
