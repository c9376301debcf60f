"""Sets of profiles as they are handed in: good ones, and ones with the mistakes that are made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from _targets import TargetSimulator
from scipy.spatial.transform import Rotation

from tjscan.calibration.hand_eye import calibrate_on_targets
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.targets.ball import SeenBall, SphereTarget
from tjscan.calibration.targets.roof import SeenRoof
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.errors import CalibrationRefused, PoseUnreachable
from tjscan.core.frames import Array, inverse_pose, pose, rotation_angle_between
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

RADIUS: Final = 0.040
RADIUS_OFF: Final = 0.5e-3
WELL: Final = np.radians([10.0, -80.0, 100.0, -60.0, -80.0, 20.0])
SWAPPED_FROM: Final = 0.03
"""Metres (and radians) that swapped poses differ by: twins may be swapped without harm."""

Numbers = Callable[[Rotation], Array]
WRITTEN: Final[dict[str, tuple[Numbers, Callable[[Array], Rotation]]]] = {
    "fixed x y z angles": (
        lambda R: R.as_euler("xyz"),
        lambda n: Rotation.from_euler("xyz", n),
    ),
    "moving z y x angles": (
        lambda R: R.as_euler("ZYX"),
        lambda n: Rotation.from_euler("ZYX", n),
    ),
    "moving x y z angles": (
        lambda R: R.as_euler("XYZ"),
        lambda n: Rotation.from_euler("XYZ", n),
    ),
    "rotation vector": (lambda R: R.as_rotvec(), Rotation.from_rotvec),
}
"""Three numbers, and how an arm's maker means them."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one set.

    Parameters
    ----------
    kind : str
        The mistake that was made, or ``good``.
    caught : bool
        Refused, or named in a warning.
    reason : str
        Why, or nothing.
    """

    kind: str
    caught: bool
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class MistakeMaker:
    """Makes sets of profiles of a ball or a roof edge, on arms that are off, and solves them.

    Parameters
    ----------
    hand : TargetSimulator
        The sensor and its errors.
    noise : NoiseModel
        What is stated of them and of the arm.
    nominal : Kinematics
        The arm as its controller knows it; every set has another true one.
    """

    hand: TargetSimulator
    noise: NoiseModel
    nominal: Kinematics

    def arm(self, rng: np.random.Generator) -> Kinematics:
        """An arm as its maker's calibration leaves it."""
        return deviate_joint_frames(
            self.nominal, PlacementTolerance().sigmas * rng.standard_normal((6, 6))
        )

    def poses(self, rng: np.random.Generator, target: str) -> Array:
        """Poses within reach, 15 of them, shape (15, 4, 4)."""
        drawn = self.hand.poses(rng, 60, target)
        return np.stack([T for T in drawn if self.reaches(T)][:15])

    def reaches(self, T_b_f: Array) -> bool:
        """Whether the nominal arm reaches a pose."""
        try:
            self.nominal.inverse(T_b_f, WELL)
        except PoseUnreachable:
            return False
        return True

    def solve(
        self, rng: np.random.Generator, target: str, stated: Array, told: Array, off: float = 0.0
    ) -> HandEyeCalibration:
        """Solve a set that was taken at `stated` poses and handed in with the `told` ones."""
        arm = self.arm(rng)
        true = np.stack([arm.forward(self.nominal.inverse(T, WELL)) for T in stated])
        if target == "ball":
            arcs = [
                PosedFit(s.name, T, s.fit)
                for s, T in zip(self.hand.arcs(stated, true, rng), told, strict=True)
            ]
            seen = SeenBall(arcs, SphereTarget(RADIUS + off), self.noise)
            return calibrate_on_targets([seen], self.noise, check_conventions=True)
        roofs = [
            PosedFit(s.name, T, s.fit)
            for s, T in zip(self.hand.roofs(stated, true, rng), told, strict=True)
        ]
        return calibrate_on_targets(
            [SeenRoof(roofs, self.noise)], self.noise, check_conventions=True
        )

    def verdict(self, seed: int, kind: str) -> Verdict:
        """Make one set with a mistake of a kind, and see what becomes of it."""
        rng = np.random.default_rng([seed, KINDS.index(kind)])
        target = "ball" if kind == "wrong radius" or seed % 2 else "roof"
        T, off = self.poses(rng, target), 0.0
        told, named = T, ""
        if kind in DEGENERATE:
            sets = (DEGENERATE[kind](rng, first, len(T)) for first in T)
            T = told = next(found for found in sets if all(map(self.reaches, found)))
        elif kind == "two swapped":
            i, j = _swapped(rng, T)
            told = T.copy()
            told[[i, j]] = T[[j, i]]
            named = f"{i + 1},{j + 1}"
        elif kind == "one pose missing":
            k = int(rng.integers(4, 9))
            told = np.concatenate((T[:k], T[k + 1 :], T[-1:]))
        elif kind == "shuffled":
            told = T[rng.permutation(len(T))]
        elif kind == "wrong radius":
            off = RADIUS_OFF * (-1) ** seed
        elif kind == "inverse poses":
            told = np.stack([inverse_pose(one) for one in T])
        elif kind == "wrong convention":
            told = _misread(rng, T)
        try:
            result = self.solve(rng, target, T, told, off)
        except CalibrationRefused as refusal:
            return Verdict(kind, True, refusal.reason)
        rejected = ",".join(name.split()[1] for name in result.rejected_sample_names)
        caught = bool(named) and set(named.split(",")) <= set(rejected.split(","))
        return Verdict(kind, caught, f"left out: {rejected}" if rejected else "")


def _swapped(rng: np.random.Generator, T: Array) -> tuple[int, int]:
    """Two poses that are not twins."""
    while True:
        i, j = (int(k) for k in rng.choice(len(T), 2, replace=False))
        apart = np.linalg.norm(T[i, :3, 3] - T[j, :3, 3])
        if apart + rotation_angle_between(T[i, :3, :3], T[j, :3, :3]) > SWAPPED_FROM:
            return i, j


def _misread(rng: np.random.Generator, T: Array) -> Array:
    """The same numbers under another maker's meaning."""
    while True:
        meant, read = (list(WRITTEN)[k] for k in rng.choice(len(WRITTEN), 2, replace=False))
        numbers = WRITTEN[meant][0](Rotation.from_matrix(T[:, :3, :3]))
        # What a maker calls x y z may be listed backwards by another.
        if rng.random() < 0.5:
            numbers = numbers[:, ::-1]
        R = WRITTEN[read][1](numbers).as_matrix()
        if not np.allclose(R, T[:, :3, :3]):  # some makers mean the same, listed backwards
            return np.stack([pose(one, p) for one, p in zip(R, T[:, :3, 3], strict=True)])


def _turned_about(first: Array, turns: Array) -> Array:
    """Poses that see what a first one sees, turned about the sensor's point of view."""
    depth = np.array((0.0, 0.0, 0.24))
    found = []
    for turn in turns:
        R = Rotation.from_rotvec(turn).as_matrix()
        found.append(first @ pose(None, depth) @ pose(R) @ pose(None, -depth))
    return np.stack(found)


def _translations(rng: np.random.Generator, first: Array, count: int) -> Array:
    return np.stack([pose(None, 0.006 * rng.uniform(-1, 1, 3)) @ first for _ in range(count)])


def _one_axis(rng: np.random.Generator, first: Array, count: int) -> Array:
    axis = rng.standard_normal(3)
    turns = np.outer(rng.uniform(-0.15, 0.15, count), axis / np.linalg.norm(axis))
    return _turned_about(first, turns)


def _hardly_tilted(rng: np.random.Generator, first: Array, count: int) -> Array:
    return _turned_about(first, np.radians(1.0) * rng.uniform(-1, 1, (count, 3)))


DEGENERATE: Final = {
    "only translations": _translations,
    "one axis": _one_axis,
    "hardly tilted": _hardly_tilted,
}
KINDS: Final = (
    "good",
    *DEGENERATE,
    "two swapped",
    "one pose missing",
    "shuffled",
    "wrong radius",
    "inverse poses",
    "wrong convention",
)
