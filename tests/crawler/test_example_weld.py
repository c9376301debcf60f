"""The shipped crawl can be welded: deposition, weave and filling of its simulated beads."""

from pathlib import Path

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.job.crawl.job import read_crawl_job
from tjscan.joint.hull import hull_section

JOB = read_crawl_job(Path(__file__).parents[2] / "examples" / "crawl.toml")
ACROSS = np.linspace(-0.02, 0.02, 8001)
STEEL_DENSITY = 7850.0


def heights(passes: int) -> Array:
    """Height over the hull at `ACROSS`, apart from tacks."""
    assert JOB.simulation is not None
    return np.interp(ACROSS, *hull_section(JOB.simulation.joint, 0.25, passes).T)


@pytest.mark.parametrize("number", range(1, len(JOB.passes) + 1))
def test_a_pass_lays_what_a_wire_melts_and_weaves_within_its_bead(number: int) -> None:
    one, laid = JOB.passes[number - 1], heights(number) - heights(number - 1)
    kg_per_hour = float(np.trapezoid(laid, ACROSS)) * one.speed * STEEL_DENSITY * 3600
    assert 2.0 < kg_per_hour < 5.0  # flux-cored wire, uphill
    covered = ACROSS[laid > 1e-5]
    assert one.speed * one.weave_period < np.ptp(covered)
    assert abs(one.offset - covered.mean()) < 2e-3


def test_the_passes_fill_the_groove() -> None:
    assert JOB.simulation is not None
    joint, top = JOB.simulation.joint, heights(len(JOB.passes))
    inside = np.abs(ACROSS) < joint.width / 2
    assert top[inside].min() > -abs(joint.high_low) / 2 - 1e-5
    assert top.max() < 2e-3  # a cap, not a hill
