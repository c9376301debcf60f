"""Whether seeded runs leave the same result files as ever, and no key or option was lost.

``python bench/goldens.py`` makes the runs of `_golden_runs` and compares their result files with
the frozen ones in ``bench/goldens``: byte for byte but for lines of provenance and times of the
computer; on another processor, where floating point may round otherwise, every figure within
`FIGURE_TOLERANCE`. ``--only scan,crawl`` makes some of them, ``--exact`` allows no tolerance,
``--freeze`` writes the frozen files anew and prints what changed.

Keys of files and options of commands that are gone must be in the table of
``docs/changed-keys.md``.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import open3d as o3d
from _golden_runs import GOLDEN_RUNS, ROOT, GoldenRun, make_run
from _table import Row, main

FROZEN: Final = ROOT / "bench" / "goldens"
CHANGED_KEYS: Final = ROOT / "docs" / "changed-keys.md"

FIGURE_TOLERANCE: Final = 1e-5
"""Of a figure, relative to the larger of itself and one; other processors sum in another order."""

LARGEST_TEXT: Final = 100_000
"""Bytes of a result file that is frozen whole; of larger or binary ones a digest is."""

PROVENANCE: Final = re.compile(
    r"^# (program|written|job|source)[:=].*\n|^(program|written|made|created|date) = .*\n"
    r'|"(program|written|job|sha256)": ?"[^"]*",?\s*|/tmp/[^\s",]*',
    re.MULTILINE,
)
"""What differs from run to run: program, date, the job's name, places of this run."""

COMPUTING_COLUMNS: Final = ("wall_s", "plan_s", "plan_ms", "code")
COMPUTING_TIMES: Final = re.compile(
    r'"(plan_hz|plan_p99_ms|real_time_factor|duration_s|seconds_of_computing)": ?[^,\n]*,?\s*'
)
"""How fast this machine computed, and by which source; no result."""

NUMBER: Final = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?")


def comparable(file: Path) -> str:
    """A result file's text without provenance; a digest of a large or binary one."""
    data = file.read_bytes()
    if file.suffix == ".ply":
        cloud = o3d.io.read_point_cloud(file)
        return digest(re.sub(rb"comment [^\n]*\n", b"", data), np.asarray(cloud.points).ravel())
    text = COMPUTING_TIMES.sub("", PROVENANCE.sub("", data.decode("utf-8")))
    if file.suffix == ".csv":
        text = without_computing_times(text)
    if len(text) <= LARGEST_TEXT:
        return text
    return digest(text.encode(), np.array(NUMBER.findall(text), float))


def without_computing_times(text: str) -> str:
    """A table without the columns of `COMPUTING_COLUMNS`."""
    comments = [line for line in text.splitlines() if line.startswith("#")]
    table = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))
    kept = [i for i, name in enumerate(table[0]) if name not in COMPUTING_COLUMNS]
    return "\n".join([*comments, *(",".join(row[i] for i in kept) for row in table)]) + "\n"


def digest(data: bytes, figures: np.ndarray) -> str:
    """The SHA-256 of a file, and by what its figures are compared where that differs."""
    spread = np.quantile(figures, np.linspace(0, 1, 21))
    summary = f"{figures.size} figures: mean {figures.mean()!r}, quantiles {spread.tolist()}"
    return f"SHA-256 {hashlib.sha256(data).hexdigest()}\n{summary}\n"


def largest_difference(found: str, frozen: str) -> float:
    """Largest relative difference of the figures in two texts; infinite if other things differ."""
    if found.startswith("SHA-256 ") and frozen.startswith("SHA-256 "):
        if found.splitlines()[0] == frozen.splitlines()[0]:
            return 0.0
        found, frozen = found.partition("\n")[2], frozen.partition("\n")[2]
    if NUMBER.sub("#", found) != NUMBER.sub("#", frozen):
        return math.inf
    pairs = zip(NUMBER.findall(found), NUMBER.findall(frozen), strict=True)
    return max(
        (abs(float(a) - float(b)) / max(1, abs(float(b))) for a, b in pairs if a != b), default=0
    )


def frozen_file(golden: GoldenRun, name: str) -> Path:
    """Where a result file of a run is frozen."""
    return FROZEN / golden.name / (name.replace("/", "-") + ".txt")


def differences(golden: GoldenRun, runs: Path) -> dict[str, float]:
    """Largest difference of each result file of a run; infinite for other text or no file."""
    return {
        name: largest_difference(
            comparable(runs / name) if (runs / name).is_file() else "",
            frozen_file(golden, name).read_text(encoding="utf-8"),
        )
        for name in golden.files
    }


def tjscan_prints(*words: str) -> str:
    """What a command prints on stdout."""
    command = [sys.executable, "-m", "tjscan", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def keys_of_schema(schema: dict[str, Any]) -> set[str]:
    """Every key of a kind of file, dotted."""
    definitions = schema.get("$defs", {})
    found = set()

    def walk(node: Any, name: str, inside: tuple[str, ...]) -> None:
        if isinstance(node, list):
            for part in node:
                walk(part, name, inside)
        if not isinstance(node, dict):
            return
        target = node.get("$ref", "").removeprefix("#/$defs/")
        if target and target not in inside:
            walk(definitions[target], name, (*inside, target))
        for key, value in node.get("properties", {}).items():
            found.add(f"{name}.{key}" if name else key)
            walk(value, f"{name}.{key}" if name else key, inside)
        for part in ("items", "anyOf", "oneOf", "allOf", "additionalProperties"):
            walk(node.get(part), name, inside)

    walk(schema, "", ())
    return found


def all_keys() -> list[str]:
    """Every key of every kind of file, as ``KIND: key``."""
    kinds = re.findall(r"^\s*([a-z]\w*)\b", tjscan_prints("schema"), re.MULTILINE)
    return sorted(
        f"{kind}: {key}"
        for kind in kinds
        for key in keys_of_schema(json.loads(tjscan_prints("schema", kind)))
    )


def all_options() -> list[str]:
    """Every option of every command, as ``COMMAND --option``."""
    listed = r"^│ ([a-z][a-z-]+) "
    commands: list[tuple[str, ...]] = [
        (name,) for name in re.findall(listed, tjscan_prints("--help"), re.MULTILINE)
    ]
    found = []
    while commands:
        command = commands.pop(0)
        text = tjscan_prints(*command, "--help")
        found += [
            f"{' '.join(command)} {option}"
            for option in re.findall(r"[│ ](--[a-z][\w-]*)(?![\w.-])", text)
        ]
        if "COMMAND" in text.splitlines()[0]:
            commands += [(*command, name) for name in re.findall(listed, text, re.MULTILINE)]
    return sorted(set(found))


def mapped_names(table: str) -> set[str]:
    """Old names in the first column of the table of changed ones: keys, ``COMMAND --option``."""
    found = set()
    for cell in re.findall(r"^\| (.*?) \|", table, re.MULTILINE):
        command = re.match(r"`tjscan ([a-z -]+?)`", cell)
        found |= set(re.findall(r"`([^`]+)`", cell))
        if command:
            found |= {f"{command[1]} {option}" for option in re.findall(r"--[a-z][\w-]*", cell)}
    return found


def missing(kind: str, now: list[str]) -> list[str]:
    """Frozen keys or options that are neither there nor in the table of changed ones."""
    frozen = (FROZEN / f"{kind}.txt").read_text(encoding="utf-8").splitlines()
    mapped = mapped_names(CHANGED_KEYS.read_text(encoding="utf-8"))
    gone = set(frozen) - set(now) - mapped
    # The twins that every option has, for its opposite and for an empty list.
    return sorted(name for name in gone if re.sub(" --(no|empty)-", " --", name) not in mapped)


def measure(only: frozenset[str], exact: bool, freeze: bool) -> Iterator[Row]:
    """Make the runs; compare them with the frozen ones, or freeze them."""
    chosen = [golden for golden in GOLDEN_RUNS if not only or golden.name in only]
    needed = {golden.needs for golden in chosen}
    with TemporaryDirectory() as folder:
        runs = Path(folder)
        for golden in GOLDEN_RUNS:
            if golden not in chosen and golden.name not in needed:
                continue
            if not golden.is_possible:
                print(f"{golden.name}: left out, its recorded data is missing", file=sys.stderr)
                continue
            problem = make_run(golden, runs)
            if problem:
                print(problem, file=sys.stderr)
            elif freeze and golden in chosen:
                freeze_run(golden, runs)
            if golden not in chosen:
                continue
            found = differences(golden, runs)
            for name, difference in found.items():
                if difference:
                    print(f"{golden.name}: {name} differs by {difference:g}", file=sys.stderr)
            worst = max(found.values())
            limit = 0 if exact else FIGURE_TOLERANCE
            yield Row(f"{golden.name}: largest difference in {len(found)} files", worst, limit)
    for kind, now in (("keys", all_keys()), ("options", all_options())) if not only else ():
        if freeze:
            (FROZEN / f"{kind}.txt").write_text("\n".join(now) + "\n", encoding="utf-8")
        gone = missing(kind, now)
        if gone:
            print(f"{kind} gone and not mapped: {', '.join(gone)}", file=sys.stderr)
        yield Row(f"{kind} gone without an entry in {CHANGED_KEYS.name}", len(gone), 0)


def freeze_run(golden: GoldenRun, runs: Path) -> None:
    """Write the frozen files of a run, and print by how much each changed."""
    for name in golden.files:
        file, text = frozen_file(golden, name), comparable(runs / name)
        if file.is_file():
            change = largest_difference(text, file.read_text(encoding="utf-8"))
            print(f"| {golden.name} | {name} | {change:g} |")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="names of runs, with commas between")
    parser.add_argument("--exact", action="store_true", help="byte for byte")
    parser.add_argument("--freeze", action="store_true", help="write the frozen files")
    options, rest = parser.parse_known_args()
    names = frozenset(filter(None, options.only.split(",")))
    sys.exit(main("goldens", partial(measure, names, options.exact, options.freeze), rest))
