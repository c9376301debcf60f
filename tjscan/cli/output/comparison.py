"""What ``tjscan compare`` prints."""

from __future__ import annotations

from json import dumps

import numpy as np

from tjscan.cli.output.console import print_message
from tjscan.comparison.compare import Comparison, comparison_to_dict
from tjscan.uncertainty.budget import budget_in_words


def print_comparison(comparison: Comparison, *, json: bool) -> None:
    """Print what was compared and its distances on stdout, or JSON; warnings go to stderr."""
    if json:
        print(dumps(comparison_to_dict(comparison), indent=2))
        return
    c, a = comparison, comparison.alignment
    for shape in (c.measured, c.reference):
        print(f"{shape.name}: {shape.stated.unit}, as {shape.stated.unit_source} states")
    print(f"given in frame {c.reference.stated.frame}")
    if a.method != "none":
        rounds = f", {a.rounds} rounds" if a.rounds else ""
        print(
            f"aligned by {a.method}: moved {1e3 * a.moved:.3f} mm, turned "
            f"{np.degrees(a.rotation_angle):.4f}°, {100 * a.fitness:.1f} % on the reference, "
            f"residual {1e3 * a.residual:.4f} mm rms{rounds}"
        )
    for d in reversed(c.deviations):  # the corners first: a cloud holds ghosts too
        s = d.statistics
        within = "" if d.within is None else f", {100 * d.within:.2f} % within tolerance"
        print(f"{d.kind}, {len(d.distances)} distances: {d.meaning}")
        print(
            f"  median {s.median:.4f}, p95 {s.p95:.4f}, rms {s.rms:.4f}, mean {s.mean:.4f}, "
            f"max {s.max:.4f} mm{within}"
        )
    if c.uncertainty is not None:
        print(budget_in_words(c.uncertainty))
    for warning in c.warnings:
        print_message(f"warning: {warning}")
    if c.tolerance is not None:
        verdict = "within" if c.passed else "OUTSIDE"
        print(f"p95 {verdict} the tolerance of {1e3 * c.tolerance:g} mm")
