import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.towing.loop import MEASUREMENTS_PER_PLAN
from tjscan.towing.pose_filter import VehiclePoseEstimate, VehiclePoseFilter
from tjscan.towing.tables import LocalisationSettings
from tjscan.vehicle.localisation import VehiclePose
from tjscan.vehicle.vehicle import Twist

PERIOD = 0.1
CREEP = Twist(0.01, 0.0)


def make_filter(sigma: float = 3e-3) -> VehiclePoseFilter:
    stated = LocalisationSettings(
        position_sigma=sigma, heading_sigma=float(np.radians(1.0)), lost=1.0
    )
    return VehiclePoseFilter(stated, 0.1, 0.6)


def drive(
    one: VehiclePoseFilter, steps: int, measure: object, *, start: int = 0
) -> tuple[list[VehiclePoseEstimate], Array]:
    """Drive along x at 10 mm/s; `measure` gives what is measured at each time and place."""
    found = [
        one.update(k * PERIOD, PERIOD, CREEP, measure(k, k * 1e-3))  # type: ignore[operator]
        for k in range(start, start + steps)
    ]
    return found, np.array([k * 1e-3 for k in range(start, start + steps)])


def test_noise_is_averaged_over_what_the_odometry_bridges() -> None:
    rng = np.random.default_rng(1)
    found, truth = drive(
        make_filter(),
        600,
        lambda k, x: VehiclePose(k * PERIOD, x + 3e-3 * rng.standard_normal(), 0.0, 0.0),
    )
    off = np.array([one.pose[0] for one in found])[100:] - truth[100:]
    assert np.sqrt(np.mean(off**2)) < 1e-3


def test_late_poses_are_taken_as_of_their_own_time() -> None:
    found, truth = drive(
        make_filter(), 300, lambda k, x: VehiclePose((k - 3) * PERIOD, x - 3e-3, 0.0, 0.0)
    )
    assert abs(found[-1].pose[0] - truth[-1]) < 1e-3


def test_a_pose_that_is_a_second_and_a_half_late_is_taken_so_too() -> None:
    one, look, speed, late = make_filter(), PERIOD / MEASUREMENTS_PER_PLAN, 0.02, 1.5
    for k in range(200):
        at = look * k - late
        measured = VehiclePose(at, speed * at, 0.0, 0.0) if at >= 0 else None
        found = one.update(look * k, look, Twist(speed, 0.0), measured)
    assert found.pose[0] == pytest.approx(speed * look * 199, abs=1e-3)


def test_poses_out_of_order_count_for_nothing() -> None:
    one = make_filter()
    drive(one, 50, lambda k, x: VehiclePose(k * PERIOD, x, 0.0, 0.0))
    found, truth = drive(one, 5, lambda k, x: VehiclePose(1.0, 0.3, 0.0, 0.0), start=50)
    assert found[-1].pose[0] == pytest.approx(truth[-1], abs=1e-3)


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        (lambda k, x: VehiclePose(k * PERIOD, x + 0.5, 0.0, 0.0), "jumped"),
        (lambda k, x: VehiclePose(k * PERIOD, 0.049, 0.0, 0.0), "frozen"),
        (lambda k, x: VehiclePose(k * PERIOD, np.nan, 0.0, 0.0), "not a number"),
        (lambda k, x: None, "none comes"),
    ],
)
def test_what_cannot_be_is_refused_and_named(fault: object, why: str) -> None:
    one = make_filter(0.5e-3)
    drive(one, 50, lambda k, x: VehiclePose(k * PERIOD, x, 0.0, 0.0))
    found, truth = drive(one, 40, fault, start=50)
    assert found[-1].refused == why
    assert found[-1].age > 1.0
    assert found[-1].pose[0] == pytest.approx(truth[-1], abs=15e-3)


def scattered(sigma: float, rng: np.random.Generator, slip: float = 1.0) -> object:
    return lambda k, x: VehiclePose(
        k * PERIOD,
        slip * x + sigma * rng.standard_normal(),
        sigma * rng.standard_normal(),
        6 * sigma * rng.standard_normal(),
    )


def test_poses_that_scatter_more_than_stated_count_for_less() -> None:
    one, rng = make_filter(0.5e-3), np.random.default_rng(2)
    found, truth = drive(one, 600, scattered(3e-3, rng))
    off = np.array([one.pose[0] for one in found])[100:] - truth[100:]
    assert one.scatter[0] == pytest.approx(3e-3, rel=0.4)
    assert np.sqrt(np.mean(off**2)) < 1e-3


def test_poses_that_scatter_as_stated_count_for_what_is_stated_though_wheels_slip() -> None:
    one = make_filter(0.5e-3)
    drive(one, 300, scattered(0.5e-3, np.random.default_rng(3), slip=0.5))
    assert one.scatter[0] == pytest.approx(0.5e-3, rel=0.4)


def test_scatter_that_ends_is_forgotten() -> None:
    one, rng = make_filter(0.5e-3), np.random.default_rng(4)
    drive(one, 200, scattered(3e-3, rng))
    drive(one, 100, scattered(0.2e-3, rng), start=200)
    assert one.scatter[0] == 0.5e-3


def share_believed(way: float, off: complex) -> complex:
    """Of a step off the way, along it or across, what is believed after two seconds."""
    turn = np.exp(1j * way)

    def measured(k: int, x: float) -> VehiclePose:
        at = (x + off * (k > 300)) * turn
        return VehiclePose(k * PERIOD, at.real, at.imag, way)

    found, truth = drive(make_filter(), 320, measured)
    return complex((complex(*found[-1].pose[:2]) / turn - truth[-1]) / off)


def test_whichever_way_it_drives_odometry_counts_for_more_across_it_than_along() -> None:
    along, across = (share_believed(0.0, off) for off in (1e-3, 1e-3j))
    assert 0 < across.real < 0.8 * along.real
    assert share_believed(0.7, 1e-3) == pytest.approx(along)
    assert share_believed(0.7, 1e-3j) == pytest.approx(across)
