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
from uncertainty import COVERED, Squares, across_edges, placed_stations

from tjscan.core.errors import CalibrationRefused, StitchingRefused
from tjscan.core.frames import inverse_pose
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.runs.chain import read_chain_file, run_chain
from tjscan.runs.scan.run import ScanContext

EXAMPLE: Final = Path(__file__).resolve().parents[1] / "examples" / "paper-chain.toml"
CHAINS: Final = {"quick": 1, "full": 30}
ARMS: Final = 30


@dataclass(frozen=True, slots=True)
class CellErrors:
    """What came of the chain of one cell.

    Parameters
    ----------
    corners : float
        Mean distance of the corners from the joint's edges, aligned to it, metres.
    mount : float
        Error squared of T_f_s over its stated variance, by dimension.
    in_joint, stations : Squares
        Of the corners across their edges in the frame of the joint that was found, and of the
        stations' places.
    """

    corners: float
    mount: float
    in_joint: Squares
    stations: Squares


def run_cell(seed: int, *, arm: bool) -> CellErrors:
    """Run the chain with the cell of a seed; raises as `run_chain` does."""
    chain = read_chain_file(EXAMPLE).with_shared_keys({"simulation.seed": seed})
    with TemporaryDirectory() as folder:
        found = run_chain(chain, Path(folder), arm=arm)
    whole = read_scan_job(Path(chain.scan), chain.both)
    joint = ScanContext(whole, Path(chain.scan)).joint
    if joint is None or whole.joint is None:
        raise SystemExit(f"{EXAMPLE} names no joint to compare with")
    T_j_w = inverse_pose(whole.joint.T_w_j)
    truth = [
        T_j_w @ whole.job_at_station(one.fit.station.name).T_w_b_true
        for one in found.stitched.stations
    ]
    return CellErrors(
        found.mean_corner_error,
        found.mount_nees,
        across_edges(found.stitched.sections, feature_edges(joint)),
        placed_stations(found.stitched, truth),
    )


def run(count: int, *, arm: bool) -> tuple[list[CellErrors], int]:
    """Run the chain with the cells of seeds 1 to `count`; gives how many were refused too."""
    found, refused = [], 0
    for seed in range(1, count + 1):
        try:
            one = run_cell(seed, arm=arm)
        except (CalibrationRefused, StitchingRefused) as error:
            print(f"seed {seed}: {error}", file=sys.stderr)
            refused += 1
            continue
        found.append(one)
        print(
            f"seed {seed}: corners {1e3 * one.corners:.3f} mm; error² / stated of T_f_s "
            f"{one.mount:.2f}, corners {one.in_joint.squares.mean() / 2:.2f}, stations "
            f"{one.stations.squares.mean() / 6:.2f}; "
            f"{100 * np.mean(one.in_joint.squares < COVERED):.0f} % inside 95 %",
            file=sys.stderr,
            flush=True,
        )
    return found, refused


def measure_chains(count: int) -> list[Row]:
    """Rows of the chain, plain and with the arm calibrated."""
    rows = []
    for arm, name, limit in ((False, "plain", 0.25), (True, "arm calibrated", 0.12)):
        found, refused = run(count, arm=arm)
        corners = np.concatenate([one.in_joint.squares for one in found])
        stations = np.concatenate([one.stations.squares for one in found])
        mean = 1e3 * float(np.mean([one.corners for one in found]))
        inside = 100 * float(np.mean(corners < COVERED))
        ratios = {
            "T_f_s": float(np.mean([one.mount for one in found])),
            "corners": float(corners.mean()) / 2,
            "stations": float(stations.mean()) / 6,
        }
        rows += [
            Row(f"chain, {name}, {count} cells: corners, mean", mean, limit, "mm"),
            *(
                Row(f"the same: error² / stated of {what}", ratio, 1.5, at_least=0.7)
                for what, ratio in ratios.items()
            ),
            Row("the same: corners inside the stated 95 %", inside, 98, "%", at_least=92),
            Row("the same: refused", refused, 0),
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
