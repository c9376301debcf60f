"""What is told to drive and does not is noticed; what drives to and fro is let alone."""

import numpy as np
import pytest

from tjscan.core.errors import VehicleFault
from tjscan.core.frames import Array
from tjscan.towing.pose_filter import TeamEstimate, VehiclePoseEstimate
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.standstill import (
    FIRST_RETRY_SECONDS,
    LEAST_DRIVEN_SHARE,
    LEAST_RUNAWAY_MOTION,
    SHORTEST_JUDGED_WINDOW,
    STANDSTILL_ERROR_RATE,
    RunawayCheck,
    StandstillCheck,
    StandstillWatch,
    describe_unexplained_way,
)
from tjscan.vehicle.vehicle import AT_REST, VehicleState

PERIOD = 0.1
ALONG = np.array((1e-3, 0.0))
SIGMA = 1e-4


def run(asked: list[Array], share: float) -> list[bool]:
    """Whether it counts as standing, where it goes a share of what it is told."""
    check, pose, found = StandstillCheck(), np.zeros(3), []
    for k, way in enumerate(asked):
        pose[:2] += share * way
        found.append(check.update(k * PERIOD, pose.copy(), way, sigma=SIGMA))
    return found


def test_a_vehicle_that_stands_is_noticed_after_the_window_and_tried_again() -> None:
    found = run([ALONG] * 160, 0.05)
    first = found.index(True)
    assert SHORTEST_JUDGED_WINDOW <= first * PERIOD <= SHORTEST_JUDGED_WINDOW + 2 * PERIOD
    again = first + found[first:].index(False)
    assert (again - first) * PERIOD == FIRST_RETRY_SECONDS


def test_one_that_goes_where_it_is_told_is_let_alone_also_where_it_turns_back() -> None:
    assert not any(run([ALONG] * 25 + [-ALONG] * 35 + [ALONG] * 60, 1.0))
    assert not any(run([ALONG] * 100, 0.5))


def test_a_way_that_was_not_counted_because_it_was_at_its_target_is_no_standstill() -> None:
    """It followed closely, and was then sent back: it is not where it began."""
    check, pose, found = StandstillCheck(), np.zeros(3), []
    for k in range(60):
        back = k >= 40
        pose[:2] += -2 * ALONG if back else 4 * ALONG
        way = -3 * ALONG if back else 0 * ALONG
        found.append(check.update(k * PERIOD, pose.copy(), way, sigma=SIGMA))
    assert not any(found)


def looks_that_take_it_for_standing(share: float, sigma: float, seed: int) -> list[int]:
    rng, check, place = np.random.default_rng(seed), StandstillCheck(), np.zeros(3)
    found = []
    for k in range(300):
        place[:2] += share * ALONG
        seen = place + sigma * rng.standard_normal(3)
        if check.update(k * PERIOD, seen, ALONG, sigma=sigma):
            found.append(k)
    return found


@pytest.mark.parametrize("sigma", [1e-3, 3e-3, 10e-3])
def test_noise_makes_no_driving_vehicle_stand_and_hides_none_that_stands(sigma: float) -> None:
    for seed in range(10):
        assert not looks_that_take_it_for_standing(0.9, sigma, seed)
        first = looks_that_take_it_for_standing(0.0, sigma, seed)[0] * PERIOD
        # What it is told to go is by then as far above the noise as the error rate asks for.
        needed = (
            2
            * sigma
            * np.sqrt(2 * np.log(1 / STANDSTILL_ERROR_RATE))
            / LEAST_DRIVEN_SHARE
            / (ALONG[0] / PERIOD)
        )
        assert first <= max(SHORTEST_JUDGED_WINDOW, needed) + 1.0


def test_one_that_is_told_to_stay_does_not_stand_for_good() -> None:
    assert not any(run([np.zeros(2)] * 100, 0.0))


def test_a_fault_counts_at_once_and_no_longer_than_it_is_reported() -> None:
    check = StandstillCheck()
    assert check.update(0.0, np.zeros(3), np.zeros(2), sigma=SIGMA, fault=True)
    assert not check.update(0.1, np.zeros(3), np.zeros(2), sigma=SIGMA)


def test_each_trial_in_vain_makes_the_next_one_wait_twice_as_long() -> None:
    found = run([ALONG] * 900, 0.05)
    begins = [k for k in range(1, len(found)) if found[k] and not found[k - 1]]
    ends = [k for k in range(1, len(found)) if found[k - 1] and not found[k]]
    lasted = [PERIOD * (end - begin) for begin, end in zip(begins, ends, strict=False)]
    np.testing.assert_allclose(
        lasted,
        [FIRST_RETRY_SECONDS, 2 * FIRST_RETRY_SECONDS, 4 * FIRST_RETRY_SECONDS][: len(lasted)],
        atol=PERIOD,
    )
    assert len(lasted) >= 2


def test_one_that_stood_is_doubted_until_it_is_seen_to_drive() -> None:
    check, pose = StandstillCheck(), np.zeros(3)
    for k in range(200):
        pose[:2] += ALONG if k > 60 else 0.0
        check.update(k * PERIOD, pose.copy(), ALONG, sigma=SIGMA)
        if k == 110:
            assert check.doubted
    assert not check.doubted


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_way_and_turn_are_each_held_against_what_was_commanded_of_them(share: float) -> None:
    """A quick drive allows no turn of its own, and a quick turn no way."""
    way, turn = LEAST_RUNAWAY_MOTION
    for asked, off in (((0.02, 0.0, 0.0), (0.0, 0.0, turn)), ((0.0, 0.0, 0.2), (way, 0.0, 0.0))):
        check, told = RunawayCheck(), np.array(asked)
        words = [
            check.update(k * PERIOD, told, told + share * np.array(off) / 10, PERIOD)
            for k in range(10)
        ]
        assert any(words) == (share > 1)


def test_the_cable_that_a_stopped_vehicle_holds_is_to_blame_if_it_drags_the_next_one() -> None:
    """Vehicle 1 is jammed; then vehicles 2 and 5 are dragged, and only 2 is beside it."""
    events, still = list[tuple[str, str]](), np.zeros(2)
    watch = StandstillWatch(Cable(), TowingTeam(), lambda name, text: events.append((name, text)))
    well = VehicleState(0.0, AT_REST)
    states: list[VehicleState | VehicleFault] = [VehicleFault("jammed"), *[well] * 5]
    for k, way in enumerate((0.0, 0.01)):
        offs = [np.full(2, way if v in (1, 4) else 0.0) for v in range(6)]
        seen = [VehiclePoseEstimate(np.zeros(3), SIGMA, SIGMA, 0.0, "", still, off) for off in offs]
        watch.update(k * PERIOD, PERIOD, states, [AT_REST] * 6, TeamEstimate(tuple(seen)))
    found = [(name, text.partition(":")[0]) for name, text in events]
    assert found == [("stopped", "vehicle 1"), ("moved", "vehicle 5")]


@pytest.mark.parametrize(("back", "name"), [(0.5, "slips"), (1.0, "slips"), (3.0, "moved")])
def test_wheels_that_slip_bring_a_vehicle_no_further_back_than_they_drive(
    back: float, name: str
) -> None:
    way = np.array((0.006, 0.008))
    one = VehiclePoseEstimate(np.zeros(3), 1e-4, 1e-3, 0.0, way=way, unexplained=-back * way)
    assert describe_unexplained_way(one)[0] == name
