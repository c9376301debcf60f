"""The seeded runs whose results are frozen, and the commands that make them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
RECORDED_SETS: Final = ROOT.parent / "shared" / "data" / "line-laser-calibration"

Step = tuple[str, ...] | Callable[[Path], None]
"""A command of tjscan, or something done to its folder of runs between two of them."""


@dataclass(frozen=True, slots=True)
class GoldenRun:
    """A seeded run, and the result files that are held against frozen ones.

    Parameters
    ----------
    name : str
        Folder of its frozen files.
    steps : tuple of Step
        What makes the run; ``{runs}`` in a command is the folder of all runs, ``{example}`` the
        examples' folder, ``{jobs}`` that of the jobs made for this.
    files : tuple of str
        Result files, relative to the folder of all runs.
    needs : str, optional
        The run that has to be made before.
    printed : str, optional
        The file that receives what the commands print on stdout.
    reads_recorded_sets : bool, optional
        Whether it needs the recorded sets, which are no part of the project.
    """

    name: str
    steps: tuple[Step, ...]
    files: tuple[str, ...]
    needs: str = ""
    printed: str = ""
    reads_recorded_sets: bool = False

    @property
    def is_possible(self) -> bool:
        """Whether the recorded data that it reads is there."""
        return RECORDED_SETS.is_dir() or not self.reads_recorded_sets


def cut_recording(run: str, share: float, results: tuple[str, ...]) -> Callable[[Path], None]:
    """Copy a run as ``RUN-cut``, its recording cut off at a share of its bytes, without results."""

    def cut(runs: Path) -> None:
        copy = runs / f"{run}-cut"
        shutil.copytree(runs / run, copy)
        for name in results:
            (copy / name).unlink(missing_ok=True)
        (recording,) = copy.glob("*.mcap")
        os.truncate(recording, int(share * recording.stat().st_size))

    return cut


SCAN_FILES: Final = ("sections.csv", "summary.json", "uncertainty.json", "groove.ply")
SHORT_CALIBRATION: Final = ("--unattended", "--board.touches", "6", "--board.lines", "10")
NOISE_OF_SETS: Final = "[noise]\nposition_mm = 0.06\nrotation_deg = 0.02\n"


def recorded_set(name: str, target: str) -> str:
    """The table of a recorded set, for the job of a calibration."""
    files = (f'{what} = "{RECORDED_SETS}/{name}_{what}.csv"\n' for what in ("profiles", "poses"))
    return f'[[recorded]]\n{"".join(files)}units = "mm"\ntarget = {target}\n'


def write_job(name: str, text: str) -> Callable[[Path], None]:
    """Write the job of a calibration from recorded sets."""

    def write(runs: Path) -> None:
        (runs / name).write_text(text, encoding="utf-8")

    return write


RECORDED_LINES: Final = RECORDED_SETS.parent / "openlmd-lines"
RECORDED_PLANE_JOB: Final = """[[recorded]]
profiles = "plane_profiles.csv"
poses = "plane_poses.csv"
units = "mm"
target = "plane"
[noise]
range_mm = 0.15
position_mm = 0.2
rotation_deg = 0.05
"""

POSE_HEADER: Final = "profile,x_mm,y_mm,z_mm,qx,qy,qz,qw"


def write_plane_set(runs: Path) -> None:
    """Write the recorded lines on a board as tables with a header, as `tjscan calibrate` reads."""
    kinds = {"profiles": ("profile,x_mm,z_mm", (0, 4, 3)), "poses": (POSE_HEADER, range(8))}
    for kind, (header, columns) in kinds.items():
        _, *lines = (RECORDED_LINES / f"root_{kind}.csv").read_text(encoding="utf-8").splitlines()
        cells = [line.split(",") for line in lines]
        rows = [",".join([f"{float(c[0]):.0f}", *(c[i] for i in columns[1:])]) for c in cells]
        (runs / f"plane_{kind}.csv").write_text("\n".join((header, *rows)), encoding="utf-8")


def scan_of(example: str, run: str, *options: str) -> tuple[str, ...]:
    """The command that scans an example into a run."""
    return ("scan", f"{{example}}/{example}.toml", "--out", f"{{runs}}/{run}", *options)


def files_of(run: str, *names: str) -> tuple[str, ...]:
    """Result files of a run."""
    return tuple(f"{run}/{name}" for name in names)


GOLDEN_RUNS: Final = (
    GoldenRun(
        "scan",
        (scan_of("paper", "scan", "--scan.step-mm", "60"),),
        files_of("scan", *SCAN_FILES),
    ),
    GoldenRun(
        "clockwise",
        (scan_of("paper-clockwise", "clockwise", "--scan.step-mm", "80"),),
        files_of("clockwise", *SCAN_FILES),
    ),
    GoldenRun(
        "smooth",
        (scan_of("paper", "smooth", "--scan.prediction-case", "smooth", "--scan.step-mm", "50"),),
        files_of("smooth", "sections.csv", "summary.json"),
    ),
    GoldenRun(
        "yard",
        (scan_of("yard-joint", "yard", "--scan.length-mm", "400"),),
        files_of("yard", "sections.csv", "summary.json"),
    ),
    GoldenRun(
        "stations",
        (scan_of("whole-joint", "stations", "--scan.step-mm", "45"),),
        files_of("stations", "sections.csv", "summary.json", "stations.json"),
    ),
    GoldenRun(
        "resume",
        (
            cut_recording("scan", 0.5, (*SCAN_FILES, "scan.png", "SHA256SUMS")),
            ("scan", "--resume", "{runs}/scan-cut"),
        ),
        files_of("scan-cut", "sections.csv", "summary.json"),
        needs="scan",
    ),
    GoldenRun(
        "replay",
        (
            (
                *("scan", "{runs}/scan/job.toml", "--out", "{runs}/replay"),
                *("--arm.driver", "replay", "--laser.driver", "replay"),
                *("--laser.recording", "{runs}/scan"),
            ),
        ),
        files_of("replay", "sections.csv"),
        needs="scan",
    ),
    GoldenRun(
        "reprocess",
        (
            (
                *("reprocess", "{runs}/scan", "--groove.noise-mm", "0.1"),
                *("--out", "{runs}/reprocess"),
            ),
        ),
        files_of("reprocess", "sections.csv", "summary.json"),
        needs="scan",
    ),
    GoldenRun(
        "calibrate",
        (
            (
                *("calibrate", "{example}/calibrate.toml", "--out", "{runs}/calibrate"),
                *SHORT_CALIBRATION,
            ),
        ),
        files_of("calibrate", "calibration.toml"),
    ),
    GoldenRun(
        "calibrate-arm",
        (
            (
                *("calibrate", "{example}/calibrate.toml", "--out", "{runs}/calibrate-arm"),
                *("--arm", "--unattended", "--simulation.arm.errors.seed", "3"),
            ),
        ),
        files_of("calibrate-arm", "calibration.toml"),
    ),
    GoldenRun(
        "calibrate-ball",
        (
            write_job("ball.toml", recorded_set("ball40", '"ball"') + NOISE_OF_SETS),
            ("calibrate", "{runs}/ball.toml", "--out", "{runs}/ball"),
        ),
        ("ball/calibration.toml",),
        reads_recorded_sets=True,
    ),
    GoldenRun(
        "calibrate-roof",
        (
            write_job(
                "roof.toml",
                recorded_set("edge", '"roof"')
                + recorded_set("ball40", '"ball"\nradius_mm = 40.0')
                + NOISE_OF_SETS,
            ),
            ("calibrate", "{runs}/roof.toml", "--out", "{runs}/roof"),
        ),
        ("roof/calibration.toml",),
        reads_recorded_sets=True,
    ),
    GoldenRun(
        "calibrate-plane",
        (
            write_plane_set,
            write_job("plane.toml", RECORDED_PLANE_JOB),
            ("calibrate", "{runs}/plane.toml", "--out", "{runs}/plane"),
        ),
        ("plane/calibration.toml",),
        reads_recorded_sets=True,
    ),
    GoldenRun(
        "calibrate-resume",
        (
            cut_recording("calibrate", 0.5, ("calibration.toml",)),
            ("calibrate", "--resume", "{runs}/calibrate-cut", "--unattended"),
        ),
        files_of("calibrate-cut", "calibration.toml"),
        needs="calibrate",
    ),
    GoldenRun(
        "crawl",
        (
            ("crawl", "run", "{jobs}/crawl.toml", "--out", "{runs}/crawl"),
            (
                *("crawl", "replay", "{runs}/crawl", "--method", "paper"),
                *("--out", "{runs}/crawl-replay"),
            ),
        ),
        files_of("crawl", "passes.csv", "weld-log.json") + files_of("crawl-replay", "passes.csv"),
    ),
    GoldenRun(
        "crawl-resume",
        (
            cut_recording("crawl", 0.5, ("passes.csv", "weld-log.json")),
            ("crawl", "run", "--resume", "{runs}/crawl-cut"),
        ),
        files_of("crawl-cut", "passes.csv"),
        needs="crawl",
    ),
    GoldenRun(
        "tow",
        (
            (
                *("tow", "run", "{example}/tow-simulation.toml", "--out", "{runs}/tow"),
                *("--seam.points-mm", "[[2600, -300], [2600, -280]]"),
                *("--seam.speed-mm-min", "1200", "--following.patience-s", "1"),
            ),
            ("tow", "replay", "{runs}/tow", "--out", "{runs}/tow-replay"),
        ),
        files_of("tow", "tow.csv", "tow.json") + files_of("tow-replay", "tow.csv", "tow.json"),
    ),
    GoldenRun(
        "plan",
        (
            (
                *("plan", "{runs}/scan", "--wps", "{example}/wps.toml"),
                *("--gravity", "0", "0", "-1", "--out", "{runs}/plan"),
            ),
        ),
        files_of("plan", "plan.json", "beads.csv"),
        needs="scan",
    ),
    GoldenRun(
        "compare",
        ((*("compare", "{runs}/scan", "{cad}/tjoint-600x457.toml", "--json"),),),
        ("comparison.json",),
        needs="scan",
        printed="comparison.json",
    ),
    GoldenRun(
        "export",
        tuple(
            ("export", "{runs}/scan", "--to", kind, "--out", f"{{runs}}/export.{kind}")
            for kind in ("json", "csv")
        ),
        ("export.json", "export.csv"),
        needs="scan",
    ),
    GoldenRun(
        "study",
        ((*("study", "{jobs}/study.toml", "--workers", "2", "--out", "{runs}/study"),),),
        files_of("study", "study.csv"),
    ),
)
"""A run that needs another comes after it."""


def make_run(golden: GoldenRun, runs: Path) -> str:
    """Make a run; gives what its last failing command printed, empty if it ended as it should."""
    places = {
        "runs": str(runs),
        "example": str(ROOT / "examples"),
        "cad": str(ROOT / "cad"),
        "jobs": str(ROOT / "bench" / "goldens" / "jobs"),
    }
    # Sums by several threads differ in their last digits.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    for step in golden.steps:
        if not isinstance(step, tuple):
            step(runs)
            continue
        command = [sys.executable, "-m", "tjscan", *(word.format(**places) for word in step)]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, cwd=runs, env=environment
        )
        if done.returncode not in (0, 3):
            return f"{' '.join(command)} ended with {done.returncode}: {done.stderr[-2000:]}"
        if golden.printed:
            (runs / golden.printed).write_text(done.stdout, encoding="utf-8")
    return ""
