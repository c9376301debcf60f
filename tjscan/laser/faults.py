"""Measurement faults of a line laser: noise, bias, gaps, ghosts, flyers, quantisation."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.laser.deviation import Distortion
from tjscan.laser.model import LaserModel


class PointOrigin(IntEnum):
    """Where a simulated point comes from: true surface, ghost, flyer, stray, or missing."""

    MISSING = 0
    TRUE = 1
    GHOST = 2
    FLYER = 3
    STRAY = 4


@array_dataclass
class SimulatedProfile:
    """One simulated profile together with the truth about it, by columns.

    Parameters
    ----------
    x_s, z_s : ndarray, shape (n,)
        In frame s, in metres; NaN for no point.
    intensity : ndarray, shape (n,)
        0 to 1; zero for no point.
    kind : ndarray of int8, shape (n,)
        A `PointOrigin` for each column.
    """

    x_s: Array
    z_s: Array
    intensity: Array
    kind: NDArray[np.int8]


@dataclass(frozen=True, slots=True, eq=False)
class LaserRayHits:
    """What the rays of a laser hit, before any fault: one entry per column.

    Parameters
    ----------
    directions_s : ndarray, shape (n, 3)
        Unit rays from the emitter, in frame s.
    distance : ndarray, shape (n,)
        From the emitter to the first face, in metres; infinite if there is none.
    normals_s : ndarray, shape (n, 3)
        Normal of that face, on the sensor's side, in frame s; zero if there is none.
    seen : ndarray of bool, shape (n,)
        Whether the point is inside the range and free in view of the detector.
    ghost : ndarray, shape (n,)
        Distance at which the face shows the mirror image of another one; NaN if it shows
        none, or none inside the range.
    """

    directions_s: Array
    distance: Array
    normals_s: Array
    seen: Mask
    ghost: Array

    @property
    def incidence_cosine(self) -> Array:
        """Cosine of the angle of incidence, shape (n,); zero if there is no face."""
        return np.asarray(-np.einsum("ij,ij->i", self.directions_s, self.normals_s))


@dataclass(frozen=True, slots=True, eq=False)
class FaultRandomStreams:
    """A random generator of its own for each fault: switching one off leaves the others alone."""

    noise: Generator
    dropout: Generator
    missing: Generator
    ghosts: Generator
    flyers: Generator
    strays: Generator

    @classmethod
    def spawn(cls, rng: Generator) -> Self:
        """Spawn fresh random streams from a generator."""
        streams = rng.spawn(5)
        # A child's child: the k-th profile's streams stay what they were without it.
        return cls(*streams, *streams[-1].spawn(1))


def apply_faults(
    hits: LaserRayHits,
    model: LaserModel,
    streams: FaultRandomStreams,
    distortion: Distortion | None = None,
) -> SimulatedProfile:
    """Apply a sensor's faults to what its rays hit; gives the simulated profile.

    A ghost takes the place of the direct point, also of one that dropped out; a missing
    column stays empty whatever it saw; no point is outside the range.
    """
    cosine = np.clip(hits.incidence_cosine, 0.0, 1.0)
    distance = np.where(hits.seen, hits.distance, np.nan)
    kind = np.where(hits.seen, PointOrigin.TRUE, PointOrigin.MISSING).astype(np.int8)
    intensity = np.where(hits.seen, cosine, 0.0)

    flying = _flying_point_distances(hits, model, streams.flyers)
    flies = np.isfinite(flying)
    distance += _incidence_bias(cosine, model)
    distance -= _interreflection_pulls(hits, model)
    distance[flies], kind[flies] = flying[flies], PointOrigin.FLYER
    kind[_columns_lost_to_grazing(cosine, model, streams.dropout)] = PointOrigin.MISSING

    ghosts = _draw_mirror_image_columns(hits, model, streams.ghosts)
    distance[ghosts], kind[ghosts] = hits.ghost[ghosts], PointOrigin.GHOST
    intensity[ghosts] *= model.ghost_intensity

    strays, offsets = _stray_points(hits, model, streams.strays)
    are_true = kind[strays] == PointOrigin.TRUE
    strays, offsets = strays[are_true], offsets[are_true]
    distance[strays] += offsets
    kind[strays] = PointOrigin.STRAY

    count = round_randomly(model.missing * model.columns, streams.missing)
    everywhere = np.arange(model.columns)
    missing = choose_column_runs(streams.missing, everywhere, count, model.missing_run)
    kind[missing] = PointOrigin.MISSING

    distance += correlated_noise(streams.noise, model.columns, model.noise, model.noise_correlation)
    x_s = distance * hits.directions_s[:, 0]
    z_s = model.emitter_z + distance * hits.directions_s[:, 2]
    if distortion is not None:
        x_s, z_s = distortion.distort(x_s, z_s)
    x_s, z_s = round_to_steps(x_s, model.step), round_to_steps(z_s, model.step)
    kind[~((z_s >= model.near) & (z_s <= model.far))] = PointOrigin.MISSING
    gone = kind == PointOrigin.MISSING
    x_s[gone], z_s[gone], intensity[gone] = np.nan, np.nan, 0.0
    return SimulatedProfile(x_s, z_s, intensity, kind)


def correlated_noise(rng: Generator, count: int, sigma: float, correlation: float) -> Array:
    """Stationary Gaussian noise, shape (count,): each value has standard deviation `sigma`.

    White noise through a Gaussian window of unit energy. Two values k apart correlate by
    ``exp(-(k / correlation)**2)``.
    """
    if sigma == 0:
        return np.zeros(count)
    reach = int(np.ceil(2.0 * correlation))
    lag = np.arange(-reach, reach + 1)
    window = np.exp(-2.0 * (lag / correlation) ** 2) if reach else np.ones(1)
    white = rng.standard_normal(count + 2 * reach)
    return np.asarray(np.convolve(white, sigma / np.linalg.norm(window) * window, mode="valid"))


def choose_column_runs(
    rng: Generator, eligible: NDArray[np.intp], count: int, run: tuple[int, int]
) -> NDArray[np.intp]:
    """Choose `count` of the eligible columns, in runs of random length and place.

    Parameters
    ----------
    eligible : ndarray of int, shape (m,)
        Columns to choose from, rising.
    count : int
        How many; all of them if there are no more.
    run : tuple of int
        Shortest and longest run. The last may come out shorter, and runs touch if there is
        no room between them.

    Returns
    -------
    ndarray of int, shape (min(count, m),)
        The columns chosen, rising.
    """
    count = min(count, len(eligible))
    if count == 0:
        return eligible[:0]
    shortest, longest = run
    lengths = rng.integers(shortest, longest + 1, size=-(-count // shortest))
    runs = int(np.searchsorted(np.cumsum(lengths), count)) + 1
    lengths = lengths[:runs]
    lengths[-1] -= lengths.sum() - count
    # Each run goes into one of the slots between the columns left over, so runs don't touch.
    slots = len(eligible) - count + 1
    before = np.sort(rng.choice(slots, size=runs, replace=runs > slots))
    first = before + np.cumsum(lengths) - lengths
    inside = np.arange(count) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return np.asarray(eligible[np.repeat(first, lengths) + inside])


def _incidence_bias(cosine: Array, model: LaserModel) -> Array:
    """Excess of the range, growing with the tangent of the incidence up to its limit."""
    if model.bias == 0:
        return np.zeros_like(cosine)
    tangent = np.sqrt(1.0 - cosine**2) / np.maximum(cosine, 1e-9)
    return np.minimum(model.bias * tangent, model.bias_limit)


def _columns_lost_to_grazing(cosine: Array, model: LaserModel, rng: Generator) -> Mask:
    """Columns that lose their point to a grazing incidence."""
    ramp = (np.arccos(cosine) - model.dropout_start) / (model.dropout_end - model.dropout_start)
    return np.asarray(rng.random(len(cosine)) < model.dropout * np.clip(ramp, 0.0, 1.0))


def _draw_mirror_image_columns(
    hits: LaserRayHits, model: LaserModel, rng: Generator
) -> NDArray[np.intp]:
    """Columns that show the mirror image instead of the face."""
    if model.ghosts == 0:
        return np.empty(0, dtype=np.intp)
    possible = np.flatnonzero(np.isfinite(hits.ghost))
    wanted = model.ghosts * np.count_nonzero(hits.seen)
    count = round_randomly(min(wanted, model.ghost_share * len(possible)), rng)
    return choose_column_runs(rng, possible, count, model.ghost_run)


def _flying_point_distances(hits: LaserRayHits, model: LaserModel, rng: Generator) -> Array:
    """Distances of the points that fly, NaN for the others, shape (n,).

    They are somewhere between the two sides of an edge, and miss that span at random.
    """
    columns = model.columns
    flies = rng.random(columns) < model.flyers
    share, overshoot = rng.random(columns), rng.normal(size=columns) * model.flyer_overshoot
    edge = _edges_between_columns(hits, model)
    right, left = np.append(edge, False), np.append(False, edge)
    flies &= hits.seen & (right | left)
    index = np.flatnonzero(flies)
    other = np.where(right[index], index + 1, index - 1)
    flying = np.full(columns, np.nan)
    span = hits.distance[other] - hits.distance[index]
    flying[index] = hits.distance[index] + share[index] * span + overshoot[index]
    return flying


def _stray_points(
    hits: LaserRayHits, model: LaserModel, rng: Generator
) -> tuple[NDArray[np.intp], Array]:
    """Columns that stray, rising, and how far along their rays; one distance for each run."""
    possible = np.flatnonzero(hits.seen)
    count = round_randomly(model.strays * len(possible), rng)
    strays = choose_column_runs(rng, possible, count, model.stray_run)
    run = np.cumsum(np.diff(strays, prepend=-2) > 1) - 1
    runs = int(run[-1]) + 1 if len(run) else 0
    offsets = rng.choice((-1.0, 1.0), runs) * rng.uniform(*model.stray_offset, runs)
    return strays, np.asarray(offsets[run])


def _interreflection_pulls(hits: LaserRayHits, model: LaserModel) -> Array:
    """How far each point is pulled towards the sensor, shape (n,).

    Light that one face throws onto the other fills a notch. The pull is largest at the notch
    and falls as a raised cosine of the distance from it. (Assumption: what real profiles show.)
    """
    pull = np.zeros_like(hits.distance)
    if model.interreflection == 0:
        return pull
    hit = np.isfinite(hits.distance)
    points = np.where(hit, hits.distance, 0.0)[:, None] * hits.directions_s
    turn = np.einsum("ij,ij->i", hits.normals_s[:-1], hits.normals_s[1:])
    towards = np.einsum("ij,ij->i", np.diff(points, axis=0), np.diff(hits.normals_s, axis=0)) < 0
    notches = (turn < np.cos(model.notch)) & towards & hit[:-1] & hit[1:]
    for i in np.flatnonzero(notches):
        away = np.linalg.norm(points - (points[i] + points[i + 1]) / 2, axis=1)
        share = np.clip(away / model.interreflection_reach, 0.0, 1.0)
        np.maximum(pull, model.interreflection * 0.5 * (1 + np.cos(np.pi * share)), out=pull)
    return np.where(hit, pull, 0.0)


def _edges_between_columns(hits: LaserRayHits, model: LaserModel) -> Mask:
    """Whether a crease or a jump is between each column and the next, shape (n - 1,)."""
    hit = np.isfinite(hits.distance)
    points = np.where(hit, hits.distance, 0.0)[:, None] * hits.directions_s
    normals = hits.normals_s
    step = np.diff(points, axis=0)
    away = np.maximum(
        np.abs(np.einsum("ij,ij->i", step, normals[:-1])),
        np.abs(np.einsum("ij,ij->i", step, normals[1:])),
    )
    turn = np.einsum("ij,ij->i", normals[:-1], normals[1:])
    edge = (turn < np.cos(model.flyer_crease)) | (away > model.flyer_jump)
    return np.asarray(edge & hit[:-1] & hit[1:])


def round_to_steps(values: Array, step: float) -> Array:
    """Values rounded to whole steps."""
    return np.asarray(np.round(values / step) * step) if step > 0 else values


def round_randomly(expected: float, rng: Generator) -> int:
    """Whole number whose mean is `expected`."""
    return int(expected + rng.random())
