"""Whether an arm rests, moved by a program or by hand."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from tjscan.core.errors import ArmFault
from tjscan.robot.arm import Arm, ArmState

STILL_TOLERANCE: Final = 2e-4
"""Radians a joint may turn while the arm rests: more than encoders flicker, 0.2 mm at 1 m."""

STILL_DURATION: Final = 0.25
"""Seconds for which no joint may turn further."""

REST_LIMIT: Final = 10.0
"""Seconds within which the arm has to come to rest."""

READING_PAUSE: Final = 0.02
"""Seconds between two looks."""


def await_rest(
    arm: Arm,
    *,
    now: Callable[[], float] = time.monotonic,
    pause: Callable[[float], object] = time.sleep,
) -> ArmState:
    """Wait until an arm has been still for a moment.

    Parameters
    ----------
    arm : Arm
        The arm, connected.
    now, pause : callable, optional
        The clock to go by, in seconds, and what waits some seconds on it.

    Returns
    -------
    ArmState
        Its state at rest.

    Raises
    ------
    ArmFault
        If it is not at rest within `REST_LIMIT`.
    """
    until, since, start = now() + REST_LIMIT, now(), arm.state()
    while True:
        pause(READING_PAUSE)
        state, moment = arm.state(), now()
        if largest_joint_rotation(start, state) > STILL_TOLERANCE:
            since, start = moment, state
        elif moment - since >= STILL_DURATION:
            return state
        if moment > until:
            raise ArmFault(
                f"the arm does not come to rest: it still moved after {REST_LIMIT:g} s. Let it "
                "stand, leave freedrive, then start again."
            )


def check_not_moved(before: ArmState, after: ArmState) -> None:
    """Check that an arm has not moved between two states.

    Raises
    ------
    ArmFault
        If it has.
    """
    if (angle := largest_joint_rotation(before, after)) > STILL_TOLERANCE:
        raise ArmFault(
            f"the arm moved while the laser looked: a joint turned by {np.degrees(angle):.2f} "
            "deg. Let it stand, leave freedrive, then start again."
        )


def largest_joint_rotation(before: ArmState, after: ArmState) -> float:
    """Largest angle in radians by which a joint turned from one state to another."""
    return float(np.abs(after.q - before.q).max())
