"""The wheel holds all that the program uses, and nothing else."""

import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

from _wheel import ROOT, copy_sources

BESIDE_CODE = ("examples", "cad")
"""Folders whose files for ``tjscan init`` the wheel holds in share/tjscan."""


def files_below(folder: Path) -> set[str]:
    """Paths of all files below a folder, but those that are compiled."""
    files = (file.relative_to(folder) for file in folder.rglob("*") if file.is_file())
    compiled = {"__pycache__", ".so"}
    return {file.as_posix() for file in files if not compiled & {*file.parts, file.suffix}}


def test_the_wheel_of_the_loopbacks_holds_every_file_and_their_commands(tmp_path: Path) -> None:
    source, out = tmp_path / "source", tmp_path / "wheels"
    shutil.copytree(
        ROOT / "loopback",
        source,
        ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "build"),
    )
    with ZipFile(build_wheel(source, out)) as archive:
        names = set(archive.namelist())
        (points,) = (name for name in names if name.endswith("/entry_points.txt"))
        assert archive.read(points).decode().startswith("[tjscan.command]")
    folder = ROOT / "loopback" / "tjscan_loopback"
    code = {f"{folder.name}/{name}" for name in files_below(folder)}
    assert {name for name in names if ".dist-info/" not in name} == code


def build_wheel(source: Path, out: Path) -> Path:
    """Build the wheel of a project, and return its file."""
    build = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
    subprocess.run(
        [sys.executable, "-c", build, str(out)], cwd=source, check=True, capture_output=True
    )
    (wheel,) = out.glob("*.whl")
    return wheel


def test_the_wheel_holds_every_file_of_the_package_and_the_examples(tmp_path: Path) -> None:
    source, out = tmp_path / "source", tmp_path / "wheels"
    copy_sources(source)
    wheel = build_wheel(source, out)
    stem = "-".join(wheel.name.split("-")[:2])
    with ZipFile(wheel) as archive:
        names = set(archive.namelist())
    held = {name for name in names if not name.startswith(f"{stem}.dist-info/")}
    code = {f"tjscan/{name}" for name in files_below(ROOT / "tjscan")}
    beside = {
        f"{stem}.data/data/share/tjscan/{folder}/{name}"
        for folder in BESIDE_CODE
        for name in files_below(ROOT / folder)
        if name.endswith((".toml", "layout.json"))
    }
    assert {"tjscan/py.typed", "tjscan/report/view3d.js"} < code
    compiled = held - code - beside
    assert code | beside < held
    assert {(name.split(".")[0], Path(name).suffix) for name in compiled} == {
        ("tjscan/groove/_kernel", ".so")
    }
    assert f"{stem}.dist-info/licenses/LICENSE" in names
