"""A station that was scanned in motion is stitched by its sections, not by each profile of it."""

import numpy as np
from continuous_scans import scan_continuously

from tjscan.groove.read import read_groove
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile
from tjscan.scanning.section import Substep
from tjscan.stitching.stations import station_from_recording


def test_no_profile_taken_in_passing_is_read_again() -> None:
    result = scan_continuously({"scan.length_mm": 30.0})
    read: list[Profile] = []

    def reads(profile: Profile) -> GrooveSection:
        read.append(profile)
        return read_groove(profile)

    station = station_from_recording("a", np.eye(4), result.sections, result.views, reads)
    assert len(read) <= sum(view.substep is not Substep.PASSING for view in result.views)
    assert len(station.all_sections) < 2 * len(result.sections)
    assert len(result.views) > 10 * len(result.sections)
