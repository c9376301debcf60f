"""A simulated crawl's metal lies where its torch truly was, and its laser sees it there."""

from __future__ import annotations

import numpy as np
import pytest

from tjscan.crawler.plan import PassSettings
from tjscan.job.crawl.job import SimulatedWeldSettings
from tjscan.job.crawl.weld import CrawlWeld
from tjscan.joint.hull import HullJoint, hull_section
from tjscan.laser.section_laser import SectionLaserModel, SectionLaserPose, cast_rays_on_section
from tjscan.welding.bead import column_widths

JOINT = HullJoint(width=0.024, depth=0.018, length=0.12)
PASS = PassSettings(speed=5e-3, height=-6e-3)


def crawl(
    weld: CrawlWeld, right: float, speed: float, begin: float = 0.0, end: float = 0.12
) -> None:
    """Burn an arc along the joint, a sample each 0.04 s."""
    for time in np.arange(0.0, (end - begin) / speed, 0.04):
        weld.burn(float(time), begin + speed * float(time), right)
    weld.end_arc(PASS)


def centre_and_area(weld: CrawlWeld, at: float = 0.06) -> tuple[float, float]:
    state = weld.metal.state
    row = int(np.abs(state.s - at).argmin())
    metal = (column_widths(state.u) * (state.w - state.base))[row]
    return float(np.sum(metal * state.u[row]) / metal.sum()), float(metal.sum())


def test_bead_follows_the_torch_and_its_speed() -> None:
    slow, fast, beside = (CrawlWeld(JOINT, SimulatedWeldSettings(), 1) for _ in range(3))
    crawl(slow, 0.0, 4e-3)
    crawl(fast, 0.0, 8e-3)
    crawl(beside, 2e-3, 4e-3)
    (middle, area), (_, half), (right, _) = map(centre_and_area, (slow, fast, beside))
    wire = 0.25 * np.pi * 1.2e-3**2 * 0.95 * 9 / 60
    assert area == pytest.approx(wire / 4e-3, rel=1e-3)
    assert half == pytest.approx(area / 2, rel=1e-3)
    assert right - middle > 0.3e-3


def test_laser_sees_the_bead_and_the_plates_beyond() -> None:
    weld = CrawlWeld(JOINT, SimulatedWeldSettings(), 1)
    bare, model = weld.outline(0.06), SectionLaserModel()
    seen = cast_rays_on_section(bare, SectionLaserPose(), model)
    truth = cast_rays_on_section(hull_section(JOINT, 0.06), SectionLaserPose(), model)
    np.testing.assert_allclose(seen, truth, atol=0.15e-3)
    crawl(weld, 0.0, 4e-3)
    welded = cast_rays_on_section(weld.outline(0.06), SectionLaserPose(), model)
    assert np.nanmax(seen - welded) > 2e-3
    assert np.nanmin(seen - welded) > -0.3e-3  # nothing sinks but the side that comes nearer


def test_arc_of_no_length_leaves_nothing_and_one_of_fewer_samples_the_same() -> None:
    """An interrupted crawl has every tenth sample, and goes on in the same metal."""
    faults = SimulatedWeldSettings(slip=0.03, wander=0.4e-3, width_sigma=0.05)
    weld, again = (CrawlWeld(JOINT, faults, 1) for _ in range(2))
    weld.burn(0.0, 0.05, 0.0)
    weld.end_arc(PASS)
    assert not weld.metal.state.metal_area.any()
    for one, every in ((weld, 1), (again, 10)):
        for begin in (0.0, 0.01):
            for time in np.arange(0.0, 15.0, 0.01)[::every].tolist():
                swing = 1.5e-3 * np.sin(np.pi * time)
                one.burn(time, begin + 4e-3 * time, 0.5e-3 + float(swing))
            one.end_arc(PASS)
    s, laid = weld.metal.state.s, weld.metal.state.metal_area > 0
    assert laid[(s > 0.01) & (s < 0.05)].all()
    assert not laid[(s < -0.01) | (s > 0.08)].any()
    np.testing.assert_allclose(again.metal.state.w, weld.metal.state.w, atol=0.15e-3)
