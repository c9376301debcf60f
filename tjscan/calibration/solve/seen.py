"""What was seen of each kind of target, and starts for solving with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Generic, Protocol, Self, TypeVar

import numpy as np

from tjscan.calibration.fits.line import LineFit
from tjscan.calibration.fits.line_bundle import stack_lines
from tjscan.calibration.fits.samples import ArcSample, LineSample, RoofSample
from tjscan.calibration.models.linearised import MovableTargetModel
from tjscan.calibration.models.plane import PlaneModel
from tjscan.calibration.models.roof import RoofModel
from tjscan.calibration.models.sphere import SphereModel
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.plucker import PluckerPlane
from tjscan.calibration.solve.closed_form import sensor_on_flange_side_share, solve_closed_form
from tjscan.calibration.solve.starts import (
    plane_calibration_starts,
    sphere_calibration_starts,
    sphere_start_parameters,
)
from tjscan.calibration.targets import PlaneTarget, RoofTarget, SphereTarget
from tjscan.core.frames import Array, transform_points

REFINED_STARTS: Final = 12
"""Starts refined for an unknown plane."""

Sample = TypeVar("Sample", LineSample, ArcSample, RoofSample)


@dataclass(frozen=True, slots=True, eq=False)
class TargetStart:
    """A model of a target near where it may be, and its parameters to start with.

    Parameters
    ----------
    model : MovableTargetModel
        Of the profiles.
    target : ndarray, shape (m,)
        The target's parameters.
    """

    model: MovableTargetModel
    target: Array


class SeenTarget(Protocol):
    """Profiles of one target, and how to begin with them."""

    @property
    def names(self) -> list[str]:
        """Of the profiles."""
        ...

    @property
    def T_b_f(self) -> Array:
        """Flange poses of the profiles, shape (n, 4, 4)."""
        ...

    @property
    def kind(self) -> str:
        """What the result calls it: its method."""
        ...

    def with_poses(self, T_b_f: Array) -> Self:
        """The same profiles from other flange poses, shape (n, 4, 4)."""
        ...

    def starts(self) -> list[Array]:
        """Where the sensor may sit, T_f_s each, shape (4, 4), from these profiles alone."""
        ...

    def start_at(self, T_f_s: Array) -> TargetStart:
        """Where the target is, if the sensor sits at T_f_s, shape (4, 4)."""
        ...

    def is_behind(self, start: TargetStart, T_f_s: Array, target: Array) -> bool:
        """Whether the sensor would look at the target from behind: a mirror image."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class SeenProfiles(Generic[Sample]):
    """Profiles of one target, of whichever kind.

    Parameters
    ----------
    samples : sequence of LineSample, ArcSample or RoofSample
        What each profile shows.
    """

    samples: Sequence[Sample]

    @property
    def names(self) -> list[str]:
        """Of the profiles."""
        return [sample.name for sample in self.samples]

    @property
    def T_b_f(self) -> Array:
        """Flange poses of the profiles, shape (n, 4, 4)."""
        return np.stack([sample.T_b_f for sample in self.samples])

    def with_poses(self, T_b_f: Array) -> Self:
        """The same profiles from other flange poses, shape (n, 4, 4)."""
        samples = [replace(s, T_b_f=T) for s, T in zip(self.samples, T_b_f, strict=True)]
        return replace(self, samples=samples)

    @property
    def by_laser(self) -> Array | None:
        """As the samples have it, shape (n, k, m); none where one has none."""
        return _all_or_none([sample.by_laser for sample in self.samples])


@dataclass(frozen=True, slots=True, eq=False)
class SeenBoard(SeenProfiles[LineSample]):
    """Lines on a board, touched or unknown.

    Parameters
    ----------
    samples : sequence of LineSample
        The lines.
    target : PlaneTarget or None
        The plane as touched; none where it is unknown.
    noise : NoiseModel
        What they err by.
    """

    target: PlaneTarget | None
    noise: NoiseModel

    @property
    def fits(self) -> list[LineFit]:
        """The lines."""
        return [sample.fit for sample in self.samples]

    @property
    def kind(self) -> str:
        """``plane touched`` or ``plane unknown``."""
        return "plane unknown" if self.target is None else "plane touched"

    def starts(self) -> list[Array]:
        """By the closed form; for an unknown plane, by the closed form for many normals."""
        lines = stack_lines(self.T_b_f, self.fits)
        if self.target is not None:
            return [solve_closed_form(lines, self.target.plane).T_f_s]
        return [T for T, _ in plane_calibration_starts(lines, REFINED_STARTS)]

    def start_at(self, T_f_s: Array) -> TargetStart:
        """The plane as touched, or through all points."""
        target = self.target or _plane_through(self.T_b_f, self.fits, T_f_s)
        return TargetStart(
            PlaneModel.from_line_fits(
                self.T_b_f,
                self.fits,
                target,
                self.noise,
                self.by_laser,
                _all_or_none([sample.by_arm for sample in self.samples]),
            ),
            np.zeros(3),
        )

    def is_behind(self, start: TargetStart, T_f_s: Array, target: Array) -> bool:
        """Whether sensor and flange stand on different sides of an unknown plane."""
        model = start.model
        if self.target is not None or not isinstance(model, PlaneModel):
            return False
        plane = model.target.boxplus(target)
        return sensor_on_flange_side_share(model.lines, plane, T_f_s[:3, 3]) < 0.5


@dataclass(frozen=True, slots=True, eq=False)
class SeenBall(SeenProfiles[ArcSample]):
    """Arcs on a ball.

    Parameters
    ----------
    samples : sequence of ArcSample
        The arcs.
    sphere : SphereTarget
        The ball.
    noise : NoiseModel
        What they err by.
    """

    sphere: SphereTarget
    noise: NoiseModel

    @property
    def kind(self) -> str:
        """``sphere of known radius`` or ``sphere of unknown radius``."""
        return f"sphere of {'un' if self.sphere.radius is None else ''}known radius"

    @property
    def model(self) -> SphereModel:
        """The same wherever the sensor may sit."""
        fits = [sample.fit for sample in self.samples]
        return SphereModel.from_arc_fits(self.T_b_f, fits, self.sphere, self.noise, self.by_laser)

    def starts(self) -> list[Array]:
        """One for each way to turn a cube."""
        return [T for T, _ in sphere_calibration_starts(self.model)]

    def start_at(self, T_f_s: Array) -> TargetStart:
        """The ball about the centres of all arcs."""
        model = self.model
        centres = np.einsum("nij,nj->ni", (model.T_b_f @ T_f_s)[:, :3], _ones(model.centres_s))
        return TargetStart(model, sphere_start_parameters(model, centres.mean(axis=0)))

    def is_behind(self, start: TargetStart, T_f_s: Array, target: Array) -> bool:
        """Never: an arc shows its side."""
        return False


@dataclass(frozen=True, slots=True, eq=False)
class SeenRoof(SeenProfiles[RoofSample]):
    """Pairs of lines on the two planes of a roof edge.

    Parameters
    ----------
    samples : sequence of RoofSample
        The pairs of lines.
    noise : NoiseModel
        What they err by.
    """

    noise: NoiseModel

    @property
    def kind(self) -> str:
        """``roof edge``."""
        return "roof edge"

    def starts(self) -> list[Array]:
        """From the lines on either plane, as if it were an unknown board."""
        flanks = ([s.fit.left for s in self.samples], [s.fit.right for s in self.samples])
        return [
            T
            for fits in flanks
            for T, _ in plane_calibration_starts(stack_lines(self.T_b_f, fits), REFINED_STARTS)
        ]

    def start_at(self, T_f_s: Array) -> TargetStart:
        """The planes through all points."""
        fits = [sample.fit for sample in self.samples]
        left, right = (
            _plane_through(self.T_b_f, flank, T_f_s)
            for flank in ([fit.left for fit in fits], [fit.right for fit in fits])
        )
        model = RoofModel.from_roof_fits(
            self.T_b_f, fits, RoofTarget(left, right), self.noise, self.by_laser
        )
        return TargetStart(model, np.zeros(6))

    def is_behind(self, start: TargetStart, T_f_s: Array, target: Array) -> bool:
        """Never: a mirror image fits no two planes that meet."""
        return False


def _all_or_none(each: list[Array | None]) -> Array | None:
    known = [one for one in each if one is not None]
    return np.stack(known) if known and len(known) == len(each) else None


def _plane_through(T_b_f: Array, fits: list[LineFit], T_f_s: Array) -> PlaneTarget:
    """The plane through both ends of all lines, its normal towards the flange."""
    ends = np.stack(
        [
            transform_points(
                T, [fit.point_s + side * fit.span * fit.direction_s for side in (-0.5, 0.5)]
            )
            for T, fit in zip(T_b_f @ T_f_s, fits, strict=True)
        ]
    ).reshape(-1, 3)
    centre = ends.mean(axis=0)
    u = np.linalg.svd(ends - centre)[2][2]
    if u @ (T_b_f[:, :3, 3].mean(axis=0) - centre) < 0:
        u = -u
    near = (T_b_f[0] @ T_f_s @ np.append(fits[0].point_s, 1.0))[:3]
    return PlaneTarget.unknown_plane(PluckerPlane(u, -float(u @ centre)), near)


def _ones(points: Array) -> Array:
    return np.column_stack((points, np.ones(len(points))))
