"""Data that contradict themselves stop arc and vehicle, and the cause is named."""

from collections.abc import Callable, Iterable
from contextlib import nullcontext, suppress
from dataclasses import replace
from math import radians, sqrt
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from crawls import SHORT

from tjscan.core.errors import CrawlStopped
from tjscan.crawler.contradiction import ContradictionWatch, InertialWatch
from tjscan.crawler.joint_sections import shows_filled_joint
from tjscan.crawler.journal import CrawlCycle
from tjscan.job.crawl.cell import CrawlCell, make_crawl_cell
from tjscan.job.crawl.job import read_crawl_job
from tjscan.laser.profile import Profile
from tjscan.runs.crawl.run import CrawlContext, make_crawler
from tjscan.vehicle.simulated import SimulatedVehicle
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist, VehicleState

GAUGE = TrackGeometry().gauge
MOST_WAY, MOST_OFF = 10e-3, 1e-3
"""Metres of travel after a fault, beyond which no arc may be so many metres beside the joint."""

JOB = SHORT.replace("length_m = 0.03", "length_m = 0.06").replace(
    "run_up_mm = 30", "run_up_mm = 60"
)


class Spoilt:
    """A device that reports what a function makes of its report, from the place of a fault on."""

    def __init__(self, device: Any, method: str, spoil: Callable[[Any], Any] | None) -> None:
        self._device, self._method, self._spoil = device, method, spoil
        self.broken = False

    def __getattr__(self, name: str) -> Any:
        if name != self._method:
            return getattr(self._device, name)
        return self._report

    def _report(self) -> Any:
        report = getattr(self._device, self._method)()
        return self._spoil(report) if self.broken and self._spoil else report


class Fault:
    """A journal that lets a fault begin 20 mm into the first weld, and notes what follows."""

    def __init__(self, begin: Callable[[], None], cell: CrawlCell) -> None:
        self._begin, self._cell = begin, cell
        self._began: float | None = None
        self.arc_way = self.worst = 0.0

    def record(self, message: object) -> None:
        if not (isinstance(message, CrawlCycle) and message.arc and self._cell.world):
            return
        along, off = self._cell.world.torch_place()
        if along > 20e-3 and self._began is None:
            self._began = along
            self._begin()
        if self._began is not None:
            self.arc_way = along - self._began
            if self.arc_way > MOST_WAY:
                self.worst = max(self.worst, abs(off + message.torch_y - message.path))


def wheels(state: VehicleState, left: float, right: float, bias: float = 0.0) -> VehicleState:
    """A state whose encoders show shares of what its wheels do."""
    half = GAUGE * state.odometry.turn_rate / 2
    one, other = left * (state.odometry.speed + half), right * (state.odometry.speed - half) + bias
    return replace(state, odometry=Twist((one + other) / 2, (one - other) / GAUGE))


def frozen() -> Callable[[Profile], Profile]:
    """A laser that repeats one picture with a micrometre of noise."""
    first: list[Profile] = []
    rng = np.random.default_rng(3)

    def repeat(profile: Profile) -> Profile:
        first.append(profile)
        noise = 1e-6 * rng.standard_normal(len(profile))
        return replace(first[0], z_s=first[0].z_s + noise, time=profile.time)

    return repeat


def mirrored(profile: Profile) -> Profile:
    return replace(profile, x_s=-profile.x_s[::-1], z_s=profile.z_s[::-1])


def moved(cell: CrawlCell, aside: float, turn: float) -> None:
    """Knock a simulated vehicle aside."""
    assert isinstance(cell.vehicle, SimulatedVehicle)
    plant: Any = cell.vehicle.body.plant
    plant.pose_w = np.add(plant.pose_w, (0.0, aside, turn))


def slips(cell: CrawlCell, right: float) -> None:
    """Let the right track lose a share of its way, unseen by its encoder."""
    assert isinstance(cell.vehicle, SimulatedVehicle)
    plant: Any = cell.vehicle.body.plant
    sound = plant.advance
    plant.advance = lambda one, other, period: sound(one, right * other, period)


def crawl_with(
    tmp_path: Path,
    state: Callable[[VehicleState], VehicleState] | None = None,
    picture: Callable[[Profile], Profile] | None = None,
    happens: Callable[[CrawlCell], None] | None = None,
    tables: str = "",
) -> tuple[CrawlStopped, Fault]:
    """Weld with a fault, and return the stop, and where it came."""
    file = tmp_path / "job.toml"
    file.write_text(JOB + tables)
    context = CrawlContext(read_crawl_job(file), file)
    cell = make_crawl_cell(context.job)
    vehicle = Spoilt(cell.vehicle, "next_state", state)
    laser = Spoilt(cell.laser, "capture", picture)

    def begin() -> None:
        vehicle.broken = laser.broken = True
        if happens is not None:
            happens(cell)

    notes = Fault(begin, cell)
    devices = replace(cell, vehicle=vehicle, laser=laser)
    with cell:
        with pytest.raises(CrawlStopped) as caught:
            make_crawler(context, devices, context.make_method(), notes).run()
        assert not cell.torch.arc
    assert notes.worst < MOST_OFF
    return caught.value, notes


@pytest.mark.parametrize("aside", [-10e-3, -2e-3, 1e-3, 5e-3])
def test_a_knock_stops_it(tmp_path: Path, aside: float) -> None:
    stop, notes = crawl_with(tmp_path, happens=lambda cell: moved(cell, aside, 0.0))
    assert stop.guard == "knocked aside"
    assert ("right" if aside > 0 else "left") in stop.reason
    assert notes.arc_way < MOST_WAY / 2


def test_a_turn_round_stops_it(tmp_path: Path) -> None:
    stop, notes = crawl_with(tmp_path, happens=lambda cell: moved(cell, 0.0, radians(0.3)))
    assert stop.guard == "knocked aside"
    assert notes.arc_way < MOST_WAY / 2


@pytest.mark.parametrize(
    ("spoil", "track"),
    [
        (lambda state: wheels(state, 0.0, 1.0), "left track does not move"),
        (lambda state: wheels(state, 1.0, 0.0), "right track does not move"),
        (lambda state: wheels(state, 1.0, 0.7), "right"),
        (lambda state: wheels(state, 1.15, 1.0), "left"),
        (lambda state: wheels(state, 1.0, 0.0, 0.012), "right"),
    ],
)
def test_a_dead_or_wrong_encoder_stops_it(
    tmp_path: Path, spoil: Callable[[VehicleState], VehicleState], track: str
) -> None:
    stop, _ = crawl_with(tmp_path, state=spoil)
    assert stop.guard in ("encoder", "slip")
    assert track in stop.reason


def test_a_track_that_slips_unseen_stops_it(tmp_path: Path) -> None:
    stop, notes = crawl_with(tmp_path, happens=lambda cell: slips(cell, 0.8))
    assert stop.guard == "slip"
    assert "the right track slips" in stop.reason
    assert notes.arc_way < MOST_WAY


def test_a_gyro_whose_bias_jumps_stops_it(tmp_path: Path) -> None:
    stop, _ = crawl_with(
        tmp_path,
        state=lambda state: replace(state, gyro=(state.gyro[0] + radians(0.5),)),
        tables="[simulation.vehicle.inertial]\n",
    )
    assert stop.guard == "gyro"
    assert "to the right" in stop.reason


def turning(rate: float, k: int) -> VehicleState:
    """What a gyro and noisy encoders show in one period or another."""
    return VehicleState(0.02 * k, Twist(8e-3, 1e-3 + 1e-5 * (k % 7)), gyro=(rate,))


def go_on_with_gyro(watch: InertialWatch, rates: Iterable[float]) -> None:
    for k, rate in enumerate(rates):
        watch.add(turning(rate, k), (0.0, 0.0), 0.02)


def test_a_gyro_that_repeats_one_value_while_the_tracks_turn_is_dead() -> None:
    watch, rng = InertialWatch(), np.random.default_rng(4)
    go_on_with_gyro(watch, rng.standard_normal(1500))
    for k in range(100):  # exact, as the tracks that it drives
        watch.add(replace(turning(0.0, k), odometry=Twist(8e-3, 0.0)), (0.0, 0.0), 0.02)
    with pytest.raises(CrawlStopped, match=r"is dead: it shows 0\.000 mrad/s"):
        go_on_with_gyro(watch, [0.0] * 30)


def test_a_gyro_that_is_coarse_and_smoothed_is_not_dead() -> None:
    steps = np.cumsum(np.random.default_rng(5).standard_normal(20_000))
    go_on_with_gyro(InertialWatch(), np.round(steps / 20).tolist())


def test_noise_that_wanders_for_seconds_stops_no_sound_crawl() -> None:
    watch, rng, off = InertialWatch(), np.random.default_rng(6), np.zeros(2)
    for k in range(30_000):  # an hour's sixth, of three deviations of a mean each
        off += -0.01 * off + 3 * sqrt(0.02) * rng.standard_normal(2)
        rate = float(rng.standard_normal())
        watch.add(turning(rate, k), (float(off[0]), float(off[1])), 0.02)


@pytest.mark.parametrize(
    ("gyro", "misfit", "guard"),
    [((), 0.0, "slip"), ((1e-3,), 0.0, "joint bends"), ((1e-3,), 8.0, "slip")],
)
def test_a_joint_that_bends_is_told_from_tracks_that_slip_by_the_gyro(
    gyro: tuple[float, ...], misfit: float, guard: str
) -> None:
    watch, rng, going = (
        ContradictionWatch(TrackGeometry()),
        np.random.default_rng(8),
        Twist(8e-3, 0),
    )
    with pytest.raises(CrawlStopped) as caught:  # noqa: PT012
        for k in range(400):
            aside = 1e-6 * max(k - 100, 0)
            off = 10e-6 * rng.standard_normal() + aside
            watch.add(going, going, 0.02, groove(-aside, rng), (off, off))
            turns = misfit if k > 100 else 0.0
            watch.inertial.add(VehicleState(0.02 * k, going, gyro=gyro), (turns, 0.0), 0.02)
    assert caught.value.guard == guard


@pytest.mark.parametrize(
    ("gyro", "misfit", "bends"), [((), 0.0, 1), ((1e-3,), 0.0, 1), ((1e-3,), 4.0, 0)]
)
def test_a_bend_is_followed_unless_the_gyro_denies_it(
    gyro: tuple[float, ...], misfit: float, bends: int
) -> None:
    watch, going = ContradictionWatch(TrackGeometry()), Twist(8e-3, 0)
    rng, followed = np.random.default_rng(8), list[bool]()

    def follow_bend() -> bool:
        followed.append(True)
        return True

    with nullcontext() if bends else pytest.raises(CrawlStopped, match="track slips"):
        for k in range(300):
            off = 10e-6 * rng.standard_normal()
            off += 0.0 if followed else 1e-6 * max(k - 100, 0)
            watch.add(going, going, 0.02, groove(-off, rng), (off, off), follow_bend=follow_bend)
            watch.inertial.add(VehicleState(0.02 * k, going, gyro=gyro), (misfit, 0.0), 0.02)
    assert len(followed) == bends


def is_followed(aside: Callable[[float], float], noise: float, seed: int, rest: float) -> bool:
    """Whether readings that go aside along the way are followed as a bend, or stop the crawl.

    At 0.2 m the vehicle rests for a second, in which it goes aside by `rest`.
    """
    watch, rng = ContradictionWatch(TrackGeometry()), np.random.default_rng(seed)
    empty, way, slid = Profile(np.empty(0), np.empty(0)), 0.0, 0.0
    followed: list[float] = []

    def follow_bend() -> bool:
        followed.append(way)
        return True

    for k in range(600):
        rests = 250 <= k < 300
        going = Twist(0.0 if rests else 40e-3, 0.0)
        way, slid = way + 0.02 * going.speed, slid + rests * rest / 50
        off = aside(way) + slid + noise * rng.standard_normal()
        try:
            may_bend = None if rests else follow_bend
            watch.add(going, going, 0.02, empty, (off, off), follow_bend=may_bend)
        except CrawlStopped:
            return False
        if followed:
            return True
    raise AssertionError("nothing was noticed")


@pytest.mark.parametrize("noise", [10e-6, 40e-6, 80e-6])
@pytest.mark.parametrize("size", [-10e-3, 5e-3, -2e-3, 1e-3, 0.5e-3])
def test_a_knock_is_never_followed_as_a_bend(size: float, noise: float) -> None:
    for seed in range(10):
        at = 0.15 + 7e-4 * seed
        assert not is_followed(lambda way, at=at: size * (way > at), noise, seed, 0.0)  # type: ignore[misc]


@pytest.mark.parametrize("noise", [10e-6, 40e-6, 80e-6])
@pytest.mark.parametrize("slide", [3e-3, -1e-3, 0.5e-3])
def test_a_slide_at_rest_is_never_followed_as_a_bend(slide: float, noise: float) -> None:
    for seed in range(10):
        assert not is_followed(lambda way: 0.0, noise, seed, slide)


def test_a_push_that_leads_farther_aside_than_a_bend_is_not_followed() -> None:
    for seed in range(10):
        assert not is_followed(
            lambda way: 3e-3 * min(max((way - 0.15) / 0.01, 0), 1), 15e-6, seed, 0
        )


def test_readings_that_stay_off_by_little_are_noticed_within_a_few_centimetres() -> None:
    """As a joint that bends leaves them where the filter takes most of it for slip."""
    with pytest.raises(AssertionError, match="nothing was noticed"):
        is_followed(lambda way: 15e-6 * (way > 0.1), 15e-6, 1, 0.0)
    assert not is_followed(lambda way: 40e-6 * (0.1 < way < 0.16), 15e-6, 1, 0.0)


@pytest.mark.parametrize(
    ("surprise", "slope", "followed"),
    [(35e-6, 0.02, True), (11e-6, 0.02, False), (25e-6, 0.0, False), (25e-6, None, False)],
)
def test_a_bend_that_is_taken_for_slip_is_followed_from_three_deviations_on(
    surprise: float, slope: float | None, followed: bool
) -> None:
    """Of a course that bends: not of one that goes straight aside."""
    for seed in range(5):
        watch, rng = ContradictionWatch(TrackGeometry()), np.random.default_rng(seed)
        going, empty = Twist(0.02, 0.0), Profile(np.empty(0), np.empty(0))
        follow_bend = Mock(return_value=True)
        for k in range(400):
            way = 0.02 * 0.02 * k
            aside = 0.02 * way if slope is None else slope * max(way - 0.08, 0.0)
            off = surprise * (k > 200) + 15e-6 * rng.standard_normal()
            course = aside + 15e-6 * rng.standard_normal()
            watch.add(going, going, 0.02, empty, (off, course), follow_bend=follow_bend)
            if follow_bend.called:
                break
        assert follow_bend.called == followed


def test_a_kink_is_followed_among_the_noise_of_readings() -> None:
    def kink(way: float) -> float:
        into = min(max((way - 0.05) / 0.1, 0.0), 1.0)
        return 3e-3 * into**2 * (3 - 2 * into)

    assert all(is_followed(kink, 15e-6, seed, 0.0) for seed in range(10))


@pytest.mark.parametrize(("name", "place"), [("gyro", 0), ("inclinometer", 1)])
def test_a_bias_stops_it_and_noise_or_a_push_do_not(name: str, place: int) -> None:
    watch, rng = InertialWatch(), np.random.default_rng(3)

    def go_on(times: int, bias: float) -> None:
        for k in range(times):
            misfits = np.sqrt(50) * rng.standard_normal(2)
            misfits[place] += bias
            watch.add(turning(float(rng.standard_normal()), k), tuple(misfits.tolist()), 0.02)

    go_on(20_000, 0.0)
    go_on(2, 1e3)
    go_on(200, 0.0)
    with pytest.raises(CrawlStopped) as caught:
        go_on(150, 8.0)
    assert caught.value.guard == name


def test_a_frozen_laser_stops_it(tmp_path: Path) -> None:
    stop, notes = crawl_with(tmp_path, picture=frozen())
    assert stop.guard == "laser frozen"
    assert notes.arc_way < MOST_WAY


def test_a_mirrored_picture_stops_it(tmp_path: Path) -> None:
    stop, notes = crawl_with(
        tmp_path, picture=mirrored, tables="[simulation.joint]\nhigh_low_mm = 1.0\n"
    )
    assert stop.guard == "laser mirrored"
    assert notes.arc_way < MOST_WAY


def groove(at: float, rng: np.random.Generator) -> Profile:
    """A picture of a V joint of 20 mm at a place across."""
    x = np.linspace(-0.04, 0.04, 290)
    depth = np.maximum(0.0, 0.010 - np.abs(x - at))
    return Profile(x, 0.149 + depth + 60e-6 * rng.standard_normal(290))


@pytest.mark.parametrize(("read", "seen", "guard"), [(8e-3, 0.0, "joint jumped"), (3e-3, 3e-3, "")])
def test_a_joint_that_jumps_in_its_picture_is_another(read: float, seen: float, guard: str) -> None:
    watch, rng = ContradictionWatch(TrackGeometry()), np.random.default_rng(1)
    going = Twist(8e-3, 0.0)

    def go_on(surprise: float | None, at: float) -> None:
        watch.add(
            going, going, 0.01, groove(at, rng), None if surprise is None else (surprise, surprise)
        )

    for _ in range(200):
        go_on(20e-6 * rng.standard_normal(), 0.0)
    with pytest.raises(CrawlStopped) as caught:  # noqa: PT012
        for _ in range(100):
            go_on(read, -seen)
    assert caught.value.guard == (guard or "knocked aside")


def test_a_picture_that_moved_and_shows_no_joint_is_a_knock() -> None:
    watch, rng = ContradictionWatch(TrackGeometry()), np.random.default_rng(1)
    going = Twist(8e-3, 0.0)
    for _ in range(200):
        watch.add(going, going, 0.01, groove(0.0, rng), (20e-6 * rng.standard_normal(), 0.0))
    for _ in range(50):  # blind, but nothing moved
        watch.add(going, going, 0.01, groove(0.0, rng), None)
    with pytest.raises(CrawlStopped, match=r"4\.0 mm to the left"):  # noqa: PT012
        for _ in range(10):
            watch.add(going, going, 0.01, groove(4e-3, rng), None)


@pytest.mark.parametrize("knock", [0.0, 3e-3, -5e-3])
def test_a_bead_whose_shape_changes_unread_is_no_knock_and_hides_none(knock: float) -> None:
    """The valley between two beads goes aside: far behind, the picture looks like a moved one."""
    watch, rng = ContradictionWatch(TrackGeometry()), np.random.default_rng(1)
    going, ways = Twist(8e-3, 0.0), np.arange(0.0, 0.03, 80e-6).tolist()
    for _ in range(200):
        watch.add(going, going, 0.01, groove(0.0, rng), (20e-6 * rng.standard_normal(), 0.0))
    for way in ways:
        watch.add(going, going, 0.01, groove(0.2 * way, rng), None)
    with pytest.raises(CrawlStopped, match="was knocked") if knock else nullcontext():
        for way in ways[:10]:
            watch.add(going, going, 0.01, groove(0.2 * (ways[-1] + way) + knock, rng), None)


def test_a_joint_that_a_tack_fills_is_no_knock() -> None:
    watch, rng = ContradictionWatch(TrackGeometry()), np.random.default_rng(1)
    going, flat = Twist(8e-3, 0.0), Profile(np.linspace(-0.04, 0.04, 290), np.full(290, 0.149))
    for _ in range(200):
        watch.add(going, going, 0.01, groove(0.01, rng), (20e-6 * rng.standard_normal(), 0.0))
    for _ in range(100):
        noise = rng.uniform(-0.04, 0.0, 290) * np.repeat(rng.random(145) < 0.1, 2)
        seen = replace(flat, z_s=flat.z_s + noise + 60e-6 * rng.standard_normal(290))
        assert shows_filled_joint(seen)
        assert not shows_filled_joint(groove(0.01, rng))
        watch.add(going, going, 0.01, seen, None, filled=True)


@pytest.mark.parametrize("correlation", [0.0, 0.9, 0.99])
def test_readings_off_by_chance_stop_nothing(correlation: float) -> None:
    """Errors of 30 µm, also those that last for a millimetre of way."""
    watch, rng = ContradictionWatch(TrackGeometry()), np.random.default_rng(2)
    going, off, empty = Twist(8e-3, 0.0), 0.0, Profile(np.empty(0), np.empty(0))
    for _ in range(50_000):
        new = 30e-6 * np.sqrt(1 - correlation**2) * rng.standard_normal()
        off = correlation * off + new
        watch.add(going, going, 0.01, empty, (off, off))


@pytest.mark.parametrize(("sigma", "knock"), [(0.05e-3, 0.5e-3), (0.15e-3, 1.5e-3)])
def test_readings_that_are_off_alike_stop_nothing_and_hide_no_knock(
    sigma: float, knock: float
) -> None:
    """By one bead's toe the joint is read aside over some centimetres, by as much as is stated."""
    watch, rng = ContradictionWatch(TrackGeometry()), np.random.default_rng(3)
    going, off, empty = Twist(8e-3, 0.0), 0.0, Profile(np.empty(0), np.empty(0))
    for length in np.geomspace(1e-3, 0.1, 50):
        kept = np.exp(-80e-6 / length)
        for k in range(10_000):
            alike = k > 7_500  # before that its edges show
            off = kept * off * alike + sigma * sqrt(1 - kept**2 * alike) * rng.standard_normal()
            surprise = off if alike else 10e-6 * float(rng.standard_normal())
            watch.add(going, going, 0.01, empty, (surprise, off), sigma=alike * sigma)
    with suppress(CrawlStopped):
        for _ in range(200):
            watch.add(going, going, 0.01, empty, (knock, knock), sigma=sigma)
        pytest.fail("the knock was not noticed")


def test_drives_that_lag_more_than_assumed_stop_nothing() -> None:
    watch, shown, empty = (
        ContradictionWatch(TrackGeometry()),
        0.0,
        Profile(np.empty(0), np.empty(0)),
    )
    for k in range(4000):
        asked = Twist(-0.04 if (k // 400) % 2 else 0.04, 2e-3)
        shown += 0.01 / 0.3 * (asked.speed - shown)
        watch.add(asked, Twist(shown, 2e-3), 0.01, empty, (0.0, 0.0))


def test_profiles_without_points_contradict_nothing() -> None:
    watch, going = ContradictionWatch(TrackGeometry()), Twist(8e-3, 0.0)
    empty = Profile(np.full(290, np.nan), np.full(290, np.nan))
    for _ in range(300):
        watch.add(going, going, 0.01, empty, None)


def test_what_a_busy_host_commanded_late_contradicts_nothing() -> None:
    watch, still = ContradictionWatch(TrackGeometry()), Profile(np.zeros(2), np.full(2, np.nan))
    ahead, turning = Twist(20e-3, 0.0), Twist(20e-3, 0.1)
    for _ in range(50):
        watch.add(ahead, ahead, 0.02, still, (0.0, 0.0))
    watch.add(turning, ahead, 0.4, still, (0.3e-3, 0.3e-3))
    for _ in range(50):
        watch.add(turning, turning, 0.02, still, (0.0, 0.0))
    with pytest.raises(CrawlStopped):
        watch.add(turning, ahead, 0.09, still, (0.0, 0.0))


def test_a_host_too_slow_to_judge_any_cycle_stops_the_crawl() -> None:
    watch, still = ContradictionWatch(TrackGeometry()), Profile(np.zeros(2), np.full(2, np.nan))
    ahead = Twist(20e-3, 0.0)
    watch.add(ahead, ahead, 2.0, still, (0.0, 0.0))
    watch.add(ahead, ahead, 0.05, still, (0.0, 0.0))
    for _ in range(20):
        watch.add(ahead, ahead, 0.12, still, (0.0, 0.0))
    with pytest.raises(CrawlStopped, match="too long to see"):
        watch.add(ahead, ahead, 0.12, still, (0.0, 0.0))
