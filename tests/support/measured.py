"""Measured sections as large as real ones, and the provenance of a file of them."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, pose
from tjscan.core.provenance import Provenance
from tjscan.groove.measured import MeasuredSection

ORIGIN = Provenance("tjscan 1.2.3", datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC), "yard.toml", "j")


def spread(rng: np.random.Generator, n: int) -> Array:
    """A covariance, shape (n, n), about one in size."""
    half = rng.normal(size=(n, n))
    return half @ half.T


def a_section(seed: int, *, azimuth: float | None = None, sure: bool = False) -> MeasuredSection:
    """A section as large as real ones are; `sure` leaves no uncertainty."""
    rng = np.random.default_rng(seed)
    scale = 0.0 if sure else 1.0
    return MeasuredSection(
        index=seed % 1000,
        station="left, upper" if seed % 2 else "left+right",
        azimuth=rng.uniform(-np.pi, np.pi) if azimuth is None else azimuth,
        T_r_g=pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-2, 2, 3)),
        points=rng.uniform(-2, 2, (5, 3)),
        covariances=scale * 1e-10 * np.array([spread(rng, 3) for _ in range(3)]),
        measures=np.array((1.0, 2e-3, 25e-3, 4e-4)) * rng.uniform(0.5, 2, 4),
        measure_covariance=scale
        * spread(rng, 4)
        * np.outer((1e-3, 2e-5, 3e-5, 5e-7), (1e-3, 2e-5, 3e-5, 5e-7)),
        work_angle=rng.uniform(-1, 1),
        rms=rng.uniform(0, 1e-4),
        model="tee with two facets",
        conditions=("open root", "seam weld beside") if seed % 2 else ("tack",),
        absent=("p4",) if seed % 2 else ("p3", "p4"),
        model_probability=rng.uniform(0.5, 1.0),
        root_opening=rng.uniform(1e-3, 4e-3),
    )
