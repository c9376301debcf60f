"""What was seen on the way back stands in for edges that are gone, with an honest error."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.crawler.joint_tracking.memory import (
    LINE_LENGTH,
    LINE_SIGMA,
    STATION_LENGTH,
    JointMemory,
    RememberingTracker,
    sigma_of_independent_part,
)
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.crawler.joint_tracking.tracking import ButtJointReading
from tjscan.joint.hull import HullJoint, WeldBead, hull_section
from tjscan.laser.profile import Profile
from tjscan.laser.section_laser import SectionLaserModel, SectionLaserPose, simulate_section_profile

NOISE = 0.06e-3
JOINT = HullJoint(
    beads=tuple(WeldBead(level=level, crown=0.5e-3) for level in (15e-3, 17e-3, 18.5e-3)),
    ripple=0.1e-3,
)
PLACE = JointPlacement(centre=0.0, hull_z=0.149, roll=0.0, centre_sigma=0.01e-3)
BACK, FORTH = np.arange(0.04, 0.0, -0.4e-3), np.arange(0.0, 0.04, 0.4e-3)


def see(rng: np.random.Generator, along: float, passes: int, arc: float = 0.0) -> Profile:
    pose = SectionLaserPose(offset=0.3e-3 * np.sin(40 * along))
    section = hull_section(JOINT, along, passes)
    return simulate_section_profile(section, pose, SectionLaserModel(arc=arc), rng)


def go(
    reader: RememberingTracker,
    places: Array,
    passes: int,
    rng: np.random.Generator,
    arc: float = 0.0,
) -> tuple[list[ButtJointReading], Array]:
    """Readings along a way, and their errors."""
    found, errors = [], []
    for along in places.tolist():
        with suppress(GrooveNotFound):
            found.append(reader.read(see(rng, along, passes, arc), along))
            errors.append(found[-1].centre + 0.3e-3 * np.sin(40 * along))
    return found, np.array(errors)


def remember(memory: JointMemory, places: Array, passes: int = 1) -> JointMemory:
    rng = np.random.default_rng(0)
    for along in places.tolist():
        memory.remember(along, see(rng, 0.0, passes), PLACE, NOISE)
    return memory


def test_only_what_is_seen_on_the_way_back_is_remembered() -> None:
    memory = remember(JointMemory(), FORTH)
    assert memory.reference_at(0.022) is None
    remember(memory, BACK)
    assert memory.reference_at(0.022) is not None
    assert memory.reference_at(0.20) is None


def test_standing_still_is_not_seeing_more() -> None:
    standing = 0.022 + 1e-5 * np.random.default_rng(1).standard_normal(200)
    memory = remember(JointMemory(), np.concatenate(([0.04], standing, [0.01])))
    assert memory.reference_at(0.022) is None


def test_last_way_back_counts() -> None:
    memory, depths = JointMemory(), []
    for passes in (1, 3):
        remember(memory, FORTH)
        reference = remember(memory, BACK, passes).reference_at(0.022)
        assert reference is not None
        depths.append(np.interp(0.0, reference.across, reference.depth))
    assert depths == pytest.approx([4.5e-3, 1.0e-3], abs=0.3e-3)


@pytest.mark.parametrize(
    ("passes", "arc", "least"), [(1, 0.2, 0.98), (3, 0.2, 0.93), (3, 0.4, 0.8)]
)
def test_joint_is_read_where_hardly_any_edge_is_left(passes: int, arc: float, least: float) -> None:
    reader, rng = RememberingTracker(), np.random.default_rng(1)
    go(reader, FORTH[::2], 0, rng)
    for welded in range(1, passes):
        go(reader, BACK, welded, rng)
        go(reader, FORTH[::2], welded, rng)
    go(reader, BACK, passes, rng)
    found, errors = go(reader, FORTH, passes, rng, arc)
    assert len(found) >= least * len(FORTH)
    sigmas = np.array([one.centre_sigma for one in found])
    assert np.mean((errors / sigmas) ** 2) < 1.5
    assert np.std(errors) < 0.06e-3


FLUSH = HullJoint(
    high_low=1e-3, beads=(WeldBead(level=14e-3), WeldBead(level=20e-3, crown=3e-3, right=-0.1))
)
"""A joint whose last bead is flush with its left edge."""


def go_back_after_flush_bead(
    seen: Callable[[float], tuple[HullJoint, float]],
) -> list[tuple[float, float]]:
    """Places along the joint that are read behind a flush bead, and errors there, metres.

    Parameters
    ----------
    seen : callable
        Gives the joint at a place, and how far to the right of it the laser is, metres.
    """
    reader, rng, found = RememberingTracker(), np.random.default_rng(1), []
    for passes, places in ((1, FORTH), (1, BACK), (2, BACK)):
        for along in places.tolist():
            joint, off = seen(along) if passes == 2 else (FLUSH, 0.0)
            section = hull_section(joint, along, passes)
            pose = SectionLaserPose(offset=off)
            with suppress(GrooveNotFound):
                profile = simulate_section_profile(section, pose, SectionLaserModel(), rng)
                reading = reader.read(profile, along)
                found += [(along, reading.centre + off)] if passes == 2 else []
    return found


@pytest.mark.parametrize("knock", [0.3e-3, -0.5e-3, 1e-3, -3e-3])
def test_knock_where_a_bead_hides_an_edge_shows_or_ends_the_readings(knock: float) -> None:
    found = go_back_after_flush_bead(lambda along: (FLUSH, 0.0 if along > 0.02 else knock))
    assert len([along for along, _ in found if along > 0.02]) > 40
    assert np.abs([error for _, error in found]).max() < 0.15e-3


@pytest.mark.parametrize("narrower", [2e-3, 4e-3])
def test_narrower_joint_is_not_read_on_where_a_bead_hid_an_edge(narrower: float) -> None:
    """Its right edge goes on where that of the joint was."""
    other = replace(FLUSH, width=FLUSH.width - narrower, beads=FLUSH.beads[:1])
    found = go_back_after_flush_bead(
        lambda along: (FLUSH, 0.0) if along > 0.02 else (other, -narrower / 2)
    )
    assert len([along for along, _ in found if along <= 0.02]) <= 2  # of 50


def test_without_memory_it_is_not() -> None:
    reader, rng = RememberingTracker(), np.random.default_rng(1)
    go(reader, BACK[-20:], 0, rng)
    found, _ = go(reader, FORTH[:30], 3, rng, 0.2)
    assert len(found) < 15


def test_error_of_what_is_remembered_grows_from_way_to_way() -> None:
    """Each way is read by what the one before left, with an error of its own on top."""
    memory, rng, own, shared = JointMemory(), np.random.default_rng(0), 0.03e-3, 0.0
    for way in range(1, 5):
        placement = replace(PLACE, centre_sigma=np.hypot(own, shared), shared_sigma=shared)
        for along in np.concatenate((FORTH, BACK)).tolist():
            memory.remember(along, see(rng, 0.0, 3), placement, NOISE)
        reference = memory.reference_at(0.022)
        assert reference is not None
        shared = reference.centre_sigma
        independent = LINE_LENGTH / STATION_LENGTH  # readings nearer to each other are off alike
        each = np.hypot(own, LINE_SIGMA)
        assert shared == pytest.approx(each * np.sqrt(way / independent), rel=0.1)


@given(own=st.floats(1e-3, 1.0), shared=st.floats(0.0, 1.0), count=st.integers(1, 200))
def test_readings_together_tell_no_more_than_what_they_share_allows(
    own: float, shared: float, count: int
) -> None:
    told = sum(1 / sigma_of_independent_part(own, shared, k) ** 2 for k in range(1, count + 1))
    assert told == pytest.approx(count / (own**2 + count * shared**2), rel=1e-6)
