"""The whole chain on arms that are off as calibrated ones are, and what their calibration gains."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from _ball_arm import BallArm, posture_errors
from _table import Row, main

from tjscan.core.errors import CalibrationRefused, StitchingRefused
from tjscan.runs.chain.run import ChainOutcome, run_chain
from tjscan.runs.chain.settings import read_chain

EXAMPLE: Final = Path(__file__).resolve().parents[1] / "examples" / "paper-chain.toml"
CHAINS: Final = {"quick": 1, "full": 30}
ARMS: Final = 30


@dataclass(frozen=True, slots=True)
class Chains:
    """Outcomes of the chains of several cells, and how many were refused."""

    outcomes: tuple[ChainOutcome, ...]
    refused: int

    @property
    def corners(self) -> float:
        """Mean of all corners' distances, mm; NaN without any."""
        means = [one.corners_mean for one in self.outcomes]
        return 1e3 * float(np.mean(means)) if means else np.nan

    @property
    def nees(self) -> float:
        """Mean normalised squared error of T_f_s."""
        found = [one.mount_nees for one in self.outcomes if one.mount_nees is not None]
        return float(np.mean(found)) if found else np.nan


def run(count: int, *, arm: bool) -> Chains:
    """Run the chain with the cells of seeds 1 to `count`."""
    outcomes, refused = [], 0
    for seed in range(1, count + 1):
        chain = read_chain(EXAMPLE).with_keys({"simulation.seed": seed})
        with TemporaryDirectory() as folder:
            try:
                outcomes.append(run_chain(chain, Path(folder), arm=arm))
            except (CalibrationRefused, StitchingRefused) as error:
                print(f"seed {seed}: {error}", file=sys.stderr)
                refused += 1
    return Chains(tuple(outcomes), refused)


def measure_chains(count: int) -> list[Row]:
    """Rows of the chain, plain and with the arm calibrated."""
    rows = []
    for arm, name, limit in ((False, "plain", 0.25), (True, "arm calibrated", 0.12)):
        found = run(count, arm=arm)
        rows += [
            Row(f"chain, {name}, {count} cells: corners, mean", found.corners, limit, "mm"),
            Row("the same: mean NEES of T_f_s by dimension", found.nees, 1.5, at_least=0.7),
            Row("the same: refused", found.refused, 0),
        ]
    return rows


def measure_arms() -> list[Row]:
    """Rows of the arm's calibration alone, on arcs as the noise model has them."""
    errors = np.array([posture_errors(BallArm.drawn(seed)) for seed in range(1, ARMS + 1)])
    before, after, held_before, held_after = 1e3 * errors.T

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2)))

    return [
        Row(f"{ARMS} arms over the work space, before: RMS", rms(before), 0.5, "mm", at_least=0.3),
        Row("the same, calibrated: RMS", rms(after), 0.15, "mm"),
        Row("the same: times less", rms(before) / rms(after), np.inf, at_least=3.0),
        Row("the worst arm, calibrated", float(after.max()), 0.25, "mm"),
        Row("ball in held-out postures, before", rms(held_before), np.inf, "mm"),
        Row("ball in held-out postures, calibrated", rms(held_after), 0.15, "mm"),
    ]


if __name__ == "__main__":
    quick = "--quick" in sys.argv
    arguments = [word for word in sys.argv[1:] if word != "--quick"]
    count = CHAINS["quick" if quick else "full"]
    sys.exit(main("The chain", lambda: measure_arms() + measure_chains(count), arguments))
