"""How well cables are towed in the closed loop: simulated yards, noise, passers-by, faults.

The plant is of another make, see `_other_cable`, but for tows over a broker. Every tow of the paper
is run whole with five seeds. ``--quick`` tows pieces of each seam with one seed: its beginning, its
middle and its end, where something happens.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from math import inf, nan
from shutil import which
from typing import Any, Final

import numpy as np
from _spread import say_what_is_wrong
from _table import Row, main
from _tow_disturbances import (
    NOISE_OF_ALL,
    is_disturbance_named_right,
    is_sound_tow_quiet,
    tow_past_visiting_obstacle,
)
from _tow_faults import BEND, FAULTS, fault_over_broker, random_fault
from _tow_paper import (
    TABLE_III,
    VA_PIECE,
    VA_SEAM,
    estimate_rows,
    identification_rows,
    printed_passer_by_rows,
    table_three_rows,
    tow_quietly,
)
from _tows import EXAMPLES, NOISE, Tow, passer_by, run_tow, seam_piece

from tjscan.job.tow.job import read_tow_job
from tjscan.runs.tow.results import TowOutcome

SEEDS: Final = range(1, 6)
PASSERS_BY: Final = 20
RANDOM_FAULTS: Final = 100
OBSTACLES: Final = 50
QUICK_OBSTACLES: Final = 4
DRAWN_DISTURBANCES: Final = 204
QUICK_EVERY: Final = 41
QUICK_PASSERS_BY: Final = 2
QUICK_RANDOM_FAULTS: Final = 1
QUICK_FAULTS: Final = 3
PIECES: Final = ((0.0, 0.12), (0.5, 0.08), (1.0, 0.12))
"""Where the pieces of the quick bench lie, and how long they are: share and metres."""

YARDS: Final[dict[str, Tow]] = {
    "V-C": Tow("tow-simulation"),
    "V-C, noise": Tow("tow-simulation", NOISE),
    "V-D": Tow("tow-yard"),
    "V-E": Tow("tow-passer-by"),
}


def tows_of(name: str, *, quick: bool) -> list[Tow]:
    """What is towed for a name: the whole, or pieces of it."""
    one = YARDS[name]
    if not quick:
        return [one]
    if name == "V-E":
        return [Tow(one.job, {"seam.stand_s": 150.0})]
    pieces = PIECES[1:2] if name == "V-C, noise" else PIECES
    return [Tow(one.job, {**one.keys, **seam_piece(one.job, *piece)}) for piece in pieces]


def measure(*, quick: bool) -> Sequence[Row]:
    """Every row."""
    seeds = SEEDS[:1] if quick else SEEDS
    asked: list[tuple[str, Tow, int]] = [
        (name, tow, seed) for name in YARDS for tow in tows_of(name, quick=quick) for seed in seeds
    ]
    count = QUICK_PASSERS_BY if quick else PASSERS_BY
    asked += [("passers-by", passer_by(seed), seed) for seed in range(1, count + 1)]
    with ProcessPoolExecutor(2) as pool:
        every = list(pool.map(_run, asked))
    found: dict[str, list[TowOutcome]] = {}
    for (name, _, _), outcome in zip(asked, every, strict=True):
        found.setdefault(name, []).append(outcome)
    rows = [row for name in YARDS for row in yard_rows(name, found[name])]
    rows += passer_by_rows(found["passers-by"])
    rows += paper_rows(quick=quick)
    rows += disturbance_rows(quick=quick)
    rows.append(alone_row())
    if which("mosquitto") or which("mosquitto", path="/usr/sbin"):
        rows += broker_rows(quick=quick)
    return rows


def paper_rows(*, quick: bool) -> list[Row]:
    """The paper's own vehicles and path, its estimate's errors, and what cable it is."""
    keys = TABLE_III | (seam_piece("tow-yard", 0.0, 0.2) if quick else {})
    tows = [tow_quietly("tow-yard", keys, seed) for seed in (SEEDS[:1] if quick else SEEDS)]
    rows = [*table_three_rows(tows), *printed_passer_by_rows(1)]
    rows += estimate_rows(1, VA_PIECE if quick else VA_SEAM)
    return rows if quick else [*rows, *identification_rows(1)]


def yard_rows(name: str, found: Sequence[TowOutcome]) -> list[Row]:
    """Rows of one yard."""
    job = read_tow_job(EXAMPLES / f"{YARDS[name].job}.toml")
    noisy, standing = "noise" in name, name == "V-E"
    mean, most = 6.0, 12.0 if noisy or standing else 10.0

    def worst(value: Callable[[TowOutcome], float | None], *, least: bool = False) -> float:
        values = [v for one in found if (v := value(one)) is not None]
        return (min if least else max)(values, default=nan)

    def middle(value: Callable[[TowOutcome], float | None]) -> float:
        values = [v for one in found if (v := value(one)) is not None]
        return sum(values) / len(values) if values else nan

    bend, limits = 57.29578 * job.chain.joint_limit, job.limits
    rows = [
        Row(f"{name}: tows that were complete", _share(found), inf, "%", at_least=100),
        Row(f"{name}: force on the welder, mean", middle(lambda o: o.force_mean_n), mean, "N"),
        Row(f"{name}: force on the welder, max", worst(lambda o: o.force_max_n), most, "N"),
        Row(f"{name}: welder off its line", worst(lambda o: o.welder_off_mm), 1, "mm"),
        Row(f"{name}: joint angle", worst(lambda o: o.bend_deg), bend, "°"),
        Row(
            f"{name}: clearance of links",
            worst(lambda o: o.link_clearance_mm, least=True),
            inf,
            "mm",
            at_least=1e3 * limits.link_clearance,
        ),
        Row(
            f"{name}: clearance of bodies",
            worst(lambda o: o.body_clearance_mm, least=True),
            inf,
            "mm",
            at_least=1e3 * limits.vehicle_clearance,
        ),
        Row(f"{name}: touches", worst(lambda o: o.touches), 0),
    ]
    if not noisy:
        rows += [
            Row(f"{name}: estimate of a joint", middle(lambda o: o.estimate_deg), 1.2, "°"),
            Row(f"{name}: estimate of a link", middle(lambda o: o.estimate_mm), 7, "mm"),
        ]
    limit = 1e3 * (1.5 * job.seam.speed if name == "V-C" else job.vehicles.speed)
    rows.append(Row(f"{name}: towing speed asked", worst(lambda o: o.asked_mm_s), limit, "mm/s"))
    if standing:
        near = worst(lambda o: o.passer_by_mm, least=True)
        rows.append(
            Row(
                f"{name}: distance to the passer-by",
                near,
                inf,
                "mm",
                at_least=1e3 * limits.link_clearance,
            )
        )
    return rows


def passer_by_rows(found: Sequence[TowOutcome]) -> list[Row]:
    """Rows of those who head for the cable."""
    touched = sum(one.touches or 0 for one in found)
    near = min((one.passer_by_mm for one in found if one.passer_by_mm is not None), default=nan)
    return [
        Row(f"{len(found)} passers-by that head for the cable: touches", float(touched), 0),
        Row(f"{len(found)} passers-by: nearest", near, inf, "mm", at_least=0.0),
    ]


def disturbance_rows(*, quick: bool) -> list[Row]:
    """Worlds that are not as the program is told: what is noticed, and what comes of it."""
    told = range(DRAWN_DISTURBANCES)[:: QUICK_EVERY if quick else 1]
    seeds = range(1, (QUICK_OBSTACLES if quick else OBSTACLES) + 1)
    pieces = [("tow-simulation", 0.0), ("tow-simulation", 1.0), ("tow-yard", 0.0)]
    sound = [({**seam_piece(job, at, 0.08), "simulation.seed": 9}, job) for job, at in pieces]
    with ProcessPoolExecutor(2) as pool:
        disturbed = list(pool.map(is_disturbance_named_right, told))
        obstacles = list(pool.map(tow_past_visiting_obstacle, seeds))
        alarms = list(pool.map(is_sound_tow_quiet, *zip(*sound, strict=True)))
    say_what_is_wrong([words for right, words, _ in disturbed if not right])
    say_what_is_wrong([words for touches, on, words, _ in obstacles if touches or not on])
    say_what_is_wrong([words for quiet, words in alarms if not quiet])
    named = 100 * sum(right for right, _, _ in disturbed) / len(disturbed)
    noisy = [tow.welder_off_mm for _, words, tow in disturbed if words.startswith(NOISE_OF_ALL)]
    bend = max(tow.bend_until_halt_deg for _, _, tow in disturbed)
    touches = sum(ours for ours, *_ in obstacles)
    gone_on = 100 * sum(on for _, on, *_ in obstacles) / len(obstacles)
    seconds = [cycle.seconds for *_, tow in obstacles for cycle in tow.journal.cycles]
    return [
        Row(f"{len(disturbed)} disturbances: named right, no other", named, 100, "%", at_least=95),
        Row(f"{len(disturbed)} disturbances: joint angle until halted", bend, BEND, "°"),
        Row(
            f"{len(disturbed)} disturbances: joint angle, with vehicles that heed no command",
            max(tow.bend_deg for _, _, tow in disturbed),
            inf,
            "°",
        ),
        Row(f"{NOISE_OF_ALL}: welder off its line", max(noisy, default=0.0), 2, "mm"),
        Row(f"{len(obstacles)} obstacles: touches by our motion", touches, 0),
        Row(f"{len(obstacles)} obstacles: gone on", gone_on, 100, "%", at_least=95),
        Row(
            f"{len(obstacles)} obstacles: joint angle",
            max(tow.bend_deg for *_, tow in obstacles),
            BEND,
            "°",
        ),
        Row("plan beside an obstacle, 99 %", 1e3 * float(np.percentile(seconds, 99)), 20, "ms"),
        Row(f"{len(alarms)} sound tows: false alarms", sum(not q for q, _ in alarms), 0),
    ]


def alone_row() -> Row:
    """How much faster than real time the loop runs on one core, while nothing else does."""
    keys: dict[str, Any] = seam_piece("tow-simulation", 0.3, 0.2)
    factor = run_tow(Tow("tow-simulation", keys), 1).real_time_factor
    return Row(
        "real-time factor of the loop, alone",
        nan if factor is None else factor,
        inf,
        at_least=2,
    )


def broker_rows(*, quick: bool) -> list[Row]:
    """Faults through the real broker: what was touched, and what was lost."""
    names = list(FAULTS)[:QUICK_FAULTS] if quick else list(FAULTS)
    rows = []
    for name in names:
        found = fault_over_broker(FAULTS[name], seed=1)
        rows.append(Row(f"broker, {name}: {found.words}", float(not found.sound), 0))
    count = QUICK_RANDOM_FAULTS if quick else RANDOM_FAULTS
    ended = [fault_over_broker(random_fault(seed), seed=seed) for seed in range(count)]
    unsound = [f"seed {seed}: {one.words}" for seed, one in enumerate(ended) if not one.sound]
    say_what_is_wrong(unsound)
    ends = Counter(one.words.partition(";")[0] for one in ended).most_common()
    words = ", ".join(f"{number} {end}" for end, number in ends)
    rows.append(Row(f"broker, {count} random faults ({words}): unsound", len(unsound), 0))
    return rows


def _run(asked: tuple[str, Tow, int]) -> TowOutcome:
    _, tow, seed = asked
    return run_tow(tow, seed)


def _share(found: Sequence[TowOutcome]) -> float:
    return 100 * sum(one.complete for one in found) / len(found)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--quick"]
    sys.exit(main("Towing", partial(measure, quick=len(words) < len(sys.argv) - 1), words))
