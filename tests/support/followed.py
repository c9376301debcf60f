"""Paths that a controller follows, and a controller without a network that does."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from scipy.interpolate import CubicSpline
from ur_cell import HOME, KINEMATICS

from tjscan.core.frames import Array
from tjscan.robot.following import JointMotion
from tjscan.robot.ur.following import following_program
from tjscan.robot.ur.knot_link import (
    ACKNOWLEDGED_REGISTER,
    PATH_TIME_REGISTER,
    VERDICT_REGISTER,
    knot_packages,
)
from tjscan_loopback.ur.controller import LoopbackController

HZ = 500.0

START = HOME - np.radians([0, 0, 60, 0, 0, 0])
"""Joint angles from which the elbow may turn either way."""


def wandering_path(random: Generator, before: JointMotion, start: float) -> JointMotion:
    """A path that leaves another at a time, wanders, and ends at rest, at uneven knots."""
    q, speed = before.at(start)
    duration = random.uniform(1.0, 2.0)
    goals = START + random.uniform(-0.15, 0.15, (2, 6))
    times = start + duration * np.array((0.0, 0.5, 1.0))
    spline = CubicSpline(times, np.vstack((q, goals)), bc_type=((1, speed), (1, np.zeros(6))))
    steps = np.cumsum(random.uniform(0.5, 1.5, random.integers(20, 70)))
    knots = np.concatenate(([start], start + duration * steps / steps[-1]))
    speeds = spline(knots, 1)
    speeds[-1] = 0.0
    return JointMotion(knots, spline(knots), speeds)


class FollowingController:
    """A controller on which the program that follows runs, its ticks counted by hand."""

    def __init__(self, packet_seed: int = 0) -> None:
        self.told: list[str] = []
        self.controller = LoopbackController(
            KINEMATICS,
            START,
            hz=HZ,
            fast=False,
            report_line=self.told.append,
            packet_seed=packet_seed,
        )
        self.controller.start_script(following_program())
        self.times: list[float] = []
        self.targets: list[Array] = []
        self.actual: list[Array] = []
        self.waiting: dict[int, Array] = {}
        self._beat = self.stopping = 0.0
        self.advance()

    @property
    def runs(self) -> bool:
        return "program stopped" not in self.told

    @property
    def now(self) -> float:
        return self.controller.output_double[PATH_TIME_REGISTER]

    @property
    def verdict(self) -> int:
        return self.controller.output_int[VERDICT_REGISTER]

    def send(self, epoch: int, path: JointMotion, first: int) -> None:
        """Begin to send an epoch, a package a tick."""
        packages = knot_packages(epoch, path.times, path.q, path.speed, first)
        self.waiting = {epoch * 64 + i: package for i, package in enumerate(packages)}

    def write(self, registers: Array) -> None:
        """Write all registers, as a package does."""
        names = [f"input_double_register_{24 + i}" for i in range(24)]
        self.controller.take_inputs(list(zip(names, registers.tolist(), strict=True)))

    def advance(self, *, connected: bool = True) -> None:
        """Let a tick pass; the packages that are not acknowledged are sent again and again."""
        if connected:
            self.waiting.pop(self.controller.output_int[ACKNOWLEDGED_REGISTER], None)
            self._beat += 1.0
            registers = np.zeros(24)
            if self.waiting:
                key = next(iter(self.waiting))
                registers = self.waiting.pop(key).copy()
                self.waiting[key] = registers
            registers[1:3] = self._beat, self.stopping
            self.write(registers)
        self.controller.advance_one_tick()
        self.times.append(self.now)
        self.targets.append(self.controller.target)
        self.actual.append(self.controller.q)


def gentle_path(random: Generator, before: JointMotion, start: float) -> JointMotion:
    """A path as scans have them: slow enough that an arm which lags behind keeps on it."""
    q, speed = before.at(start)
    goals = START + random.uniform(-0.1, 0.1, (1, 6))
    times = start + np.array((0.0, 2.5))
    spline = CubicSpline(times, np.vstack((q, goals)), bc_type=((1, speed), (1, np.zeros(6))))
    knots = np.linspace(start, start + 2.5, 60)
    speeds = spline(knots, 1)
    speeds[-1] = 0.0
    return JointMotion(knots, spline(knots), speeds)


def distance_from_paths(q: Array, paths: list[JointMotion]) -> float:
    """Largest angle between joint angles and the nearest that lie on any of some paths, radians."""
    return min(
        float(np.abs(path.at(np.arange(path.times[0], path.end + 2e-3, 2e-3))[0] - q).max(1).min())
        for path in paths
    )
