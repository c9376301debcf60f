"""Scans with a sensor that fails: profiles that don't come, are full of strays, or are frozen."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from _corpus import EXAMPLES
from _sensors import Fault, FaultyLaser, frozen, missing

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.errors import TjscanError
from tjscan.core.frames import JointOrBaseFrame, transform_points
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.laser.profile import Profile
from tjscan.recording.journal import CombinedJournal
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.journal import plan_is_fulfilled

JOB: Final = EXAMPLES / "paper.toml"
SPURIOUS: Final = 0.3
"""Share of the points that lie anywhere in the sensor's range."""

MOST_CAPTURES: Final = 30
"""Of a scan of 16 sections: a fault begins before."""

Kind = Literal["missing", "spurious", "frozen"]
KINDS: Final[tuple[Kind, ...]] = ("missing", "spurious", "frozen")


def strewn(seed: int) -> Fault:
    """A share of the points lies anywhere in the window that the rest spans."""
    rng = np.random.default_rng(seed)

    def fault(now: Profile, before: Profile) -> Profile:
        x, z = np.array(now.x_s), np.array(now.z_s)
        strays = np.flatnonzero(rng.random(len(x)) < SPURIOUS)
        z[strays] = rng.uniform(0.19, 0.29, len(strays))
        # Along its own ray a point that is nearer lies nearer to the middle, too.
        half = np.linspace(-0.188, 0.188, len(x))
        x[strays] = np.tan(half[strays]) * (z[strays] + 0.028)
        return replace(now, x_s=x, z_s=z)

    return fault


@dataclass(frozen=True, slots=True)
class FaultyScan:
    """What a scan with a faulty sensor came to.

    Parameters
    ----------
    kind : str
        What was wrong.
    complete : bool
        Whether it did what was asked.
    clean : bool
        Whether it ended as a scan ends, or by an error of the tree.
    worst_mm : float
        Largest distance of a corner that it claims from the true edge; zero where it claims none.
    told : str
        How it ended.
    """

    kind: Kind
    complete: bool
    clean: bool
    worst_mm: float
    told: str


def faulty_scan(seed: int) -> FaultyScan:
    """Scan the paper's joint with a fault drawn by a seed."""
    dice = random.Random(seed)
    kind = KINDS[seed % len(KINDS)]
    first, count = dice.randrange(MOST_CAPTURES), dice.randint(1, 5)
    if kind == "spurious" and dice.random() < 0.5:
        count = 10_000  # for good
    job = read_scan_job(JOB, {"simulation.seed": 1000 + seed})
    joint = ScanContext(job, JOB).joint
    cell = ScanContext(job, JOB).make_cell()
    fault = {"missing": missing, "frozen": frozen, "spurious": strewn(seed)}[kind]
    bad = range(first, first + count)
    cell = replace(cell, laser=FaultyLaser(cell.laser, lambda k: fault if k in bad else None))
    try:
        result = scan_in_cell(cell, job, CombinedJournal())
    except TjscanError as error:
        return FaultyScan(kind, False, True, 0.0, str(error))
    except Exception as error:
        return FaultyScan(kind, False, False, 0.0, repr(error))
    if job.joint is None or joint is None:
        raise SystemExit(f"{JOB} names no joint to compare with")
    T = JointOrBaseFrame(job.joint.T_w_j).T_r_b
    points = np.array([transform_points(T, section.points_b) for section in result.sections])
    worst = 1e3 * float(corner_to_edge_distances(points, feature_edges(joint)).max())
    done = plan_is_fulfilled(result.stop, job.scan)
    return FaultyScan(kind, done, True, worst, result.detail)
