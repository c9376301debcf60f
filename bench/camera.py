"""What of the paper's corner error is its reference's: a scan against a simulated 3D camera.

Cibicik et al. (2022) hold the corners of their scans against the cloud of one view of a structured-
light camera: 0.49 mm in the mean. Here such a camera looks at the same simulated joint, and
``compare`` of this program aligns and measures (closest points). Errors are added one after
another, first of the camera alone with a scan that is exact, then of the scanner alone against the
designed edges, then of both. Corners count where the view has points at all three edges of the
groove, which is less than the paper's segment of about 140°. ``--quick`` takes one cell in place of
four.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from math import radians
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import trimesh
from _table import Row, main
from scan import FAULTLESS
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from tjscan.comparison.compare import compare_shapes
from tjscan.comparison.shapes import Shape, UserUnitAndFrame
from tjscan.core.frames import Array, Mask, inverse_pose, pose, transform_points
from tjscan.core.units import pose_from_rows_mm, pose_to_rows_mm
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.joint.file import read_joint
from tjscan.joint.mesh import build_joint_mesh
from tjscan.laser.optics import RaycastSurface
from tjscan.result.shapes import read_shape
from tjscan.runs.scan.run import ScanContext, run_scan

ROOT: Final = Path(__file__).resolve().parents[1]
JOB, CAD = ROOT / "examples" / "paper.toml", ROOT / "cad" / "tjoint-600x457.toml"
PAPER_MM: Final = 0.49
MIDDLE: Final = radians(57)
"""Azimuth of the middle of the arc that the example scans."""

ELEVATION: Final = radians(10)
"""From which a camera sees the sides and the root of this groove furthest round."""

SEGMENT: Final = radians(140)
"""Arc that the paper scans, about the middle."""

SEEN_MARGIN: Final = 0.1
"""Metres about the groove that are kept of a cloud."""

PLACED_OFF: Final = pose(
    Rotation.from_euler("xyz", (0.3, -0.2, 0.3), degrees=True).as_matrix(), (2e-3, -1e-3, 2e-3)
)
"""By which a cloud is off before it is aligned."""

ARM_ERRORS: Final = {"offset_deg": 0.007, "length_mm": 0.075, "twist_deg": 0.007}
MOUNT_SIGMA: Final = (1e-4, radians(0.03))
"""Of T_f_s, in each direction and about each axis: as a calibration states it."""


@dataclass(frozen=True)
class Camera:
    """Camera and projector of structured light. Metres, radians.

    The size of the field, the points and the noise are of the class of the paper's Zivid Two;
    **all are assumptions**.

    Parameters
    ----------
    points : tuple of int
        Along the field and across it.
    field : tuple of float
        Its size at the distance `focus`.
    baseline : float
        From camera to projector. What one of them does not see has no point.
    steepest : float
        Incidence beyond which no point is measured.
    noise : float
        Standard deviation of a point along its ray at `focus`; it grows with the square of the
        distance and with the incidence.
    scale : float
        Largest share by which all of a cloud is too large.
    notch, notch_reach : float
        How far light from one side of the groove onto the other pulls the root towards the
        camera, and within what distance.
    """

    points: tuple[int, int] = (1944, 1200)
    field: tuple[float, float] = (0.754, 0.449)
    focus: float = 0.7
    distance: float = 0.75
    baseline: float = 0.11
    steepest: float = radians(75)
    noise: float = 0.0
    scale: float = 0.0
    notch: float = 0.0
    notch_reach: float = 4e-3

    def rays_c(self, looked_at_c: Array) -> Array:
        """Unit rays (z ahead) that may meet what the camera looks at, shape (n, 3)."""
        extent = looked_at_c[:, :2] / looked_at_c[:, 2:]
        x, y = (
            tangents[(tangents > low) & (tangents < high)]
            for tangents, low, high in zip(
                (
                    np.linspace(-0.5, 0.5, n) * size / self.focus
                    for n, size in zip(self.points, self.field, strict=True)
                ),
                extent.min(axis=0) - SEEN_MARGIN,
                extent.max(axis=0) + SEEN_MARGIN,
                strict=True,
            )
        )
        rays = np.stack((*np.meshgrid(x, y), np.ones((len(y), len(x)))), axis=-1).reshape(-1, 3)
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


@dataclass
class Stage:
    """The joint that camera and laser look at, in frame j.

    `seen` is from where to where, as azimuths from the middle, a view without errors has points
    within two of their spacings of all three edges; `unseen` the share of the paper's segment where
    it has not.
    """

    surface: RaycastSurface = field(init=False)
    edges: KDTree = field(init=False)
    root: KDTree = field(init=False)
    middle: Array = field(init=False)
    spacing: float = field(init=False)
    seen: tuple[float, float] = field(init=False)
    unseen: float = field(init=False)

    def __post_init__(self) -> None:
        joint = read_joint(CAD)
        mesh = build_joint_mesh(joint)
        self.surface = RaycastSurface(mesh.vertices, mesh.triangles)
        found = feature_edges(joint)
        turn = np.angle(np.exp(1j * (found.phi - MIDDLE)))
        near = np.abs(turn) < radians(85)
        self.edges = KDTree(found.p2.points_j[near])
        self.root = KDTree(np.concatenate([e.points_j[near] for e in (found.p3, found.p4)]))
        self.middle = found.p3.points_j[np.argmin(np.abs(found.phi - MIDDLE))]
        cloud = KDTree(self.cloud_j(Camera(), np.random.default_rng(0)))
        self.spacing = float(np.median(np.asarray(cloud.query(cloud.data[::20], k=2)[0])[:, 1]))
        gaps = [np.asarray(cloud.query(e.points_j)[0]) for e in (found.p2, found.p3, found.p4)]
        blind = np.max(gaps, axis=0) > 2 * self.spacing
        self.seen = turn[blind & (turn < 0)].max(), turn[blind & (turn > 0)].min()
        self.unseen = float(np.mean(blind[np.abs(turn) < SEGMENT / 2]))

    def is_seen(self, points_j: Array) -> Mask:
        """Whether points, shape (n, 3), are at azimuths where a view sees the groove, (n,)."""
        turn = np.angle(np.exp(1j * (np.arctan2(points_j[:, 1], points_j[:, 0]) - MIDDLE)))
        return np.asarray((turn > self.seen[0]) & (turn < self.seen[1]))

    def cloud_j(self, camera: Camera, rng: np.random.Generator) -> Array:
        """What a camera measures of the groove, in frame j, shape (n, 3)."""
        T = self._camera_pose(camera)
        eye = T[:3, 3]
        rays_c = camera.rays_c(transform_points(inverse_pose(T), self.edges.data))
        rays = rays_c @ T[:3, :3].T
        hits = self.surface.cast_rays(np.broadcast_to(eye, rays.shape), rays)
        far = np.where(np.isfinite(hits.distance), hits.distance, 0.0)
        points = eye + far[:, None] * rays
        near = (far > 0) & np.isfinite(
            self.edges.query(points, distance_upper_bound=SEEN_MARGIN)[0]
        )
        far, points, rays_c = far[near], points[near], rays_c[near]
        normals = hits.normals[near]
        cosine = -np.einsum("ij,ij->i", normals, rays[near])
        projector = transform_points(T, np.array((camera.baseline, 0.0, 0.0)))
        lit = ~self.surface.is_hidden_from(points, normals, projector)
        seen = lit & (cosine > np.cos(camera.steepest))
        off = camera.noise * (far / camera.focus) ** 2 / np.maximum(cosine, 0.1)
        off = off * rng.standard_normal(len(far))
        if camera.notch:
            aside = self.root.query(points)[0] / camera.notch_reach
            off -= camera.notch * np.exp(-(aside**2))
        scale = 1 + camera.scale * rng.uniform(-1, 1)
        found_c = scale * (far + off)[seen, None] * rays_c[seen]
        return np.asarray(transform_points(T, found_c))

    def _camera_pose(self, camera: Camera) -> Array:
        """Pose T_j_c of a camera that looks at the groove from outside."""
        away = float(np.hypot(*self.middle[:2]))
        around = np.array((np.cos(MIDDLE), np.sin(MIDDLE), 0.0))
        out = np.cos(ELEVATION) * around + (0.0, 0.0, np.sin(ELEVATION))
        x = np.cross(-out, (0.0, 0.0, 1.0))
        x /= np.linalg.norm(x)
        at = away * around + (0.0, 0.0, self.middle[2])
        return pose(np.column_stack((x, np.cross(-out, x), -out)), at + camera.distance * out)


EXACT: Final = Camera()
NOISY: Final = replace(EXACT, noise=55e-6)
SCALED: Final = replace(NOISY, scale=2e-3)
SHINY: Final = replace(SCALED, notch=0.5e-3)
CAMERAS: Final = {
    "exact": EXACT,
    "with noise of 0.055 mm": NOISY,
    "… and up to 0.2 % too large or small": SCALED,
    "… and light between the sides, 0.5 mm": SHINY,
}


def scanners(seed: int) -> dict[str, dict[str, Any]]:
    """Keys of scans by what is off in the cell."""
    job = read_scan_job(JOB)
    if job.simulation is None or job.simulation.T_f_s_mm is None:
        raise SystemExit(f"{JOB} states no true T_f_s")
    rng = np.random.default_rng(seed)
    shift, angle = (sigma * rng.standard_normal(3) for sigma in MOUNT_SIGMA)
    true = pose_from_rows_mm(job.simulation.T_f_s_mm)

    def off(times: float) -> dict[str, Any]:
        turn = Rotation.from_rotvec(times * angle).as_matrix()
        return {
            "simulation.T_f_s_mm": pose_to_rows_mm(true @ pose(turn, times * shift)),
            "simulation.laser.linearity_mm": times * 0.1,
            **{f"simulation.arm.errors.{key}": times * value for key, value in ARM_ERRORS.items()},
        }

    return {
        "exact": dict(FAULTLESS),
        "with the laser's faults": {},
        "… and an arm, a laser and T_f_s that are off": off(1),
        "… and these three times as far off": off(3),
    }


def scan(keys: dict[str, Any], seed: int, folder: Path) -> Path:
    """Scan the example; gives the run directory."""
    job = read_scan_job(JOB, keys | {"simulation.seed": seed})
    directory = folder / f"run-{len(list(folder.iterdir()))}"
    run_scan(ScanContext(job, JOB), directory)
    return directory


def mean_corner_distance(run: Path, reference: Path, stage: Stage) -> float:
    """Of the corners of an aligned scan from its reference, where a stage's camera sees, mm."""
    whole, stated = read_shape(run), UserUnitAndFrame(frame="c")
    if whole.points is None or whole.corners is None:
        raise SystemExit(f"{run} holds no scan")
    points, corners = whole.points[stage.is_seen(whole.points)], stage.is_seen(whole.corners[:, 2])
    part = Shape(whole.name, whole.stated, points, whole.corners[corners])
    found = compare_shapes(part, read_shape(reference, stated), "icp")
    return next(d.statistics.mean for d in found.deviations if d.kind.startswith("corners"))


def write_cloud(points_j: Array, file: Path) -> Path:
    """Write a cloud as a camera's program does: in millimetres, in its own frame."""
    points = 1e3 * transform_points(inverse_pose(PLACED_OFF), points_j)
    trimesh.PointCloud(points).export(file)
    file.with_suffix(".json").write_text('{"units": "mm", "frame": "c"}', encoding="utf-8")
    return file


def measure(seeds: range) -> Iterator[Row]:
    """Rows of the bench."""
    stage = Stage()
    yield Row("camera: spacing of its points, median", 1e3 * stage.spacing, np.inf, "mm")
    seen = np.degrees(stage.seen[1] - stage.seen[0])
    yield Row("… arc where it has points at all three edges", float(seen), np.inf, "°")
    yield Row("… share of the paper's 140° where it has not", 100 * stage.unseen, np.inf, "%")
    with TemporaryDirectory() as name:
        folder = Path(name)
        scans = {
            what: [scan(scanners(seed)[what], seed, folder) for seed in seeds]
            for what in scanners(0)
        }
        clouds: dict[str, list[Path]] = {}
        for what, camera in CAMERAS.items():
            every = (stage.cloud_j(camera, np.random.default_rng(seed)) for seed in seeds)
            clouds[what] = [
                write_cloud(cloud, folder / f"{len(clouds)}-{i}.ply")
                for i, cloud in enumerate(every)
            ]

        def mean(scanner: str, references: list[Path]) -> float:
            pairs = zip(scans[scanner], references, strict=True)
            return float(np.mean([mean_corner_distance(*pair, stage) for pair in pairs]))

        for what in CAMERAS:
            yield Row(f"scan exact; camera {what}", mean("exact", clouds[what]), np.inf, "mm")
        for what in scans:
            yield Row(f"scan {what}; designed edges", mean(what, [CAD] * len(seeds)), np.inf, "mm")
        for what in list(scans)[2:]:
            for label in list(CAMERAS)[2:]:
                both = mean(what, clouds[label])
                yield Row(f"scan {what}; camera {label}", both, np.inf, "mm")
    yield Row("the paper's scans and camera", PAPER_MM, np.inf, "mm")


if __name__ == "__main__":
    SEEDS = range(1, 2) if "--quick" in sys.argv else range(1, 5)
    ARGUMENTS = [word for word in sys.argv[1:] if word != "--quick"]
    sys.exit(main("A scan against a 3D camera", partial(measure, SEEDS), ARGUMENTS))
