"""Every reader of files, and small whole files for each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from _fuzz import Reader

from tjscan.calibration.file import CalibrationFile, read_calibration, write_calibration
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.pose_files import read_flange_poses, read_points
from tjscan.calibration.targets.target import PosedProfile
from tjscan.calibration.wizard.logbook import (
    BoardTouch,
    LaserLineTaken,
    Logbook,
    SkippedPose,
    read_calibration_entries,
)
from tjscan.cli.options.shared import parse_overrides
from tjscan.comparison.shapes import UserUnitAndFrame
from tjscan.core.config import validate_table
from tjscan.core.provenance import Provenance
from tjscan.groove.settings import DEFAULT_SETTINGS
from tjscan.job.crawl.job import read_crawl_job
from tjscan.job.files import read_calibration_job, read_scan_job
from tjscan.job.tow.job import read_tow_job
from tjscan.joint.export import build_and_write_joint
from tjscan.joint.file import read_joint
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.laser.profile import Profile
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import RunEvent
from tjscan.recording.reader import read_job_snapshot
from tjscan.result.readings import measure_grooves
from tjscan.result.shapes import read_shape
from tjscan.result.summary import read_summary
from tjscan.result.table import read_sections_csv
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.scan.run import ScanContext, run_scan
from tjscan.runs.scan.study import ScanOutcome
from tjscan.runs.tasks import study_backend_of_task
from tjscan.scanning.recording import ScanRecordingWriter, read_recorded_scan
from tjscan.scanning.section import ScannedSection
from tjscan.study.file import read_study_file
from tjscan.study.plan import plan_study, read_plan
from tjscan.study.rows import STUDY_ROWS_FILE, StudyRows
from tjscan.study.run import PLAN_FILE, make_study_directory, row_of_trial

ROOT: Final = Path(__file__).resolve().parents[1]
EXAMPLES, CAD = ROOT / "examples", ROOT / "cad"
OLD: Final = ROOT / "tests" / "data" / "run-0.1.0" / "scan.mcap"
EVERY: Final = 26
"""Points left out of profiles that need but a few."""


class _Sections:
    """A journal that keeps the sections and their views."""

    def __init__(self) -> None:
        self.scans: list[ScannedSection] = []

    def record(self, message: object) -> None:
        if isinstance(message, ScannedSection):
            self.scans.append(message)


def readers(folder: Path) -> Iterator[Reader]:
    """Every reader with whole files, which are made in a folder."""
    run, sections = folder / "run", _Sections()
    job = read_scan_job(EXAMPLES / "paper.toml", {"scan.sections": 3})
    run_scan(ScanContext(job, EXAMPLES / "paper.toml", sections), run)
    yield from _configurations(folder, run)
    yield from _recordings(folder, run, sections.scans)
    yield from _profiles(sections.scans[-1].view.profile)
    yield from _tables(run)
    yield from _studies(folder)
    yield from _shapes(folder)


def _configurations(folder: Path, run: Path) -> Iterator[Reader]:
    jobs = [(EXAMPLES / name).read_bytes() for name in ("paper.toml", "ur10e.toml")]
    resolved = (run / "job.toml").read_bytes()
    yield Reader("job", "job.toml", (*jobs, resolved), read_scan_job, 3)
    calibrate = (EXAMPLES / "calibrate.toml").read_bytes()
    yield Reader("calibration job", "job.toml", (calibrate,), read_calibration_job, 0.5)
    crawls = ((EXAMPLES / "crawl.toml").read_bytes(),)
    yield Reader("crawl job", "crawl.toml", crawls, read_crawl_job, 2)
    tows = ((EXAMPLES / "tow-simulation.toml").read_bytes(),)
    yield Reader("tow job", "tow.toml", tows, read_tow_job, 2)
    joints = tuple(file.read_bytes() for file in sorted(CAD.glob("*.toml")))
    yield Reader("joint", "joint.toml", joints, read_joint, 3)
    yield Reader("calibration", "calibration.toml", (_calibration(folder),), read_calibration, 3)
    yield Reader("options", "options", (b"--scan.step-mm\n20\n--groove.noise-mm=0.1",), _options, 2)
    urdf = Kinematics.load("ur10e").urdf.read_bytes()
    yield Reader("arm", "arm.urdf", (urdf,), lambda f: Kinematics.load(str(f)))


def _options(file: Path) -> None:
    tokens = file.read_bytes().decode(errors="surrogateescape").split("\n")
    read_scan_job(EXAMPLES / "paper.toml", parse_overrides(tokens))


def _recordings(folder: Path, run: Path, scans: list[ScannedSection]) -> Iterator[Reader]:
    whole = (*(_recording(folder / f"{i}.mcap", scans, i) for i in range(2)), OLD.read_bytes())

    def read(file: Path) -> None:
        read_job_snapshot(file.parent)
        read_recorded_scan(file.parent).reread_sections(
            lambda profile, *, prior=None: scans[0].groove
        )

    yield Reader("recording", "scan.mcap", whole, read, 6)
    with Logbook(folder, np.eye(4)) as book:
        T, profile = scans[0].view.T_b_f, _short(scans[0].view.profile)
        for entry in (
            BoardTouch(0, T),
            LaserLineTaken(PosedProfile("line 1", T, profile)),
            SkippedPose(T, "no line"),
        ):
            book.record(entry)
    measured = (folder / "measured.mcap").read_bytes()
    yield Reader("calibration recording", "measured.mcap", (measured,), _measured, 2)


def _measured(file: Path) -> None:
    list(read_calibration_entries(file.parent))


def _recording(file: Path, scans: list[ScannedSection], seed: int) -> bytes:
    """A recording of profiles with few points."""
    with ScanRecordingWriter(
        file, JobSnapshot('[scan]\nstep_mm = 40.0\n[arm]\nmodel = "x"\n')
    ) as recording:
        for scan in scans:
            short = replace(scan, view=replace(scan.view, profile=_short(scan.view.profile)))
            recording.record(short.view)
            recording.record(RunEvent("half step", f"section {seed}"))
            recording.record(short)
    return file.read_bytes()


def _short(profile: Profile) -> Profile:
    return Profile(profile.x_s[::EVERY], profile.z_s[::EVERY], time=profile.time)


def _profiles(profile: Profile) -> Iterator[Reader]:
    x, z = 1e3 * profile.x_s[::EVERY], 1e3 * profile.z_s[::EVERY]
    rows = [f"{i % 2},{a:.4f},{b:.4f}" for i, (a, b) in enumerate(zip(x, z, strict=True))]
    columns = "\n".join(["profile,x_mm,z_mm", *rows]).encode()
    matrix = "\n".join(3 * [",".join(f"{v:.3f}" for v in z)]).encode()
    form = ProfileFormat("mm", 0.5, (-99.0,))
    read = partial(read_profiles, form=form)
    yield Reader("profiles", "profiles.csv", (columns, matrix), read, 4)
    stream = BytesIO()
    np.save(stream, np.column_stack((x, z)))
    yield Reader("profile NPY", "profile.npy", (stream.getvalue(),), read, 2)
    points = trimesh.PointCloud(np.column_stack((x, np.zeros(len(x)), z))[np.isfinite(x)])
    ply = points.export(file_type="ply")
    yield Reader("profile PLY", "profile.ply", (ply,), read, 1)
    full = 1e3 * np.column_stack((profile.x_s, profile.z_s))[::3]
    lines = "\n".join(["x_mm,z_mm", *(f"{a:.4f},{b:.4f}" for a, b in full)]).encode()

    def groove(file: Path) -> None:
        table = read_profiles(file, form)
        list(measure_grooves(table.profiles, DEFAULT_SETTINGS))

    yield Reader("groove", "groove.csv", (lines,), groove, 0.15)


def _tables(run: Path) -> Iterator[Reader]:
    quaternions = "profile,x_mm,y_mm,z_mm,qx,qy,qz,qw\n1,1,2,3,0,0,0,1\n2,3,4,5,0,0.6,0,0.8\n"
    angles = "x_m,y_m,z_m,a_deg,b_deg,c_deg\n1,2,3,4,5,6\n2,3,4,5,6,7\n"
    yield Reader(
        "poses", "poses.csv", (quaternions.encode(), angles.encode()), read_flange_poses, 4
    )
    points = b"x_mm,y_mm,z_mm\n1,2,3\n4,5,6\n7,8,10\n"
    yield Reader("touched points", "points.csv", (points,), read_points, 4)
    sections = (run / "sections.csv").read_bytes()
    yield Reader("sections", "sections.csv", (sections,), read_sections_csv, 4)
    summary = (run / "summary.json").read_bytes()
    yield Reader("summary", "summary.json", (summary,), read_summary, 4)

    def whole_run(file: Path) -> None:
        for name in ("sections.csv", "summary.json", "groove.ply"):
            if not (file.parent / name).exists():
                (file.parent / name).write_bytes((run / name).read_bytes())
        read_shape(file.parent)

    for name in ("sections.csv", "summary.json", "groove.ply"):
        seed = (run / name).read_bytes()
        yield Reader(f"run: {name}", f"run/{name}", (seed,), whole_run, 0.5)


def _studies(folder: Path) -> Iterator[Reader]:
    studies = tuple((EXAMPLES / f"{name}-study.toml").read_bytes() for name in ("paper", "joints"))
    yield Reader(
        "study", "study.toml", studies, lambda f: read_study_file(f, study_backend_of_task), 2
    )
    file = folder / "study.toml"
    file.write_text(
        f'job = "{EXAMPLES / "paper.toml"}"\n[grid]\nscan.step_mm = [40.0, 50.0]\n',
        encoding="utf-8",
    )
    trials = plan_study(file, study_backend_of_task)
    make_study_directory(folder / "study", trials)
    plan = (folder / "study" / PLAN_FILE).read_bytes()
    yield Reader("plan", f"study/{PLAN_FILE}", (plan,), read_plan, 1)
    short = ScanOutcome(False, "cut", "short")
    rows = b"".join(row_of_trial(t, short).to_json_line().encode() + b"\n" for t in trials)
    yield Reader(
        "rows",
        f"study/{STUDY_ROWS_FILE}",
        (rows,),
        lambda f: list(StudyRows(f.parent, trials, ScanOutcome)),
        1,
    )


def _shapes(folder: Path) -> Iterator[Reader]:
    read = partial(read_shape, options=UserUnitAndFrame("mm", "j"))
    box = trimesh.creation.box((10.0, 20.0, 30.0))
    cloud = trimesh.PointCloud(box.vertices)
    ascii_ply = box.export(file_type="ply", encoding="ascii")
    text = "\n".join(" ".join(f"{v:g}" for v in p) for p in box.vertices)
    pcd = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 8\n"
        f"HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 8\nDATA ascii\n{text}\n"
    )
    binary = pcd.split("DATA")[0].encode() + b"DATA binary\n"
    binary += box.vertices.astype("<f4").tobytes()
    csv = "x_mm,y_mm,z_mm\n" + text.replace(" ", ",")
    joint = read_joint(CAD / "tjoint-600x457.toml")
    built = folder / "built"
    build_and_write_joint(joint, built)
    edges = b"\n".join((built / "edges.csv").read_bytes().splitlines()[:1])
    rows = (built / "edges.csv").read_bytes().splitlines()[1:]
    edges += b"\n" + b"\n".join(rows[:: max(1, len(rows) // 60)])
    sidecar = next(built.glob("*.json")).read_bytes()
    formats: list[tuple[str, tuple[Any, ...], float]] = [
        ("ply", (box.export(file_type="ply"), ascii_ply, cloud.export(file_type="ply")), 2),
        ("stl", (box.export(file_type="stl"), box.export(file_type="stl_ascii")), 2),
        ("obj", (box.export(file_type="obj"),), 1),
        ("3mf", (_3mf(box),), 1),
        ("pcd", (pcd, binary), 2),
        ("xyz", (text,), 3),
        ("csv", (csv, edges), 3),
        ("json", (sidecar,), 0.3),
    ]
    for ending, seeds, share in formats:
        data = tuple(s.encode() if isinstance(s, str) else bytes(s) for s in seeds)
        yield Reader(f"shape {ending.upper()}", f"shape.{ending}", data, read, share)


def _3mf(mesh: trimesh.Trimesh) -> bytes:
    stream = BytesIO()
    mesh.export(stream, file_type="3mf")
    return stream.getvalue()


def _calibration(folder: Path) -> bytes:
    variance = 0.01
    data: dict[str, Any] = {
        "arm": "ur10e",
        "laser": "simulated",
        "date": datetime(2026, 3, 4, tzinfo=UTC),
        "method": "plane touched",
        "lines": 12,
        "T_f_s_mm": read_scan_job(EXAMPLES / "paper.toml").calibration.T_f_s_mm,
        "covariance": np.diag(np.full(6, variance)).tolist(),
        "sigma_position_mm": float(np.sqrt(3 * variance)),
        "sigma_rotation_deg": float(np.sqrt(3 * variance)),
        "condition": 1.0,
        "excess": 1.0,
        "noise": NoiseModel(),
        "residuals": [],
    }
    file = folder / "calibration.toml"
    provenance = Provenance.for_file_written_now("calibrate.toml", "f")
    write_calibration(file, validate_table(CalibrationFile, data), provenance)
    return file.read_bytes()
