"""How well grooves are read off profiles.

Profiles are simulated before joints of several sizes, all round, from poses that are off by
up to 5 degrees and 5 mm; the truth is where the laser plane cuts the joint's edges.

``--quick`` gives the same rows from a twelfth of the poses.
"""

from __future__ import annotations

import gc
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np
from _stopwatch import Stopwatch
from _table import Row, main
from _views import Stage, View, bound, hits_of, profile_of, view

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.read import read_groove
from tjscan.groove.section import GrooveSection, section_from_points
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import JointFile, read_joint
from tjscan.laser.faults import LaserRayHits
from tjscan.laser.model import LaserModel
from tjscan.laser.profile import Profile

CAD: Final = Path(__file__).parent.parent / "cad"
PULL: Final = math.radians(10)
POSES, REFLECTIVE_POSES, EMPTY_VIEWS = 240, 2000, 60
QUICK: Final = 12
"""How many times fewer poses are taken with ``--quick``."""

REPEATS: Final = 5
"""Profiles from each pose."""

REFLECTIVE: Final = LaserModel(ghosts=0.15, missing=0.10)
"""Default noise, bias, drop-out and flyers; more ghosts and gaps than the default."""


def joints() -> list[JointDefinition]:
    """Two joints of the project, and a smaller and a larger one."""
    small = {
        "leg": {"outer_diameter_mm": 406.4, "wall_mm": 19.1, "length_mm": 1000.0},
        "brace": {"outer_diameter_mm": 323.9, "wall_mm": 19.1, "length_mm": 500.0},
        "groove": {
            "angle_deg": [[90.0, 50.0], [140.0, 65.0]],
            "root_opening_mm": 3.0,
            "root_face_mm": 1.5,
            "root_bead_mm": 2.0,
        },
    }
    large = {
        "leg": {"outer_diameter_mm": 914.0, "wall_mm": 31.8, "length_mm": 1800.0},
        "brace": {"outer_diameter_mm": 610.0, "wall_mm": 25.4, "length_mm": 900.0},
        "groove": small["groove"],
    }
    return [
        read_joint(CAD / "tjoint-600x457.toml"),
        read_joint(CAD / "yjoint-600x457-60deg.toml"),
        JointFile.model_validate(small).definition("tjoint-406x324x19"),
        JointFile.model_validate(large).definition("tjoint-914x610"),
    ]


def views(
    stages: list[Stage], count: int, model: LaserModel, seed: int, slop: float = 1.0
) -> Iterator[tuple[View, LaserRayHits]]:
    """Poses all round all joints."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        v = view(
            stages[k % len(stages)],
            rng.uniform(0, 2 * np.pi),
            pull=PULL * rng.choice([-1, 1]),
            turn=slop * math.radians(5) * rng.uniform(-1, 1, 3),
            shift=slop * 5e-3 * rng.uniform(-1, 1, 3),
        )
        yield v, hits_of(stages[k % len(stages)], v, model)


@dataclass
class Tally:
    """What came of many readings."""

    errors: list[Array]
    areas: list[float]
    normalised: list[Array]
    refused: int = 0

    def add(self, v: View, section: GrooveSection | None, truth: GrooveSection) -> None:
        """Compare what was read with the truth."""
        if section is None:
            self.refused += 1
            return
        off = section.points_s[1:4, [0, 2]] - v.corners
        self.errors.append(np.linalg.norm(off, axis=1))
        self.areas.append(section.area / truth.area - 1)
        spread = np.linalg.inv(section.corner_covariances_s + 1e-18 * np.eye(2))
        self.normalised.append(np.einsum("ki,kij,kj->k", off, spread, off) / 2)


def read(profile: Profile) -> GrooveSection | None:
    """The section; None where it is refused."""
    try:
        return read_groove(profile)
    except GrooveNotFound:
        return None


def noise_only(stages: list[Stage], sigma: float, poses: int) -> list[Row]:
    model = LaserModel.without_faults(noise=sigma)
    tally, bounds = Tally([], [], []), []
    for k, (v, hits) in enumerate(views(stages, poses, model, 1)):
        truth, limit = section_from_points(v.five), bound(hits, v, model)
        for r in range(REPEATS):
            tally.add(v, read(profile_of(hits, model, REPEATS * k + r)), truth)
            bounds.append(limit)
    name = f"noise {1e3 * sigma:g} mm"
    rows = [Row(f"{name}: refused", tally.refused, 0)]
    if not tally.refused:
        errors, limits = np.array(tally.errors), np.array(bounds)
        ratio = np.sqrt((errors**2).mean(axis=0) / (limits**2).mean(axis=0))
        rows += [
            Row(f"{name}: {p}, RMS error / Cramér-Rao bound", float(r), 1.3)
            for p, r in zip(("p2", "p3", "p4"), ratio, strict=True)
        ]
        nees = float(np.mean(tally.normalised))
        rows.append(Row(f"{name}: normalised error squared", nees, 1.1, at_least=0.9))
    return rows


def reflections(stages: list[Stage], poses: int) -> list[Row]:
    tally, watch = Tally([], [], []), Stopwatch()
    gc.disable()
    for k, (v, hits) in enumerate(views(stages, poses, REFLECTIVE, 2)):
        truth = section_from_points(v.five)
        for r in range(REPEATS):
            profile = profile_of(hits, REFLECTIVE, REPEATS * k + r)
            with watch if r == 0 else nullcontext():
                section = read(profile)
            tally.add(v, section, truth)
        gc.collect(0)
    gc.enable()
    errors = 1e3 * np.array(tally.errors)
    total = poses * REPEATS
    wrong = np.count_nonzero(errors.max(axis=1) > 1)
    areas = 100 * np.array(tally.areas)
    worst = float(np.percentile(errors, 95, axis=0).max())
    return [
        Row(f"reflections: read of {total}", 100 * len(errors) / total, 100, "%", at_least=99.5),
        Row("reflections: corner error, 95 %", worst, 0.15, "mm"),
        Row("reflections: wrong by more than 1 mm", 100 * wrong / total, 0.1, "%"),
        Row("reflections: area, mean error", abs(float(areas.mean())), 0.5, "%"),
        Row("reflections: area, mean absolute error", float(np.abs(areas).mean()), 0.5, "%"),
        watch.row("reflections: time, median", median, 2),
        watch.row("reflections: time, 99 %", lambda taken: float(np.percentile(taken, 99)), 6),
    ]


def no_groove(stages: list[Stage], count: int) -> list[Row]:
    """Wall only, leg only, and drawings of other things."""
    read_ = total = 0
    for away in (-0.15, 0.15):
        rng = np.random.default_rng(3)
        for k in range(count):
            stage, shift = stages[k % len(stages)], np.array([away, 0.0, 0.0])
            v = view(stage, rng.uniform(0, 2 * np.pi), pull=PULL, turn=np.zeros(3), shift=shift)
            section = read(profile_of(hits_of(stage, v, REFLECTIVE), REFLECTIVE, k))
            read_, total = read_ + (section is not None), total + 1
    for k in range(count):
        for draw in (plane, edge, valley, pipe, dust, empty):
            section = read(draw(np.random.default_rng(k)))
            read_, total = read_ + (section is not None), total + 1
    return [Row(f"no groove: read of {total}", read_, 0)]


def drawn(rng: np.random.Generator, depth: Callable[[Array], Array]) -> Profile:
    x = np.linspace(-0.05, 0.05, 640)
    return Profile(x, 0.24 + depth(x) + 30e-6 * rng.standard_normal(640))


def plane(rng: np.random.Generator) -> Profile:
    return drawn(rng, lambda x: rng.uniform(-1, 1) * x)


def edge(rng: np.random.Generator) -> Profile:
    return drawn(rng, lambda x: rng.uniform(0.2, 1) * np.abs(x - rng.uniform(-0.02, 0.02)))


def valley(rng: np.random.Generator) -> Profile:
    return drawn(rng, lambda x: -rng.uniform(0.2, 1) * np.abs(x - rng.uniform(-0.02, 0.02)))


def pipe(rng: np.random.Generator) -> Profile:
    radius = rng.uniform(0.06, 0.5)
    return drawn(rng, lambda x: radius - np.sqrt(radius**2 - x**2))


def dust(rng: np.random.Generator) -> Profile:
    return drawn(rng, lambda x: rng.uniform(-0.05, 0.05, x.shape))


def empty(rng: np.random.Generator) -> Profile:
    return drawn(rng, lambda x: np.full_like(x, np.nan))


def measure(share: int) -> list[Row]:
    """All rows, each from one in `share` of its poses."""
    stages = [Stage.of(joint) for joint in joints()]
    return [
        *noise_only(stages, 20e-6, POSES // share),
        *noise_only(stages, 50e-6, POSES // share),
        *reflections(stages, REFLECTIVE_POSES // share),
        *no_groove(stages, EMPTY_VIEWS // share),
    ]


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--quick"]
    fewer = QUICK if "--quick" in sys.argv else 1
    sys.exit(main("grooves read off profiles", partial(measure, fewer), words))
