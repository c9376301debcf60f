"""What a crawl's sensors report, held against one another: wheels, joint, and pictures.

A filter weighs down what it does not expect. Here everything must fit: each wheel its own command,
each reading what the estimate expects, each picture the ones before, gyro and inclinometer both.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import exp, inf
from typing import Final

import numpy as np

from tjscan.core.errors import CrawlStopped
from tjscan.core.frames import Array
from tjscan.crawler.slip_aware import CREEPING_SPEED, DRIVE_LAG
from tjscan.crawler.slip_estimator import INERTIAL_MEAN_TIME, MOST_SIDEWAYS_SHARE
from tjscan.laser.profile import Profile
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import AT_REST, Twist, VehicleState

WHEEL_MEMORY_LENGTH, WHEEL_MEMORY_TIME = 0.030, 10.0
"""Metres and seconds over which a wheel is held against its command."""

MOST_WHEEL_ERROR: Final = 1e-3
"""Metres by which a wheel may be farther behind its command than the other one within that memory:
what a wheel comes to that is 3 % off. Drives that lag more than assumed set both behind alike."""

SUSPECT_WHEEL_ERROR: Final = 0.3e-3
"""Metres by which one is behind that is suspected first if the joint shows another turn."""

STANDING_SHARE: Final = 0.2
"""Share of its command below which a wheel counts as one that shows no motion."""

LONGEST_JUDGED_PERIOD: Final = 0.1
"""Seconds from one cycle to the next, up to which a command says how tracks ran meanwhile: a busy
host commands late, and what that led to contradicts nothing (assumption: twice `DRIVE_LAG`)."""

LARGEST_UNJUDGED_WAY: Final = 50e-3
"""Metres on end over which cycles may be too long to be judged: one of two seconds at 25 mm/s."""

SUDDEN_LENGTH, LASTING_LENGTH = 2e-3, 30e-3
"""Metres over which readings are averaged that may contradict the estimate: a jump shows within the
first, a wrong turn within the second, over which the ripple of a chain of that pitch is nothing."""

LEAST_SCATTERS: Final = (20e-6, 5e-6)
"""Metres: standard deviations of those means at the least. Edges that are cut and references of the
joint are off by the one for some millimetres; a track whose slip changes, by the other. In sound
crawls the longer means come to a third of their limit; a kink that is taken for slip, to twice."""

SCATTER_MEMORY_LENGTH: Final = 0.3
"""Metres over which the true scatter of those means is learned: it counts if it is larger."""

SCATTER_LIMIT: Final = 6.0
"""Standard deviations: one in 10⁹ of normal means; some 10⁵ means are seen in an hour."""

BEND_LIMIT: Final = 3.0
"""Least deviations of the longer mean from which the joint may be taken for one that bends, if its
course says so, too. What is followed in vain costs an alignment, what is not is taken for slip."""

LARGEST_SURPRISE: Final = 1e-3
"""Metres: a reading farther off counts as no more, so that a single wrong one is no jump."""

LEAST_WAY_PER_READING: Final = 20e-6
"""Metres: readings at rest count as if it went on by so much."""

PICTURE_SPACING, PICTURE_LAG, PICTURES_KEPT = 0.2e-3, 2e-3, 12
"""Metres between pictures that are kept, metres after which a picture has to be another one
(texture of steel and beads is shorter), and how many are kept."""

MOST_LIKENESS: Final = 0.5
"""Correlation of the noise and texture of two pictures of different places: 0 but for its scatter
of 0.1, and 1 if the picture is the same."""

LARGEST_PICTURE_STEP, OUTER_SHARE = 0.4e-3, 8
"""Metres by which both plates may be higher or lower than in the last picture, and the share of it
at each of its ends, one eighth, that shows a plate: a bead that begins changes only what is between
them."""

PICTURES_IN_DOUBT: Final = 3
"""Pictures in a row that must differ from the last sound one: one alone may be a flash."""

FEWEST_POINTS: Final = 50
"""Points of a picture that can be compared."""

MOST_FINE_STRUCTURE: Final = 4.0
"""Times its median: what is larger is an edge or an outlier, not noise and texture."""

SHIFTS_TRIED: Final = np.linspace(-20e-3, 20e-3, 81)
"""Metres by which a picture may have moved in which the joint is not found any more."""

LARGEST_UNSEEN_SHIFT, LENGTH_IN_DOUBT = 1e-3, 8e-3
"""Metres by which such a picture may have moved at most, before it counts as a knock; and metres
along the joint between two that are compared: farther on a bead has another shape."""

MOST_COUNTED_HEIGHT, LEAST_GAIN_BY_SHIFT = 2e-3, 0.1e-3
"""Metres: heights between pictures count as no more, for light of the arc; and by how much their
mean must be less for a shift to be seen."""

TURNING_GUARDS: Final = ("encoder", "slip")
"""Guards that blame the tracks for what may be a bend of the joint."""

READINGS_KEPT: Final = 100
"""Readings of a vehicle that moves which show whether they jumped, or the joint bends: 40 mm."""

BEND_EVIDENCE: Final = 100.0
"""How many times likelier a course has to be than others: readings that jumped and were followed as
a bend would hide a knock."""

FEWEST_OF_COURSE: Final = 4
"""Readings that tell a course from a jump: fewer are taken for one."""


LEAST_INERTIAL_SCATTER, FIRST_INERTIAL_SCATTER, INERTIAL_SCATTER_TIME = 0.83, 1.5, 30.0
"""By how much misfits averaged over `INERTIAL_MEAN_TIME` scatter, at the least and until it is
known, and the seconds in which it is learned: 0.7 if the noise is white, more if it wanders."""

MOST_SAMPLE_MISFIT: Final = 60.0
"""Of these a sample counts as no more: a push is no bias. It is 8.5 of its own at 50 Hz."""

DEAD_GYRO_TIME: Final = 0.5
"""Seconds for which a gyro may repeat one value, in which its noise is, while the tracks turn."""

NOISY_GYRO_SHARE, NOISY_GYRO_TIME = 0.9, 10.0
"""Share of samples, and the seconds over which it is taken, in which a gyro's noise has to have
shown: a coarse one that is smoothed repeats itself though it is well."""


BENDING_MISFIT: Final = 2.5
"""Deviations of a mean of the gyro, up to which it turns as the tracks do: three and a half times
what white noise scatters by. Tracks that are wrong by 5 % come to it in half a second."""


@dataclass(slots=True)
class WheelWatch:
    """Holds the way of each track, as its encoder shows it, against what it was asked for.

    Parameters
    ----------
    tracks : TrackGeometry
    """

    tracks: TrackGeometry
    _expected: Array = field(default_factory=lambda: np.zeros(2))
    _behind: Array = field(default_factory=lambda: np.zeros(2))
    _last: tuple[Array, Array] = field(default_factory=lambda: (np.zeros(2), np.zeros(2)))

    def add(self, commanded: Twist, shown: Twist, period: float) -> None:
        """Take in a period in seconds.

        Raises
        ------
        CrawlStopped
            If a wheel does not do what it was asked for.
        """
        asked, seen = (self.tracks.track_speeds(twist) for twist in (commanded, shown))
        self._expected += min(period / DRIVE_LAG, 1.0) * (asked - self._expected)
        way = float(np.abs(self._expected).mean()) * period
        kept = exp(-way / WHEEL_MEMORY_LENGTH - period / WHEEL_MEMORY_TIME)
        self._behind = kept * self._behind + (self._expected - seen) * period
        self._last = asked, seen
        both_at_rest = np.all(np.abs(seen) < STANDING_SHARE * np.abs(asked))
        if self.difference > MOST_WHEEL_ERROR and not both_at_rest:
            raise self.error()

    @property
    def difference(self) -> float:
        """How much farther one wheel is off than the other, metres."""
        return float(abs(self._behind[0] - self._behind[1]))

    def error(self) -> CrawlStopped:
        """The error that names the wheel that is farther off."""
        which = int(np.abs(self._behind).argmax())
        side, wanted, speed = ("left", "right")[which], *(one[which] for one in self._last)
        at_rest = abs(speed) < STANDING_SHARE * abs(wanted)
        return CrawlStopped(
            "encoder",
            f"the {side} track {'does not move' if at_rest else 'runs wrongly'}, or its encoder is "
            f"{'dead' if at_rest else 'stuck or wrong'}: it shows {1e3 * speed:.1f} mm/s, and was "
            f"asked for {1e3 * wanted:.1f}. Look at the encoder's cable, the motor and the brake "
            "of that track",
        )


@dataclass(slots=True)
class ScatterWatch:
    """Averages what data are off by, and learns how far these means scatter.

    Parameters
    ----------
    memories, least : tuple of float
        Over which way or time each mean is taken, and how far it scatters at the least.
    scatter_memory : float
        Way or time over which its true scatter is learned: it counts if it is larger.
    largest : float
        What is farther off counts as no more.
    scatter : float, optional
        What is taken for their scatter at first.
    """

    memories: tuple[float, ...]
    least: tuple[float, ...]
    scatter_memory: float
    largest: float
    scatter: float | Array = 0.0
    means: Array = field(default_factory=lambda: np.zeros(2))

    def add(self, off: Sequence[float] | Array, step: float) -> list[bool]:
        """Take in what is off, after a step in the unit of the memories.

        Returns
        -------
        list of bool
            Whether each mean is no chance any more.
        """
        bounded = np.clip(off, -self.largest, self.largest)
        self.means += (1 - np.exp(-step / np.array(self.memories))) * (bounded - self.means)
        limits = SCATTER_LIMIT * np.maximum(self.scatter, self.least)
        learned = np.minimum(np.abs(self.means), limits / 2) ** 2 - self.scatter**2
        self.scatter = np.sqrt(self.scatter**2 + min(step / self.scatter_memory, 1.0) * learned)
        return list((np.abs(self.means) > limits).tolist())


@dataclass(slots=True)
class InertialWatch:
    """Holds gyro and inclinometer against what tracks and joint show of each turn."""

    _misfits: ScatterWatch = field(
        default_factory=lambda: ScatterWatch(
            (INERTIAL_MEAN_TIME,) * 2,
            (LEAST_INERTIAL_SCATTER,) * 2,
            INERTIAL_SCATTER_TIME,
            MOST_SAMPLE_MISFIT,
            FIRST_INERTIAL_SCATTER,
        )
    )
    _last: tuple[tuple[float, ...], float] = ((), 0.0)
    _repeated: float = 0.0
    _noisy_share: float = 0.0

    @property
    def turn_misfit(self) -> float:
        """Deviations of a mean by which the gyro turns otherwise than tracks; inf without one."""
        return abs(float(self._misfits.means[0])) if self._last[0] else inf

    def add(self, state: VehicleState, misfits: tuple[float, float], period: float) -> None:
        """Take in a state, its misfits as of `FollowingMethod.move`, and a period in seconds.

        Raises
        ------
        CrawlStopped
            If a sensor repeats itself, or shows what nothing else does.
        """
        (gyro, turn), self._last = self._last, (state.gyro, state.odometry.turn_rate)
        changed = state.gyro != gyro
        if gyro and state.odometry.turn_rate != turn:
            self._repeated = 0.0 if changed else self._repeated + period
            self._noisy_share += min(period / NOISY_GYRO_TIME, 1.0) * (changed - self._noisy_share)
        if self._repeated > DEAD_GYRO_TIME and self._noisy_share > NOISY_GYRO_SHARE:
            raise CrawlStopped(
                "gyro",
                f"the gyro is dead: it shows {1e3 * gyro[0]:.3f} mrad/s again and again, though "
                "the vehicle moves. Look at its cable and supply",
            )
        contradicts = self._misfits.add(misfits, period)
        for k, name in enumerate(("gyro", "inclinometer")):
            if contradicts[k]:
                mean = float(self._misfits.means[k])
                raise CrawlStopped(
                    name,
                    f"the {name} contradicts tracks and joint: by {abs(mean):.0f} standard "
                    f"deviations it shows more turn to the "
                    f"{'right' if (mean > 0) == (name == 'gyro') else 'left'}. Check that it is "
                    "not biased, frozen, mounted the other way round, or noisier than "
                    f"{'slip.gyro_mrad_s' if name == 'gyro' else 'slip.down_mrad'} states",
                )


class PictureWatch:
    """Holds each picture of the laser against those before."""

    def __init__(self) -> None:
        self._way, self._likeness, self._doubts = 0.0, 0.0, 0
        self._kept: deque[tuple[float, Profile, Array]] = deque(maxlen=PICTURES_KEPT)
        self._last: Profile | None = None

    def add(self, profile: Profile, way: float) -> None:
        """Take in a picture, after some metres of way.

        Raises
        ------
        CrawlStopped
            If it is the same again though the vehicle went on, or all of it has jumped.
        """
        if np.count_nonzero(profile.valid) >= FEWEST_POINTS:
            self._way += way
            self._check_likeness(profile, way)
            self._check_step(profile)

    def went_along(self, shift: float, profile: Profile) -> bool:
        """Whether a picture as a whole moved to the right by metres, and not the joint in it."""
        before = self._kept[0][1]
        apart = [_mean_height_between(profile, before, by) for by in (0.0, shift)]
        return apart[1] < apart[0]

    def _check_likeness(self, profile: Profile, way: float) -> None:
        now, kept = _fine_structure(profile), self._kept
        if kept and len(kept[-1][2]) != len(now):
            kept.clear()
        while len(kept) > 1 and kept[1][0] <= self._way - PICTURE_LAG:
            kept.popleft()
        if kept and kept[0][0] <= self._way - PICTURE_LAG:
            new = 1 - exp(-way / PICTURE_LAG)
            self._likeness += new * (float(now @ kept[0][2]) - self._likeness)
        if not kept or self._way - kept[-1][0] >= PICTURE_SPACING:
            kept.append((self._way, profile, now))
        if self._likeness > MOST_LIKENESS:
            raise CrawlStopped(
                "laser frozen",
                "the laser is frozen: it shows one picture again and again, noise and all, though "
                "the vehicle moves. Restart the sensor",
            )

    def _check_step(self, profile: Profile) -> None:
        last = self._last or profile
        step = _step_of_plates(profile, last)
        self._doubts = self._doubts + 1 if step > LARGEST_PICTURE_STEP else 0
        if not self._doubts:
            self._last = profile
        if self._doubts < PICTURES_IN_DOUBT:
            return
        mirrored = _step_of_plates(profile, Profile(-last.x_s, last.z_s)) < step / 2
        raise CrawlStopped(
            "laser mirrored" if mirrored else "picture jumped",
            f"the laser's picture {'is mirrored' if mirrored else 'jumped'} from one profile to "
            f"the next: both plates are {1e3 * step:.1f} mm higher or lower. "
            + ("Look at the sensor's settings" if mirrored else "Look what moved vehicle or laser"),
        )


def _fine_structure(profile: Profile) -> Array:
    """Noise and texture of a picture, shape (n - 3,), of length one: no outline, no outliers."""
    third = np.diff(profile.z_s, 3)
    known = np.abs(third[np.isfinite(third)])
    most = MOST_FINE_STRUCTURE * float(np.median(known)) if len(known) else 0.0
    third[~(np.abs(third) < most)] = 0.0
    return np.asarray(third / max(float(np.linalg.norm(third)), 1e-12))


def _heights_between(now: Profile, before: Profile, shift: float = 0.0) -> Array:
    """Heights between two pictures, the one before moved to the right by a shift; metres."""
    one, other = now.valid, before.valid
    order = np.argsort(before.x_s[other], kind="stable")
    x, z = before.x_s[other][order] + shift, before.z_s[other][order]
    return np.asarray(np.abs(now.z_s[one] - np.interp(now.x_s[one], x, z)))


def _step_of_plates(now: Profile, before: Profile) -> float:
    """Height between two pictures at their outer ends, the smaller of both; metres."""
    heights = _heights_between(now, before)
    end = len(heights) // OUTER_SHARE
    return float(min(np.median(heights[:end]), np.median(heights[-end:])))


def _mean_height_between(now: Profile, before: Profile, shift: float) -> float:
    return float(np.minimum(_heights_between(now, before, shift), MOST_COUNTED_HEIGHT).mean())


def _shift_between(now: Profile, before: Profile) -> float:
    """Metres to the right by which a picture moved as a whole since another; 0 if it did not."""
    apart = [_mean_height_between(now, before, by) for by in SHIFTS_TRIED]
    best, still = int(np.argmin(apart)), apart[len(apart) // 2]
    return float(SHIFTS_TRIED[best]) if still - apart[best] > LEAST_GAIN_BY_SHIFT else 0.0


@dataclass(frozen=True, slots=True)
class Course:
    """How readings went aside lately.

    Parameters
    ----------
    bends, jumped : bool
        Whether they lead another way from one place on, or jumped at one.
    steepness : float
        How far they lead aside for each metre of way.
    """

    bends: bool = False
    jumped: bool = False
    steepness: float = 0.0


class ContradictionWatch:
    """Stops a crawl whose data do not fit one another.

    Parameters
    ----------
    tracks : TrackGeometry
    """

    def __init__(self, tracks: TrackGeometry) -> None:
        self._tracks = tracks
        self.begin_again()

    def begin_again(self) -> None:
        """Forget what was: the vehicle is driven by hand, or rests there."""
        self._forget_ways(AT_REST)
        self._pictures, self.inertial = PictureWatch(), InertialWatch()
        self._aside: deque[tuple[float, float]] = deque(maxlen=READINGS_KEPT)
        self._way = self._last_speed = 0.0
        self._seen: Profile | None = None
        self._unseen, self._unseen_way = 0, 0.0
        self._doubt: CrawlStopped | None = None
        self._doubted_time = self._unjudged_way = 0.0

    def _forget_ways(self, commanded: Twist) -> None:
        """Forget how far wheels are behind, and readings off the estimate."""
        self._wheels = WheelWatch(self._tracks, self._tracks.track_speeds(commanded))
        self._readings = ScatterWatch(
            (SUDDEN_LENGTH, LASTING_LENGTH), LEAST_SCATTERS, SCATTER_MEMORY_LENGTH, LARGEST_SURPRISE
        )

    def add(
        self,
        commanded: Twist,
        shown: Twist,
        period: float,
        profile: Profile,
        misfit: tuple[float, float] | None,
        *,
        sigma: float = 0.0,
        filled: bool = False,
        follow_bend: Callable[[], bool] | None = None,
    ) -> None:
        """Take in a cycle.

        Parameters
        ----------
        commanded, shown : Twist
            What the tracks were asked for, and what their encoders show.
        period : float
            Seconds.
        profile : Profile
        misfit : tuple of float or None
            How far the reading is off, and how far readings went aside, as of
            `FollowingMethod.read`; None if there is none.
        sigma : float, optional
            Standard deviation of a reading that is off as those before it are, metres: no mean over
            some way is surer. By a bead's toe a joint is read to 0.05 to 0.15 mm.
        filled : bool, optional
            Whether the picture shows even steel: it can't show whether it moved.
        follow_bend : callable, optional
            Takes the joint for one that bends here, and returns whether it does; not asked if
            readings jumped, or a gyro shows that the tracks turn otherwise. None where it can't.

        Raises
        ------
        CrawlStopped
            If something does not fit; its cause is named.
        """
        way = abs(shown.speed) * period
        self._pictures.add(profile, way)
        self._settle_doubt(period)
        self._unseen_way += way
        late = period > LONGEST_JUDGED_PERIOD
        self._unjudged_way = self._unjudged_way + way if late else 0.0
        if self._unjudged_way > LARGEST_UNJUDGED_WAY:
            raise CrawlStopped(
                "clock",
                f"for {1e3 * self._unjudged_way:.0f} mm the vehicle's states came {period:.2f} s "
                "apart, too long to see what contradicts them: end what else this computer runs",
            )
        if late:
            self._forget_ways(commanded)
            return
        self._wheels.add(commanded, shown, period)
        if misfit is None:
            if not filled:
                self._check_unread(profile)
            return
        self._way += way
        off, aside = misfit
        if shown.speed * self._last_speed < 0:  # what the estimate is wrong by turns its sign
            self._aside.clear()
        self._last_speed = shown.speed or self._last_speed
        if way > CREEPING_SPEED * period:  # nothing bends at rest: what goes aside there is a jump
            self._aside.append((self._way, aside))
        least = np.array(LEAST_SCATTERS)
        counted = off * least / np.hypot(least, sigma)
        contradicts = any(self._readings.add(counted, max(way, LEAST_WAY_PER_READING)))
        self._seen, self._unseen, self._unseen_way = profile, 0, 0.0
        leads_aside = abs(self._readings.means[1]) > BEND_LIMIT * LEAST_SCATTERS[1]
        if self._doubt is not None or not (
            contradicts or (leads_aside and follow_bend is not None)
        ):
            return
        course = self._course()
        gyro_denies = BENDING_MISFIT < self.inertial.turn_misfit < inf
        may_bend = course.bends or (contradicts and not course.jumped)
        may_bend &= course.steepness < MOST_SIDEWAYS_SHARE and not gyro_denies
        if follow_bend is not None and may_bend and follow_bend():
            self._forget_ways(commanded)
            self._aside.clear()
        elif contradicts:
            self._doubt = self._contradiction(off, shown.speed, profile, jumped=course.jumped)
            self._settle_doubt(0.0)

    def _course(self) -> Course:
        """How readings go aside: straight on, or from some place on otherwise, or by a jump.

        The last two count if they are `BEND_EVIDENCE` times likelier than both others.
        """
        if len(self._aside) < FEWEST_OF_COURSE:
            return Course(jumped=True)
        way, off = np.transpose(self._aside)
        straight = np.linalg.qr(np.stack((np.ones_like(way), way - way[0]), axis=1))[0]
        beyond, left = way[:, None] - way[1:-1], off - straight @ (straight.T @ off)
        plain, likeliest = left @ left, []
        for course in (beyond > 0, np.maximum(beyond, 0)):
            shape = course - straight @ (straight.T @ course)
            fitted, norm = left @ shape, (shape**2).sum(axis=0)
            best = int(np.argmax(fitted**2 / norm))
            likeliest.append((plain - fitted[best] ** 2 / norm[best], fitted[best] / norm[best]))
        (jump, _), (bend, steepness) = likeliest
        less = BEND_EVIDENCE ** (-2 / len(off))
        if bend < less * min(plain, jump):
            return Course(bends=True, steepness=abs(float(steepness)))
        trend = float(np.polyfit(way, off, 1)[0])
        return Course(jumped=bool(jump < less * plain), steepness=abs(trend))

    def _settle_doubt(self, period: float) -> None:
        """Blame the tracks if the gyro turns otherwise; if it turns as they do, the joint bends."""
        self._doubted_time += period if self._doubt else 0.0
        if self._doubt and (
            self._doubt.guard not in TURNING_GUARDS or self.inertial.turn_misfit > BENDING_MISFIT
        ):
            raise self._doubt
        if self._doubted_time > INERTIAL_MEAN_TIME:
            raise CrawlStopped(
                "joint bends",
                "the joint goes aside in the laser's line, and gyro and tracks turn alike: the "
                "joint bends, or the vehicle slides aside, or the laser is late. Look at steel and "
                "laser, and make alignment.length_mm longer: it then sees a bend before the weld",
            )

    def _check_unread(self, profile: Profile) -> None:
        """Look whether a picture in which the joint is not found has moved as a whole."""
        self._unseen += 1
        full = np.count_nonzero(profile.valid) >= FEWEST_POINTS
        if self._seen is None or not full or self._unseen % PICTURES_IN_DOUBT:
            return
        shift = _shift_between(profile, self._seen)
        if abs(shift) > LARGEST_UNSEEN_SHIFT + MOST_SIDEWAYS_SHARE * self._unseen_way:
            raise _knock_error(-shift)
        if self._unseen_way > LENGTH_IN_DOUBT:
            self._seen, self._unseen_way = profile, 0.0

    def _contradiction(
        self, off: float, speed: float, profile: Profile, *, jumped: bool
    ) -> CrawlStopped:
        """The error that names why readings are off, by metres now."""
        if self._wheels.difference > SUSPECT_WHEEL_ERROR:
            return self._wheels.error()
        if jumped:
            if not profile.valid.any() or self._pictures.went_along(-off, profile):
                return _knock_error(off)
            return CrawlStopped(
                "joint jumped",
                f"the joint jumped by {1e3 * abs(off):.1f} mm in the laser's picture, and the "
                "picture did not: another joint is read, or an edge that is none. Look whether "
                "the laser sees this joint alone",
            )
        right, forward = off > 0, speed >= 0
        slipping, other = ("right", "left") if right == forward else ("left", "right")
        return CrawlStopped(
            "slip",
            f"the vehicle turns farther to the {'right' if right else 'left'} than its tracks "
            f"show, {1e3 * abs(off):.2f} mm at the laser: the {slipping} track slips, or the "
            f"encoder of the {other} one is wrong, the joint bends, or the laser is late. Look at "
            "pads, steel, encoders, joint and laser",
        )


def _knock_error(off: float) -> CrawlStopped:
    return CrawlStopped(
        "knocked aside",
        f"the joint jumped aside in the laser's line, and the whole picture with it: the vehicle "
        f"was knocked {1e3 * abs(off):.1f} mm to the {'right' if off > 0 else 'left'}, or its "
        "laser was, or another joint is read that looks alike. Look what touched it, that the "
        "laser is fixed, and that it sees this joint alone",
    )
