"""Make `towing-optima.json`: 30 random towing problems and their best shapes, by another solver.

Needs CasADi, which tjscan does not: ``pip install casadi``, then run this file.
Nothing of `tjscan.towing` is used. The objective is written once more, as CasADi's expressions; its
derivatives are CasADi's, its solver is IPOPT, from many random shapes. Every problem is a yard with
four walls and something round in it. `estimate` is the best shape at a welder's pose, `angles` that
for a welder 10 mm on, with change weighed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np

FILE: Final = Path(__file__).with_name("towing-optima.json")
PROBLEMS, STARTS = 30, 6
LINKS, LENGTH, LIMIT = 60, 0.1, 0.77
TARGETS: Final = (0.77**2, 0.30, 0.60)
SHARES: Final = ((0.8, 4.0), (0.2, 1.0))
WEIGHTS: Final = ((75.0, 24.0, 1.0), (24.0, 75.0, 1.0), (75.0, 20.0, 5.0))


def rising(f: Any, c: float) -> Any:
    return sum(a * (ca.tanh(b / c * (f - c)) + np.tanh(b)) / (1 + np.tanh(b)) for a, b in SHARES)


def falling(d: Any, c: float) -> Any:
    return sum(a * (1 - ca.tanh(b / c * (d - c))) / 2 for a, b in SHARES)


def make_solver() -> Any:
    """IPOPT for all problems: what differs is a parameter."""
    theta, given = ca.MX.sym("theta", LINKS), ca.MX.sym("given", LINKS + 13)
    estimate = given[:LINKS]
    low, high, disc = given[LINKS : LINKS + 2], given[LINKS + 2 : LINKS + 4], given[LINKS + 4 :]
    centre, radius, pose, weights = disc[:2], disc[2], disc[3:6], disc[6:9]
    phi = ca.cumsum(theta)
    x, y = LENGTH * ca.cumsum(ca.cos(phi)), LENGTH * ca.cumsum(ca.sin(phi))
    distances = (
        x - low[0],
        high[0] - x,
        y - low[1],
        high[1] - y,
        ca.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + 1e-18) - radius,
    )
    free = 1.0
    for d in distances:
        free *= 1 - falling(d, TARGETS[1])
    change = ca.sqrt((theta - estimate)[1:] ** 2 + 0.02**2) - 0.02
    f = (
        weights[0] * ca.sum1(rising(theta**2, TARGETS[0]))
        + weights[1] * ca.sum1(1 - free)
        + weights[2] * ca.sum1(rising(change, TARGETS[2]))
    ) / LINKS
    g = ca.vertcat(x[-1] - pose[0], y[-1] - pose[1], phi[-1] - pose[2])
    options = {
        "ipopt.print_level": 0,
        "print_time": 0,
        "expand": True,
        "ipopt.max_iter": 300,
        "ipopt.tol": 1e-9,
    }
    return ca.nlpsol("shape", "ipopt", {"x": theta, "f": f, "g": g, "p": given}, options)


def solve(solver: Any, given: Any, starts: list[Any]) -> tuple[Any, float, int]:
    """Best of the solutions from several shapes, and how many of them were found."""
    best, least, found = starts[0], np.inf, 0
    for start in starts:
        at = solver(x0=start, p=given, lbx=-LIMIT, ubx=LIMIT, lbg=0, ubg=0)
        if solver.stats()["success"]:
            found += 1
            if float(at["f"]) < least:
                best, least = np.array(at["x"]).ravel(), float(at["f"])
    return best, least, found


def bends(rng: Any) -> Any:
    s = np.linspace(0, 1, LINKS)
    waves = rng.normal(size=(3, 1)) * np.sin(rng.uniform(1, 9, (3, 1)) * s + rng.uniform(0, 6))
    return 0.08 * waves.sum(axis=0)


def main() -> None:
    rng, solver = np.random.default_rng(2022), make_solver()
    problems: list[dict[str, Any]] = []
    while len(problems) < PROBLEMS:
        width, half = rng.uniform(2.4, 3.4), rng.uniform(3.5, 5.0)
        low, high = (-rng.uniform(0, 0.2), -half), (width, half)
        pose = np.array(
            (
                width - rng.uniform(0, 0.4),
                rng.uniform(-0.8, 0.8) * half,
                rng.uniform(-1, 1) * np.pi / 2,
            )
        )
        disc = (rng.uniform(0.5, width), rng.uniform(-half, half), rng.uniform(0.1, 0.25))
        weights = WEIGHTS[rng.integers(3)]
        if np.hypot(*pose[:2]) > 5.0 or np.hypot(*(pose[:2] - disc[:2])) < 0.8:
            continue
        begin = pose - (0.0, 0.01, 0.0)
        rest = (*low, *high, *disc)
        given = np.concatenate((np.zeros(LINKS), rest, begin, (*weights[:2], 0.0)))
        estimate, _, found = solve(solver, given, [bends(rng) for _ in range(STARTS)])
        if found < STARTS // 2:
            continue
        given = np.concatenate((estimate, rest, pose, weights))
        starts = [estimate, *(estimate + 0.2 * bends(rng) for _ in range(2)), bends(rng)]
        angles, f, _ = solve(solver, given, starts)
        problems.append(
            {
                "low": low, "high": high, "disc": disc, "pose": pose.tolist(), "weights": weights,
                "estimate": np.round(estimate, 9).tolist(), "angles": np.round(angles, 9).tolist(),
                "f": f,
            }
        )  # fmt: skip
        FILE.write_text(json.dumps({"problems": problems}), encoding="utf-8")
        print(len(problems), found, f, flush=True)


if __name__ == "__main__":
    main()
