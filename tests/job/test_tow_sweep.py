"""Which shape a tow begins with, where the best one gets stuck."""

from pathlib import Path

import numpy as np
import pytest

from tjscan.core.errors import ConfigurationError
from tjscan.job.tow.cell import check_seam, make_shape_planner
from tjscan.job.tow.job import read_tow_job

EXAMPLE = Path(__file__).parents[2] / "examples" / "tow-simulation.toml"

PILLAR = [[[800, 500], [1700, 500], [1700, 800], [800, 800]]]
"""South of it the way is short at first, and at the end of the seam longer than the cable."""


def test_the_next_shape_is_tried_where_the_best_one_gets_stuck() -> None:
    """The cable goes north of the pillar from the beginning, and so reaches the seam's end."""
    seam = [[2600, 2000], [2600, 4800]]
    job = read_tow_job(EXAMPLE, {"area.holes_mm": PILLAR, "seam.points_mm": seam})

    sweep = check_seam(job, make_shape_planner(job))

    assert not sweep.why
    assert sweep.reached == pytest.approx(2.8)
    assert 1 < sweep.chosen <= sweep.shapes
    x, y = sweep.start.link_poses[:, :2].T
    assert np.interp(1.25, x[x < 2], y[x < 2]) > 0.8


def test_a_seam_that_no_shape_follows_is_refused_with_how_many_were_tried() -> None:
    """The ways round the pillar are too long north of it and south."""
    seam = [[2600, 3600], [2600, 4800]]
    tall = [[[800, 500], [1700, 500], [1700, 2400], [800, 2400]]]
    keys = {"area.holes_mm": tall, "seam.points_mm": seam, "cable.length_mm": 5500}
    job = read_tow_job(EXAMPLE, keys)

    sweep = check_seam(job, make_shape_planner(job))

    with pytest.raises(ConfigurationError, match=r"beyond \d+ of 1200 mm, from any of \d first"):
        sweep.refuse_if_blocked()
