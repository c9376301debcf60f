"""Lasers that fail, in front of a laser that does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import Self

import numpy as np

from tjscan.core.devices import DeviceBase
from tjscan.core.errors import LaserFault
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile

Fault = Callable[[Profile, Profile], Profile]
"""Makes of a profile, and of the one given before, what the failing laser gives; or raises."""


class FaultyLaser(DeviceBase):
    """A laser whose captures of some numbers go through a fault.

    Parameters
    ----------
    laser : LineLaser
        The one that does not fail.
    faults : callable
        Gives the fault of the k-th capture, or None.
    """

    def __init__(self, laser: LineLaser, faults: Callable[[int], Fault | None]) -> None:
        self._laser, self._faults = laser, faults
        self._given: Profile | None = None
        self.captures = 0

    def __enter__(self) -> Self:
        self._laser.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._laser.__exit__(kind, error, trace)

    def capture(self) -> Profile:
        fault = self._faults(self.captures)
        self.captures += 1
        now = self._laser.capture()
        self._given = now if fault is None else fault(now, self._given or now)
        return self._given


def missing(now: Profile, before: Profile) -> Profile:
    raise LaserFault("no profile came within 1 s")


def empty(now: Profile, before: Profile) -> Profile:
    nothing = np.full(len(now), np.nan)
    return replace(now, x_s=nothing, z_s=nothing)


def frozen(now: Profile, before: Profile) -> Profile:
    """The one before, with the time of this one."""
    return replace(before, time=now.time)


def late(now: Profile, before: Profile) -> Profile:
    """The one before, as a buffer gives it that is not emptied."""
    return before


def spurious(share: float, seed: int) -> Fault:
    """Points anywhere in the range instead of a share of the true ones."""
    rng = np.random.default_rng(seed)

    def fault(now: Profile, before: Profile) -> Profile:
        wrong = rng.random(len(now)) < share
        z_s = np.where(wrong, rng.uniform(0.190, 0.290, len(now)), now.z_s)
        x_s = np.where(wrong, now.x_s * z_s / now.z_s, now.x_s)  # along the same ray
        x_s = np.where(wrong & np.isnan(x_s), rng.uniform(-0.05, 0.05, len(now)), x_s)
        return replace(now, x_s=x_s, z_s=z_s)

    return fault
