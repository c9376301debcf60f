"""A report begins with the number that was asked for, and no ghost leads."""

from dataclasses import replace

import numpy as np

from tjscan.report.data import ReportData
from tjscan.report.findings import headline_numbers


def test_the_first_number_is_the_corners_and_no_ghost_leads(data: ReportData) -> None:
    assert data.comparison is not None
    cloud, corners = data.comparison.deviations
    ghosts = np.array(cloud.distances)
    ghosts[: len(ghosts) // 10] = 17.8e-3
    spoilt = replace(
        data.comparison, deviations=(replace(cloud, distances=ghosts), corners), tolerance=1e-3
    )
    first = next(headline_numbers(replace(data, comparison=spoilt)))
    assert first.value == f"{corners.statistics.p95:.2f} mm, within"
    assert first.judged == "good"
    alone = replace(spoilt, deviations=spoilt.deviations[:1], tolerance=None)
    assert float(next(headline_numbers(replace(data, comparison=alone))).value.split()[0]) < 0.1
    bare = next(headline_numbers(replace(data, comparison=None)))
    assert bare.value.endswith("mm of groove")
