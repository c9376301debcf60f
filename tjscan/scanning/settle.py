"""Settling: how far the sensor is from where it would rest, from profiles of the still groove.

The steel stands, so what moves in a burst of profiles is the sensor: it sways with what carries the
arm. Points beside their places in the burst's first profiles show that motion in the plane of the
laser: two translations and a turn. A motion along the groove shows nothing, and moves no corner off
its edge; turns about the other two axes show nothing either, and move corners little.

The place of rest is the middle of a sway that is fitted to the motion. A burst lasts until that is
known well enough, which it is after a period or two, long before the sway itself has ended.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core import pose_vector, units
from tjscan.core.errors import ConfigurationError, LaserFault
from tjscan.core.frames import Array, array_dataclass, inverse_pose, pose, unit_vectors
from tjscan.laser.line_laser import LineLaser, StreamingLaser
from tjscan.laser.profile import Profile, ProfileRepeats

SWAY_FREQUENCIES: Final = np.geomspace(1.5, 12.0, 32)
"""Hertz that are looked for, 7 % apart: a sway between two of them, or one that decays, is one of
these whose amplitude changes with time, which is fitted."""

LEAST_PERIODS: Final = 1.3
"""Of a sway, that a burst has to show: in less, several look like one."""

EARLIER_SHARE: Final = 0.6
"""Share of a burst after which its place of rest has to have been the same within the tolerance."""

LEAST_SEEN_SHARE: Final = 0.25
"""Share of the amplitude of the slowest sway that the first burst shows at least, whatever its
phase: of a quarter of a second, its standard deviation times the root of two."""

PROFILES_BETWEEN_FITS: Final = 5

STRAIGHT_COLUMNS: Final = 5
"""Columns to either side over which a side's direction is taken."""

LARGEST_BEND: Final = 0.15e-3
"""Metres by which a point may be beside the middle of its neighbours: else no side is there."""

FEWEST_COLUMNS: Final = 60
"""That show a motion: fewer see no groove."""

LARGEST_MOTION: Final = 1e-3
"""Metres: an expectation that holds a motion that nothing shows near zero."""

MOTION_FIT_ROUNDS: Final = 5
"""Weighted fits, after which the weights of false points do not change any more."""

MOST_SILENT: Final = 50
"""Times in a row that a stream may bring no new profile: it waits a little each time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SettleSettings(units.SettingsTable):
    """The table [scan.settle]: how well the place of rest has to be known under a sway.

    Parameters
    ----------
    tolerance : float
        Standard deviation of the place of rest, metres.
    longest : float
        Seconds after which a burst ends however well it is known: that counts then.
    profiles : int
        Fewest of a burst.
    period : float
        Seconds between them.
    """

    tolerance: Annotated[float, Gt(0), Le(5), units.MM] = 0.03e-3
    longest: Annotated[float, Ge(0.5), Le(120), units.SECONDS] = 20.0
    profiles: Annotated[int, Ge(10), Le(500)] = 25
    period: Annotated[float, Ge(1), Le(25), units.MILLISECONDS] = 0.01


@array_dataclass
class SwayFit:
    """A sway as a burst shows it.

    Parameters
    ----------
    rest : ndarray, shape (3,)
        Where the groove would be seen at rest: x_s, z_s, metres, and turn, radians.
    sigma : float
        Standard deviation of it, metres.
    amplitude : float
        Metres, in the middle of the burst.
    frequency : float
        Hertz.
    damping : float
        Share of the critical one, as the amplitude changes over the burst; rough in a short one.
    """

    rest: Array
    sigma: float
    amplitude: float
    frequency: float
    damping: float


@array_dataclass
class SettledProfile:
    """A profile, and how far the sensor was from its place of rest when it was taken.

    Parameters
    ----------
    profile : Profile
        The one of a burst that was taken nearest to it.
    T_rest_s : ndarray, shape (4, 4)
        The sensor then in the frame s of rest, metres.
    sigmas : ndarray, shape (2,), or None
        Standard deviations of that in the plane across the groove and along the groove, metres,
        each in any one direction; None if none was measured.
    detail : str
        What was measured, in words; empty if that is nothing to report.
    """

    profile: Profile
    T_rest_s: Array
    sigmas: Array | None = None
    detail: str = ""


def check_can_settle(laser: LineLaser) -> StreamingLaser:
    """The laser, if it takes bursts.

    Raises
    ------
    ConfigurationError
        If its driver takes profiles one by one.
    """
    if not isinstance(laser, StreamingLaser):
        raise ConfigurationError(
            "this laser's driver takes profiles one by one, and no burst of them: leave the table "
            "out",
            key="scan.settle",
        )
    return laser


class SettlingLaser:
    """Takes profiles in bursts, each long enough to know where the sensor would rest.

    Parameters
    ----------
    laser : LineLaser
        Takes the profiles.
    settings : SettleSettings
        How well that has to be known.
    check : callable, optional
        Is called before each profile; raises what shall end a burst.

    Raises
    ------
    ConfigurationError
        If the laser takes no bursts.
    LaserFault
        If their times can't be true.
    """

    def __init__(
        self,
        laser: LineLaser,
        settings: SettleSettings,
        check: Callable[[], object] = lambda: None,
    ) -> None:
        self._laser, self._settings, self._check = check_can_settle(laser), settings, check
        self._laser.check_stream(settings.period)
        self._repeats = ProfileRepeats()

    def capture(self) -> SettledProfile:
        """Take a burst, now, with the arm at rest.

        Raises
        ------
        LaserFault
            If no profiles come.
        """
        settings, profiles = self._settings, list[Profile]()
        motions, fits = list[Array](), dict[int, SwayFit]()
        for profile in self._new_profiles():
            profiles.append(profile)
            late, count = profile.time - profiles[0].time, len(profiles)
            if count < settings.profiles or count % PROFILES_BETWEEN_FITS:
                continue
            if not motions:
                still = StillGroove(profiles)
                if still.columns < FEWEST_COLUMNS:
                    why = f"not measured: {still.columns} columns show a motion"
                    return SettledProfile(replace(profile, time=0.0), np.eye(4), None, why)
            motions += [still.motion(one) for one in profiles[len(motions) :]]
            moved, times = np.array(motions), np.array([one.time for one in profiles])
            fit = fits[count] = fit_sway(times, moved)
            if late >= settings.longest or self._is_settled(moved, late, fits):
                break
        away = moved - fit.rest
        nearest = int(np.argmin(np.linalg.norm(away[:, :2], axis=1)))
        # Along the groove it may sway as much as each way across.
        unseen = float(np.sqrt(np.mean(away[:, :2] ** 2)))
        detail = ""
        if max(fit.amplitude, fit.sigma) > settings.tolerance:
            detail = (
                f"{1e3 * fit.amplitude:.2f} mm at {fit.frequency:.1f} Hz, damping about "
                f"{fit.damping:.0%}; the place of rest known to {1e3 * fit.sigma:.3f} mm after "
                f"{late:.2f} s"
            )
        T_rest_s = inverse_pose(still.pose_of_motion(away[nearest]))
        # A stream's stamps are of the laser's own clock.
        profile = replace(profiles[nearest], time=0.0)
        return SettledProfile(profile, T_rest_s, np.array((fit.sigma, unseen)), detail)

    def _new_profiles(self) -> Iterator[Profile]:
        """Profiles of the laser that did not come before; LaserFault if none comes any more."""
        silent = 0
        for streamed in self._laser.stream(self._settings.period):
            self._check()
            if streamed is not None and not self._repeats.is_repeat(streamed.profile):
                silent = 0
                yield streamed.profile
            elif (silent := silent + 1) > MOST_SILENT:
                raise LaserFault("the laser's stream brings no new profile")

    def _is_settled(self, motions: Array, seconds: float, fits: Mapping[int, SwayFit]) -> bool:
        """Whether a burst has shown where the place of rest is; its fits by their profiles."""
        tolerance, now = self._settings.tolerance, fits[len(motions)]
        spread = float(np.sqrt(2 * motions[:, :2].var(axis=0).max()))
        if spread < LEAST_SEEN_SHARE * tolerance:
            return True
        before = [fit for count, fit in fits.items() if count <= EARLIER_SHARE * len(motions)]
        if not before or seconds * now.frequency < LEAST_PERIODS:
            return False
        changed = float(np.abs(now.rest - before[-1].rest)[:2].max())
        return bool(np.hypot(now.sigma, changed) < tolerance)


class StillGroove:
    """The groove as a burst's first profiles show it, and how far it is beside that in others.

    Parameters
    ----------
    profiles : sequence of Profile
        Of one sensor.

    Attributes
    ----------
    columns : int
        How many columns show a motion.
    """

    def __init__(self, profiles: Sequence[Profile]) -> None:
        seen = np.array([_points_by_column(profile) for profile in profiles])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # columns without a point
            places = np.nanmedian(seen, axis=0)
        n = STRAIGHT_COLUMNS
        before, after = (np.roll(places, k, axis=0) for k in (n, -n))
        bend = np.linalg.norm(places - (before + after) / 2, axis=1)
        whole = np.isfinite(seen[..., 0]).mean(axis=0) > 0.5
        kept = whole & (bend < LARGEST_BEND)  # not a number is not
        kept[:n] = kept[-n:] = False
        self._kept, self._places = np.flatnonzero(kept), places[kept]
        self.columns = len(self._kept)
        if self.columns:
            along = unit_vectors((after - before)[kept])
            self._normals = np.column_stack((-along[:, 1], along[:, 0]))
            self._centre = self._places.mean(axis=0)
            x, z = (self._places - self._centre).T
            turned = self._normals[:, 0] * z - self._normals[:, 1] * x
            self._answers = np.column_stack((self._normals, turned))

    def motion(self, profile: Profile) -> Array:
        """Translation along x_s and z_s, metres, and turn about the middle, radians, shape (3,).

        A side that is straight answers to a motion across it alone. False points count little.
        """
        beside = (_points_by_column(profile)[self._kept] - self._places) * self._normals
        off, A = beside.sum(axis=1), self._answers
        seen = np.isfinite(off)
        off, A = off[seen], A[seen]
        size = np.abs(self._places - self._centre).max()
        expected = np.diag(np.array((1.0, 1.0, size)) / LARGEST_MOTION) ** 2
        weights, motion = np.ones(len(off)), np.zeros(3)
        for _ in range(MOTION_FIT_ROUNDS):
            left = np.abs(off - A @ motion)
            scale = max(1.4826 * float(np.median(left)), 1e-7)
            weights = 1 / (1 + (left / (2.5 * scale)) ** 2)
            weighted = weights[:, None] * A
            motion = np.linalg.solve(A.T @ weighted + scale**2 * expected, weighted.T @ off)
        return np.asarray(motion)

    def pose_of_motion(self, motion: Array) -> Array:
        """Pose after a motion of what is seen in s, shape (4, 4)."""
        centre = pose(p=(self._centre[0], 0.0, self._centre[1]))
        step = np.array((motion[0], 0.0, motion[1], 0.0, motion[2], 0.0))
        return np.asarray(centre @ pose_vector.pose_from_vector(step) @ inverse_pose(centre))


def _points_by_column(profile: Profile) -> Array:
    """x_s and z_s of each of the sensor's columns, shape (columns, 2); NaN where no point is."""
    points = np.full((profile.column_count, 2), np.nan)
    points[profile.columns] = profile.points
    return points


def fit_sway(times: Array, motions: Array) -> SwayFit:
    """Fit a sway about a place of rest to motions that were seen.

    One frequency after another is tried, with an amplitude that changes evenly; each counts by how
    well it fits, as if only each half period brought something new. The standard deviation counts
    with how much what it leaves is alike from one profile to the next.

    Parameters
    ----------
    times : ndarray, shape (k,)
        Seconds.
    motions : ndarray, shape (k, 3)
        As of `StillGroove.motion`.
    """
    k, middle = len(times), times.mean()
    half = (times[-1] - times[0]) / 2
    w = 2 * np.pi * SWAY_FREQUENCIES
    phase, late = w[:, None] * (times - middle), (times - middle) / half
    c, s = np.cos(phase), np.sin(phase)
    basis = np.stack((np.ones_like(c), c, s, late * c, late * s), axis=-1)
    # Little holds the amplitude as it is where nothing shows that it changes.
    square = np.swapaxes(basis, 1, 2) @ basis + 1e-3 * k * np.diag((0.0, 1e-3, 1e-3, 1.0, 1.0))
    inverse = np.linalg.inv(square)
    found = inverse @ (np.swapaxes(basis, 1, 2) @ motions)
    residuals = (motions - basis @ found)[..., :2]
    squares = np.sum(residuals**2, axis=(1, 2)) + 1e-16
    following = np.sum(residuals[:, 1:] * residuals[:, :-1], axis=(1, 2)) / squares
    alike = np.clip((1 + following) / np.maximum(1 - following, 0.01), 1.0, k / 3)
    left = squares / (2 * (k - 5))
    halves = min(4 * SWAY_FREQUENCIES[-1] * half, float(k))
    evidence = -halves * np.log(left)
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    rests = found[:, 0]
    rest = share @ rests
    variance = share @ (inverse[:, 0, 0] * left * alike) + (share @ (rests - rest) ** 2)[:2].max()
    best = int(share.argmax())
    a, b, da, db = found[best, 1:, :2]
    square_size = float(np.sum(a**2 + b**2))
    decay = -float(np.sum(a * da + b * db)) / max(half * square_size, 1e-30)
    amplitude, f = float(np.sqrt(square_size)), float(share @ SWAY_FREQUENCIES)
    if best == 0:  # it may be any slower one, whose middle is anywhere
        variance += square_size
    return SwayFit(rest, float(np.sqrt(variance)), amplitude, f, decay / (2 * np.pi * f))
