"""Whether mistakes in a job are named: the key, what is mistaken, and what to write.

Sixty mistakes of twenty kinds are made in the template for one's own cell, one at a time, and the
job is checked with ``tjscan scan --dry-run``. A mistake is named if the program ends with exit code
2, and its message holds the words that stand beside it here. ``--quick`` makes one of each kind.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from _table import Row, main
from scipy.spatial.transform import Rotation

from tjscan.cli import main as tjscan

ROOT: Final = Path(__file__).parents[1]
TEMPLATE: Final = (ROOT / "examples" / "ur10e.toml").read_text(encoding="utf-8")
FIRST_POSITION, SECOND_POSITION = [-60.3, 949.6, 360.1], [-49.0, 807.9, 363.1]
FIRST_ANGLES, SECOND_ANGLES = [7.47, -63.96, 160.79], [2.82, -63.01, 179.12]
START: Final = "position_mm = {}\neuler_zyx_deg = {}"
FIRST: Final = START.format(FIRST_POSITION, FIRST_ANGLES)
SECOND: Final = START.format(SECOND_POSITION, SECOND_ANGLES)
ROWS: Final = TEMPLATE[TEMPLATE.index("T_f_s_mm = [\n") :].split("\n]\n")[0] + "\n]"
MOUNT: Final = np.array(
    [
        [0.9999, -0.0129, -0.0002, -0.749],
        [0.0129, 0.9999, 0.0082, -114.845],
        [0.0001, -0.0082, 1.0, 167.616],
        [0.0, 0.0, 0.0, 1.0],
    ]
)

Numbers = list[float]
Mistake = tuple[Callable[[], str | bytes], str, str]
"""The job with it; the key, and what has to be written, as patterns of the message."""


def put(*changes: str) -> Callable[[], str]:
    """The template with texts replaced: old, new, old, new."""

    def changed() -> str:
        text = TEMPLATE
        for old, new in zip(changes[::2], changes[1::2], strict=True):
            assert old in text, old
            text = text.replace(old, new, 1)
        return text

    return changed


def posed(
    which: str,
    position: Callable[[Numbers], Numbers] = list,
    angles: Callable[[Numbers], Numbers] = list,
) -> Callable[[], str]:
    """The template with the first pose written otherwise, the second, or both."""
    first = START.format(position(FIRST_POSITION), angles(FIRST_ANGLES))
    second = START.format(position(SECOND_POSITION), angles(SECOND_ANGLES))
    changes = {"first": (FIRST, first), "second": (SECOND, second)}
    return put(*changes.get(which, (*changes["first"], *changes["second"])))


def metres(numbers: Numbers) -> Numbers:
    """Millimetres written in metres."""
    return [round(value / 1e3, 6) for value in numbers]


def radians(numbers: Numbers) -> Numbers:
    """Degrees written in radians."""
    return [round(float(value), 4) for value in np.radians(numbers)]


def rotation_vector(numbers: Numbers) -> Numbers:
    """Euler angles written as a rotation vector, radians."""
    vector = Rotation.from_euler("ZYX", numbers, degrees=True).as_rotvec()
    return [round(float(value), 4) for value in vector]


def roll_pitch_yaw(numbers: Numbers) -> Numbers:
    """In the order in which a pendant shows them."""
    return numbers[::-1]


def mount(T: np.ndarray) -> Callable[[], str]:
    """The template with another matrix as T_f_s."""
    return put(ROWS, f"T_f_s_mm = {np.round(T, 6).tolist()}")


IN_METRES: Final = MOUNT @ np.diag([1, 1, 1, 1e-3]) + np.diag([0, 0, 0, 0.999])
SWAPPED: Final = put(FIRST, "@", SECOND, FIRST, "@", SECOND)
COMMA: Final = r"[Dd]ecimal comma.*[Ww]rite"
MISTAKES: Final[dict[str, tuple[Mistake, Mistake, Mistake]]] = {
    "start poses in metres": (
        (posed("both", metres), "scan.first", r"metres: write \[-60.3"),
        (posed("second", metres), "scan.second", r"metres: write \[-49.0"),
        (posed("both", metres, radians), "scan.first", r"metres: write \[-60.3"),
    ),
    "lengths in metres": (
        (put("step_mm = 40.0", "step_mm = 0.04"), "scan.step_mm", "metres: write 40"),
        (put("near_mm = 190.0", "near_mm = 0.19"), "laser.near_mm", "metres: write 190"),
        (put("length_mm = 400.0", "length_mm = 0.4"), "scan.length_mm", "metres: write 400"),
    ),
    "views in metres": (
        (put("standoff_mm = 230.0", "standoff_mm = 0.23"), "standoff_mm", "metres: write 230"),
        (put("offset_mm = -15.0", "offset_mm = -0.015"), "view_offset_mm", "metres: write -15"),
        (put("margin_mm = 10.0", "margin_mm = 0.01"), "clearance.margin_mm", "metres: write 10"),
    ),
    "solids in metres": (
        (put("radius_mm = 300.0", "radius_mm = 0.3"), "solid", "metres: write 300"),
        (put("[96.0, 60.0, 85.0]", "[0.096, 0.06, 0.085]"), "tool", "metres: write 96"),
        (put("length_mm = 650.0", "length_mm = 0.65"), "solid", "metres: write 650"),
    ),
    "speeds in metres": (
        (put("speed_mm_s = 250.0", "speed_mm_s = 0.25"), "arm.speed_mm_s", "write 250"),
        (put("mm_s2 = 1200.0", "mm_s2 = 1.2"), "arm.acceleration_mm_s2", "write 1200"),
        (
            put('direction = "c', 'mode = "continuous"\nspeed_mm_s = 0.07\ndirection = "c'),
            "scan.speed_mm_s",
            "write 70",
        ),
    ),
    "start poses in radians": (
        (posed("both", angles=radians), "scan.first", r"radians: write first.*7\.47"),
        (posed("second", angles=radians), "scan.second", r"radians: write second.*179\.12"),
        (posed("first", angles=radians), "scan.first", r"radians: write first.*160\.79"),
    ),
    "other angles in radians": (
        (put("= [0.0, 90.0, 0.0]", "= [0.0, 1.5708, 0.0]"), "solid", r"radians: write \[0.0, 90"),
        (put("= [180.0, 0.0, 0.0]", "= [3.14159, 0.0, 0.0]"), "joint", r"radians: write \[180"),
        (put("pull_angle_deg = 10.0", "pull_angle_deg = 0.1745"), "pull_angle_deg", "write 9.99"),
    ),
    "home in radians": (
        (put("[-110, -95, 160, 105, -110, 0]", "[-1.92, -1.66, 2.79, 1.83, -1.92, 0]"),
         "home_deg", r"radians: write \[-110"),
        (put("[-110, -95, 160, 105, -110, 0]", "[0, -1.5708, 1.5708, 0, -1.5708, 0]"),
         "home_deg", r"radians: write \[0.0, -90"),
        (put("[-110, -95, 160, 105, -110, 0]", "[0.35, -1.2, 1.9, 0.1, -1.5, 0]"),
         "home_deg", r"radians: write \[20"),
    ),
    "rotation vectors": (
        (posed("both", angles=rotation_vector), "scan.first", "rotation vector.*write first"),
        (posed("first", angles=rotation_vector), "scan.first", "rotation vector.*write first"),
        (
            posed("second", angles=lambda v: np.degrees(rotation_vector(v)).round(2).tolist()),
            "scan.second",
            "rotation vector.*write second",
        ),
    ),
    "order of the angles": (
        (posed("both", angles=roll_pitch_yaw), "scan.first", "roll, pitch, yaw.*write first"),
        (posed("second", angles=roll_pitch_yaw), "scan.second", "roll.*write second"),
        (
            posed("both", angles=lambda v: radians(roll_pitch_yaw(v))),
            "scan.first",
            "roll, pitch, yaw.*radians: write first",
        ),
    ),
    "poses that do not lead on": (
        (SWAPPED, "scan.second", "behind it.*swap the two poses, or turn"),
        (put('"counterclockwise"   #', '"clockwise" #'), "scan.second", "turn scan.direction"),
        (put(SECOND, FIRST), "scan.second", "too close.*one step further"),
    ),
    "decimal commas": (
        (put("step_mm = 40.0", "step_mm = 40,5"), "step_mm", COMMA + " a point: 40.5"),
        (put("[-60.3, 949.6, 360.1]", "[-60,3, 949,6, 360,1]"), "scan.first", COMMA),
        (put("near_mm = 190.0", 'near_mm = "190,0"'), "laser.near_mm", "write 190.0, without"),
    ),
    "encodings": (
        (lambda: b"\xef\xbb\xbf" + TEMPLATE.encode(), "", "BOM.*save it as UTF-8"),
        (lambda: TEMPLATE.encode("utf-16"), "", "UTF-16.*save it as UTF-8"),
        (
            lambda: TEMPLATE.replace("# How", "# Führung").encode("latin-1"),
            "line 1",
            "save the file as UTF-8",
        ),
    ),
    "no TOML": (
        (put("step_mm = 40.0", "step_mm: 40.0"), "step_mm", "write = between"),
        (put("realtime = false", "realtime = False"), "realtime", "write true or false"),
        (put("step_mm = 40.0", "step_mm = 40 mm"), "step_mm", "number alone, 40"),
    ),
    "quotes": (
        (put('model = "ur10e" ', "model = ur10e "), "model", 'in quotes: "ur10e"'),
        (put('model = "ur10e" ', "model = “ur10e” "), "model", "write plain ones"),
        (put("step_mm = 40.0", 'step_mm = "40.0"'), "scan.step_mm", "write 40.0, without quotes"),
    ),
    "keys": (
        (put("step_mm = 40.0", "step = 40.0"), "scan.step", "did you mean: step_mm"),
        (put("[laser]", "[lazer]"), "lazer", "did you mean: laser"),
        (put("radius_mm = 228.6", "diameter_mm = 457.2"), "diameter_mm", "radius_mm, half of it"),
    ),
    "keys that are there twice, or not": (
        (put("step_mm = 40.0", "step_mm = 40.0\nstep_mm = 30.0"), "line 10", "delete one"),
        (put(f"[scan.second]\n{SECOND}", ""), "scan.second", "is required"),
        (put('file = "../cad/tjoint-600x457.toml"\n', ""), "joint.file", "is required"),
    ),
    "files": (
        (put("../cad/tjoint-600x457.toml", "../cad/tjoint.toml"), "joint.file", "no such file"),
        (put('"../cad/t', r'"C:\Users\t'), "file", "write / in paths"),
        (put(ROWS, 'file = "calibration.toml"'), "calibration.toml", "no such file"),
    ),
    "matrices of the laser": (
        (mount(IN_METRES), "calibration.T_f_s_mm", r"metres: write \[-0.749"),
        (mount(MOUNT.T), "calibration.T_f_s_mm", "transposed: the position is the last column"),
        (mount(np.linalg.inv(MOUNT)), "calibration.T_f_s_mm", "flange in the sensor.*write"),
    ),
    "words and numbers of a choice": (
        (put('"counterclockwise"   #', '"ccw" #'), "scan.direction", "'counterclockwise' or"),
        (put("prediction_case = 3", "prediction_case = 5"), "scan.prediction_case", "none of 1, 2"),
        (put("noise_mm = 0.05 ", "noise_mm = 50.0 "), "groove.noise_mm", "micrometres: write 0.05"),
    ),
}  # fmt: skip


def dry_run(job: str | bytes, folder: Path) -> tuple[object, str]:
    """Exit code and message of a dry run of a job."""
    file = folder / "examples" / "job.toml"
    file.write_bytes(job.encode() if isinstance(job, str) else job)
    told = StringIO()
    with redirect_stdout(told), redirect_stderr(told):
        try:
            tjscan(["scan", str(file), "--dry-run"])
        except SystemExit as end:
            return end.code, " ".join(told.getvalue().split())
    return 0, " ".join(told.getvalue().split())


def measure(*, quick: bool) -> Iterator[Row]:
    """Rows of the bench."""
    made, named, sound = 0, 0, 0
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "examples").mkdir()
        shutil.copytree(ROOT / "cad", folder / "cad")
        assert dry_run(TEMPLATE, folder)[0] in (0, None), "the template itself is not sound"
        for kind, mistakes in MISTAKES.items():
            for make, key, remedy in mistakes[:1] if quick else mistakes:
                code, message = dry_run(make(), folder)
                made += 1
                sound += code in (0, None)
                right = code == 2 and key in message and bool(re.search(remedy, message))
                named += right
                if not right:
                    print(f"{kind}: exit {code}: {message}", file=sys.stderr)
    yield Row("mistakes made, of 20 kinds", made, float("inf"))
    yield Row("… named with key and remedy", 100 * named / made, 100, "%", 95)
    yield Row("… called sound", sound, 0)


if __name__ == "__main__":
    ARGUMENTS = [word for word in sys.argv[1:] if word != "--quick"]
    QUICK = "--quick" in sys.argv
    sys.exit(main("mistakes in jobs", lambda: measure(quick=QUICK), ARGUMENTS))
