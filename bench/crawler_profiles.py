"""How well the centre of a hull's joint is read off a crawler's profiles.

Profiles are simulated over joints of 30 by 20 mm, of 290 points with a noise of 0.06 mm, from a
vehicle that sways, yaws, rolls and pitches; the truth is the middle between the plates' edges.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from math import sin
from statistics import median
from typing import Final

import numpy as np
from _stopwatch import Stopwatch
from _table import Row, main

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.crawler.joint_tracking.memory import RememberingTracker
from tjscan.crawler.joint_tracking.registration import JointPlacement, ReferenceProfile
from tjscan.crawler.joint_tracking.tracking import JointTracker
from tjscan.crawler.paper_joint import read_joint_as_paper
from tjscan.joint.hull import HullJoint, HullTack, WeldBead, hull_section
from tjscan.laser.profile import Profile
from tjscan.laser.section_laser import (
    SectionLaserModel,
    SectionLaserPose,
    section_in_sensor,
    simulate_section_profile,
)

PROFILES: Final = 1000
"""Of each row."""

STEP: Final = 0.2e-3
"""From one profile to the next along the joint, in metres: 20 mm/s at 100 Hz."""

STATION: Final = 25
"""Profiles for which one reference stands: 5 mm of the joint."""

WAY: Final = 250
"""Profiles of each way where it is remembered: 50 mm of the joint."""

WRONG: Final = 0.5e-3
"""An error that would be seen on the weld, in metres."""

FILLED: Final = (
    WeldBead(level=10e-3),
    WeldBead(level=15e-3, crown=0.8e-3, right=0.3),
    WeldBead(level=15e-3, crown=0.8e-3, left=0.1),
)
CAP: Final = (*FILLED, WeldBead(level=20e-3, crown=2e-3, left=-1.1, right=1.1))
TEN_PASSES: Final = tuple(
    WeldBead(level=1e-3 * level, crown=0.5e-3)
    for level in (3, 6, 9, 11, 13, 15, 16.5, 17.5, 18.5, 20)
)
"""Beads of a joint that is filled in ten passes; under the last one lies 18.5 mm of weld."""


@dataclass
class Tally:
    """What came of many readings, in metres.

    Parameters
    ----------
    errors, sigmas : list of float
        Of the centre, and as stated.
    total : int
        Profiles.
    """

    errors: list[float] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)
    total: int = 0

    @property
    def read(self) -> float:
        """Percentage of the profiles that were read."""
        return 100 * len(self.errors) / self.total

    def sd(self, name: str, limit_mm: float) -> Row:
        """Standard deviation of the centre."""
        return Row(f"{name}: joint centre, sd", 1e3 * float(np.std(self.errors)), limit_mm, "mm")

    def rows(self, name: str, least_read: float) -> list[Row]:
        """Share of profiles read, honesty of the stated error, wrong readings."""
        errors, sigmas = np.array(self.errors), np.array(self.sigmas)
        square = float(np.mean((errors / sigmas) ** 2))
        wrong = int(np.count_nonzero(np.abs(errors) > WRONG))
        return [
            Row(f"{name}: read of {self.total}", self.read, 100, "%", at_least=least_read),
            Row(f"{name}: squared error / stated variance", square, 1.5, at_least=0.7),
            Row(f"{name}: off by more than {1e3 * WRONG:g} mm", wrong, 0),
        ]

    def bias(self, name: str) -> Row:
        """Mean error over the stated one: no more than a profile's own error shows."""
        ratio = abs(float(np.mean(self.errors))) / float(np.mean(self.sigmas))
        return Row(f"{name}: mean error / stated error", ratio, 0.3)


def views(
    joint: HullJoint, passes: int, model: SectionLaserModel, seed: int, count: int = PROFILES
) -> Iterator[tuple[Profile, Array, SectionLaserPose]]:
    """Profiles along a joint, and where its centre truly is in each."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        pose = SectionLaserPose(
            offset=3e-3 * sin(k / 150),
            heading=15e-3 * sin(k / 210),
            stand_off=0.149 + 1e-3 * sin(k / 90),
            roll=10e-3 * sin(k / 130),
        )
        section = hull_section(joint, STEP * k, passes)
        profile = simulate_section_profile(section, pose, model, rng, time=0.01 * k)
        yield profile, section_in_sensor(np.zeros((1, 2)), pose)[0], pose


def track(
    joint: HullJoint, arc: float, *, passes: int = 0, seed: int = 1, reference: bool = False
) -> tuple[Tally, Stopwatch]:
    """Read a joint that was seen empty before."""
    tracker, tally, watch = JointTracker(), Tally(), Stopwatch()
    for profile, _, _ in views(joint, 0, SectionLaserModel(), seed + 1000, 30):
        tracker.read(profile)
    before = references(joint, passes, seed) if reference else {}
    gc.disable()
    for k, (profile, truth, _) in enumerate(views(joint, passes, SectionLaserModel(arc=arc), seed)):
        tally.total += 1
        reading = None
        with watch, suppress(GrooveNotFound):
            reading = tracker.read(profile, before.get(k // STATION))
        if reading is not None:
            tally.errors.append(reading.centre - float(truth[0]))
            tally.sigmas.append(reading.centre_sigma)
    gc.enable()
    return tally, watch


def references(joint: HullJoint, passes: int, seed: int) -> dict[int, ReferenceProfile]:
    """What each station looked like when the vehicle went back over it."""
    found = {}
    kept = list(views(joint, passes, SectionLaserModel(), seed + 2000))
    for station in range(0, PROFILES, STATION):
        some = kept[station : station + STATION : 2]
        placements = [
            JointPlacement(
                centre=float(truth[0]), hull_z=float(truth[1]), roll=pose.roll, centre_sigma=0.0
            )
            for _, truth, pose in some
        ]
        profiles = [profile for profile, _, _ in some]
        found[station // STATION] = ReferenceProfile.from_profiles(profiles, placements, 0.06e-3)
    return found


def arc_rows() -> list[Row]:
    rows = []
    for arc, limit, least in ((0.0, 0.015, 100.0), (0.2, 0.025, 97.0), (0.4, 0.035, 97.0)):
        tally, watch = track(HullJoint(), arc)
        name = f"{100 * arc:g} % arc points"
        rows += [tally.sd(name, limit), *tally.rows(name, least)]
        rows += [
            watch.row(f"{name}: time, median", median, 1.5),
            watch.row(f"{name}: time, 99 %", lambda taken: float(np.percentile(taken, 99)), 4),
        ]
    return rows


def fit_up_rows() -> list[Row]:
    tacks = tuple(HullTack(at=0.02 + 0.05 * k, length=20e-3) for k in range(4))
    rows = []
    for name, joint in (
        ("high-low 2 mm", HullJoint(high_low=2e-3)),
        ("open root", HullJoint(backing=False)),
        ("tacks", HullJoint(tacks=tacks)),
        ("74° without a gap", HullJoint(width=30.2e-3, opening_angle=1.29)),
    ):
        tally, _ = track(joint, 0.2)
        rows += [tally.sd(name, 0.025), tally.bias(name), *tally.rows(name, 97)]
    return rows


def remembered_rows() -> list[Row]:
    """Ten passes: back over what was welded without arc, then forward under it."""
    rows = []
    for arc, least in ((0.2, 95), (0.4, 90)):
        joint = HullJoint(beads=TEN_PASSES, ripple=0.1e-3)
        reader, watch = RememberingTracker(), Stopwatch()
        gc.disable()
        for passes in range(len(TEN_PASSES)):
            back = list(views(joint, passes, SectionLaserModel(), passes, WAY))
            forward = list(views(joint, passes, SectionLaserModel(arc=arc), 100 + passes, WAY))
            tally = Tally()
            for way, ahead in (
                (reversed(list(enumerate(back))), False),
                (enumerate(forward), True),
            ):
                for k, (profile, truth, _) in way:
                    reading = None
                    with watch, suppress(GrooveNotFound):
                        reading = reader.read(profile, STEP * k)
                    if not ahead or k < STATION:  # the vehicle has not left its first station
                        continue
                    tally.total += 1
                    if reading is not None:
                        tally.errors.append(reading.centre - float(truth[0]))
                        tally.sigmas.append(reading.centre_sigma)
            if passes in (6, 9):
                name = f"filled to {passes} of 10 passes, {100 * arc:g} % arc, remembered"
                rows.append(tally.sd(name, 0.05))
                rows.append(Row(f"{name}: read of {tally.total}", tally.read, 100, "%", least))
        gc.enable()
        name = f"ten passes, {100 * arc:g} % arc, remembered: time, 99 %"
        rows.append(watch.row(name, lambda taken: float(np.percentile(taken, 99)), 4))
    return rows


def fill_rows() -> list[Row]:
    rows = []
    for name, arc, passes, limit, least, reference in (
        ("filled to a half, 20 % arc", 0.2, 1, 0.035, 97, False),
        ("filled to 75 %, 20 % arc", 0.2, 3, 0.035, 90, False),
        ("filled to 75 %, 40 % arc, with reference", 0.4, 3, 0.05, 97, True),
        ("capped, 20 % arc, with reference", 0.2, 4, 0.1, 97, True),
    ):
        joint = HullJoint(beads=CAP, ripple=0.1e-3)
        tally, watch = track(joint, arc, passes=passes, reference=reference)
        rows += [tally.sd(name, limit), *tally.rows(name, least)]
        rows.append(
            watch.row(f"{name}: time, 99 %", lambda taken: float(np.percentile(taken, 99)), 4)
        )
    tally, _ = track(HullJoint(beads=CAP), 0.2, passes=4)
    rows.append(Row(f"capped, without reference: read of {tally.total}", tally.read, 0, "%"))
    return rows


def refusal_rows() -> list[Row]:
    """What must never steer: profiles of nothing, the same one again, plates without a joint."""
    tracker, steered, total = JointTracker(), 0, 0
    rng = np.random.default_rng(0)
    plate = np.array([(-0.2, 0.0), (0.2, 0.0)])
    for k, (profile, _, _) in enumerate(views(HullJoint(), 0, SectionLaserModel(arc=0.2), 7, 100)):
        tracker.read(profile)
        bare = simulate_section_profile(
            plate, SectionLaserPose(), SectionLaserModel(arc=0.2), rng, 0.01 * k
        )
        nothing = Profile(profile.x_s, np.full(len(profile), np.nan))
        for bad in (profile, nothing, bare):
            total += 1
            with suppress(GrooveNotFound):
                tracker.read(bad)
                steered += 1
    return [Row(f"frozen, empty or bare: read of {total}", steered, 0)]


def paper_rows() -> list[Row]:
    """The paper's method, for comparison: good without arc light, lost with it."""
    rows = []
    for arc, name in ((0.0, "no arc"), (0.2, "20 % arc")):
        off, lost = [], 0
        for profile, truth, _ in views(HullJoint(), 0, SectionLaserModel(arc=arc), 1):
            try:
                off.append(abs(float(read_joint_as_paper(profile)[1][0] - truth[0])))
            except GrooveNotFound:
                lost += 1
        share = 100 * (lost + sum(e > WRONG for e in off)) / PROFILES
        if arc == 0:
            p95 = 1e3 * float(np.percentile(off, 95))
            rows.append(Row(f"paper's method, {name}: error, 95 %", p95, 0.3, "mm"))
        rows.append(
            Row(
                f"paper's method, {name}: refused or off by more than {1e3 * WRONG:g} mm",
                share,
                100 if arc else 1,
                "%",
                at_least=50 if arc else 0,
            )
        )
    return rows


def measure() -> list[Row]:
    return [
        *arc_rows(),
        *fit_up_rows(),
        *fill_rows(),
        *remembered_rows(),
        *refusal_rows(),
        *paper_rows(),
    ]


if __name__ == "__main__":
    sys.exit(main("joint centre read off a crawler's profiles", measure, sys.argv[1:]))
