"""What stops the crawler."""

from contextlib import nullcontext
from math import inf, nan

import numpy as np
import pytest

from tjscan.core.errors import CrawlStopped
from tjscan.crawler.guards import (
    MOST_CYCLES_OFF,
    Guards,
    ProximityFilter,
    ProximitySensorPlaces,
    ProximitySettings,
)
from tjscan.crawler.method import OffsetEstimate
from tjscan.crawler.plan import GuardSettings
from tjscan.crawler.slip_aware import SlipAwareMethod, SteeringSettings
from tjscan.crawler.slip_estimator import CrawlerGeometry, SlipEstimate, SlipUncertainty
from tjscan.vehicle.vehicle import Twist, VehicleState

STEEL = (0.03,) * 4


def guards() -> Guards:
    found = Guards(
        GuardSettings(),
        ProximityFilter(ProximitySettings(samples=1)),
        ProximitySensorPlaces(0.8, 0.5),
    )
    found.watch_vehicle(VehicleState(0.0, Twist(0.0, 0.0), proximity=STEEL))
    return found


@pytest.mark.parametrize(
    ("state", "guard"),
    [
        (VehicleState(0.0, Twist(0.0, 0.0), fault="overheated"), "drive fault"),
        (VehicleState(0.0, Twist(nan, 0.0)), "vehicle"),
        (VehicleState(0.0, Twist(0.0, 0.0), gyro=(nan,)), "vehicle"),
        (VehicleState(0.0, Twist(0.0, 0.0), down=(inf,)), "vehicle"),
        (VehicleState(0.0, Twist(0.0, 0.0), torques=(inf, 0.0)), "vehicle"),
        (VehicleState(0.0, Twist(0.0, 0.0), torques=(3.0, -85.0)), "torque"),
    ],
)
def test_a_vehicle_that_is_not_well_is_stopped(state: VehicleState, guard: str) -> None:
    with pytest.raises(CrawlStopped) as caught:
        guards().watch_vehicle(state)
    assert caught.value.guard == guard


def test_a_vehicle_whose_proximity_sensors_fall_silent_is_stopped() -> None:
    found = guards()
    for _ in range(100):
        found.watch_vehicle(VehicleState(0.0, Twist(0.1, 0.0), proximity=STEEL), 0.01)
        for _ in range(9):
            found.watch_vehicle(VehicleState(0.0, Twist(0.1, 0.0)), 0.01)
    for _ in range(40):
        found.watch_vehicle(VehicleState(0.0, Twist(0.1, 0.0)), 0.01)
    with pytest.raises(CrawlStopped, match="silent"):
        found.watch_vehicle(VehicleState(0.0, Twist(0.1, 0.0)), 0.02)


def test_a_gap_between_two_states_speaks_against_no_sensor_and_no_drive() -> None:
    found = guards()
    found.watch_vehicle(VehicleState(0.0, Twist(0.1, 0.0), proximity=STEEL), 0.01)
    found.watch_vehicle(VehicleState(0.0, Twist(0.0, 0.0)), 1.9)
    found.watch_progress(0.1, 0.0, 1.9)
    for _ in range(39):
        found.watch_vehicle(VehicleState(0.0, Twist(0.0, 0.0)), 0.01)
    with pytest.raises(CrawlStopped, match="silent"):
        found.watch_vehicle(VehicleState(0.0, Twist(0.0, 0.0)), 0.02)


@pytest.mark.parametrize(("asked", "shown"), [(0.005, 0.0), (-0.04, 0.001), (0.02, -0.02)])
def test_a_vehicle_that_does_not_move_as_asked_is_stopped(asked: float, shown: float) -> None:
    found = guards()
    for _ in range(90):
        found.watch_progress(asked, shown, 0.01)  # drives take a while to get going
    for _ in range(1000):
        found.watch_progress(asked, asked, 0.01)
        found.watch_progress(0.0, 0.0, 0.01)
    for _ in range(99):
        found.watch_progress(asked, shown, 0.01)
    with pytest.raises(CrawlStopped, match="encoders show"):
        found.watch_progress(asked, shown, 0.02)


def test_a_joint_is_lost_after_a_way_or_a_time() -> None:
    found = guards()
    for _ in range(19):
        found.watch_joint(None, 0.1, 0.01)
    found.watch_joint(0.001, 0.1, 0.01)  # seen again: it begins anew
    for _ in range(19):
        found.watch_joint(None, 0.1, 0.01)
    with pytest.raises(CrawlStopped, match=r"not seen for 20 mm.*If it ends there, put plates on"):
        found.watch_joint(None, 0.1, 0.011)
    standing = guards()
    for _ in range(19):
        standing.watch_joint(None, 0.0, 0.1)
    with pytest.raises(CrawlStopped):
        standing.watch_joint(None, 0.0, 0.11)


def test_it_goes_on_along_a_joint_that_a_tack_fills_but_not_for_long() -> None:
    found = guards()
    for _ in range(59):
        found.watch_joint(None, 0.005, 0.2, filled=True)
    found.watch_joint(0.001, 0.005, 0.2)
    for _ in range(59):
        found.watch_joint(None, 0.005, 0.2, filled=True)
    with pytest.raises(CrawlStopped, match="not seen for 61 mm"):
        found.watch_joint(None, 0.005, 0.4, filled=True)


@pytest.mark.parametrize(
    ("speed", "period", "filled", "named"),
    [
        (0.5, 0.05, False, ["guards.blind_travel_mm"]),
        (0.0, 2.1, False, ["guards.blind_time_s"]),
        (0.1, 2.1, False, ["guards.blind_travel_mm", "guards.blind_time_s"]),
        (0.1, 1.0, True, ["guards.filled_travel_mm"]),
    ],
)
def test_the_stop_names_the_keys_that_would_allow_more(
    speed: float, period: float, *, filled: bool, named: list[str]
) -> None:
    with pytest.raises(CrawlStopped) as caught:
        guards().watch_joint(None, speed, period, filled=filled)
    assert f"allow more in {' and '.join(named)}. " in str(caught.value)


@pytest.mark.parametrize(
    ("offset", "sigma", "goes_on"),
    [
        (0.0, 0.007, True),  # of a field of 22 mm
        (0.0, 0.008, False),
        (-0.015, 0.002, True),
        (0.015, 0.003, False),  # known well, and known to be near the end of the line
        (-0.023, 0.0, False),
        (nan, 0.001, False),
    ],
)
def test_where_nothing_is_left_to_weld_a_joint_need_not_be_seen_but_must_be_near(
    offset: float, sigma: float, goes_on: bool
) -> None:
    found, estimated = guards(), OffsetEstimate(offset, sigma)
    assert found.surely_in_view(estimated) == goes_on
    stops = pytest.raises(CrawlStopped, match="not seen for")
    with nullcontext() if goes_on else stops:
        for _ in range(100):
            found.watch_joint(None, 0.1, 0.01, estimated=estimated)


@pytest.mark.parametrize("x", [(1e-3, 0.02), (-4e-3, -0.01)])
def test_the_laser_is_where_torch_and_heading_put_it(x: tuple[float, float]) -> None:
    """Truth of another make: the offset's variance by sampling what is estimated."""
    estimate = SlipEstimate.before_any_reading(SlipUncertainty(), curvature=0.02)
    state = estimate.x.copy()
    state[:2] = x
    geometry = CrawlerGeometry(0.5, 0.1)
    method = SlipAwareMethod(
        geometry, SlipEstimate(state, estimate.P), SlipUncertainty(), SteeringSettings()
    )
    q, heading = np.random.default_rng(0).multivariate_normal(x, estimate.P[:2, :2], 100_000).T
    d = q + 0.5 * np.tan(heading)
    assert method.laser.offset == pytest.approx(x[0] + 0.5 * np.tan(x[1]) - 0.02 * 0.5**2 / 2)
    assert method.laser.sigma == pytest.approx(np.std(d), rel=0.01)


def test_a_joint_that_leaves_the_line_is_one_too_many() -> None:
    guards().watch_joint(0.021, 0.005, 0.01)
    with pytest.raises(CrawlStopped, match="does not follow"):
        guards().watch_joint(-0.023, 0.005, 0.01)


def test_nothing_drives_over_an_edge_but_away_from_it() -> None:
    found = guards()
    found.watch_vehicle(VehicleState(0.0, Twist(0.1, 0.0), proximity=(inf, inf, 0.03, 0.03)))
    assert not found.is_on_steel
    found.check_command(Twist(-0.05, 0.0))
    with pytest.raises(CrawlStopped, match="front left, front right"):
        found.check_command(Twist(0.01, 0.0))


@pytest.mark.parametrize(
    ("deviation", "sigma", "guard"),
    [
        (1.1e-3, 0.1e-3, "torch off its path"),
        (nan, 0.1e-3, "torch off its path"),
        (0.0, 0.61e-3, "torch not known"),
        (0.0, nan, "torch not known"),
    ],
)
def test_nothing_is_welded_where_the_torch_is_off_or_not_known(
    deviation: float, sigma: float, guard: str
) -> None:
    guards().watch_weld(-0.9e-3, 0.59e-3)
    with pytest.raises(CrawlStopped) as caught:
        guards().watch_weld(deviation, sigma)
    assert caught.value.guard == guard


def test_a_burning_torch_is_off_for_some_cycles_on_end_in_which_its_cause_may_show() -> None:
    found = guards()
    for off in (*[1.1e-3] * MOST_CYCLES_OFF, 0.0, *[-1.1e-3] * MOST_CYCLES_OFF):
        found.watch_weld(off, 0.1e-3, burning=True)
    with pytest.raises(CrawlStopped) as caught:
        found.watch_weld(-1.1e-3, 0.1e-3, burning=True)
    assert caught.value.guard == "torch off its path"
