"""Follow the Dockerfile step by step where there is no docker: ``make image``.

FROM makes an empty Debian with debootstrap and puts its Python into /usr/local, where the base
image has its own; COPY copies into it, and RUN runs in it (chroot). Then the entry point makes a
job and scans. It needs root, and nothing of this machine but its network, its certificates and its
checkout.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

ROOT: Final = Path(__file__).parents[1]

BASE: Final = re.compile(r"python:(\d+\.\d+)-slim-(\w+)")

OUTSIDE: Final = ("etc/resolv.conf", "etc/ssl/certs/ca-certificates.crt")
"""Files of this machine without which nothing can be fetched."""


def instructions(dockerfile: str) -> Iterator[tuple[str, str]]:
    """The instructions of a Dockerfile and what follows each, continued lines joined."""
    lines = re.sub(r"^#.*\n", "", dockerfile, flags=re.MULTILINE).replace("\\\n", " ")
    for line in filter(None, map(str.strip, lines.splitlines())):
        word, _, rest = line.partition(" ")
        yield word, rest.strip()


def follow(dockerfile: str, image: Path) -> list[str]:
    """Make an image's files in an empty folder, and return its entry point.

    Raises
    ------
    ValueError
        If there is an instruction, or a base, that is not followed here.
    CalledProcessError
        If a step fails.
    """
    folder, entry = "/", list[str]()
    for word, rest in instructions(dockerfile):
        print(f"{word} {rest}", flush=True)
        if word == "FROM" and (base := BASE.fullmatch(rest)):
            _make_base(base[1], base[2], image)
        elif word == "COPY":
            *sources, target = rest.split()
            for source in sources:
                _copy(ROOT / source, image / target.lstrip("/"), into=target.endswith("/"))
        elif word == "RUN":
            run_in(image, ["sh", "-ec", rest], folder)
        elif word == "WORKDIR":
            folder = rest
            (image / folder.lstrip("/")).mkdir(parents=True, exist_ok=True)
        elif word == "ENTRYPOINT":
            entry = json.loads(rest)
        elif word != "CMD":
            raise ValueError(f"not followed here: {word} {rest}")
    return entry


def run_in(image: Path, command: Sequence[str], folder: str) -> None:
    """Run a command in an image's files, in one of its folders."""
    path = "/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
    inside = ["sh", "-c", 'cd "$0" && exec "$@"', folder, *command]
    subprocess.run(["chroot", image, *inside], env={**os.environ, "PATH": path}, check=True)


def _make_base(python: str, release: str, image: Path) -> None:
    packages = "--include=ca-certificates,python3,python3-venv"
    command = ["debootstrap", "--variant=minbase", packages, release, str(image)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    for name in OUTSIDE:
        shutil.copy(f"/{name}", image / name)
    run_in(image, [f"python{python}", "-m", "venv", "/usr/local"], "/")


def _copy(source: Path, target: Path, *, into: bool) -> None:
    target = target / source.name if into else target
    if source.is_dir():
        shutil.copytree(
            source, target, ignore=shutil.ignore_patterns("__pycache__", "build", "*.so")
        )
    else:
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, target)


if __name__ == "__main__":
    if shutil.which("debootstrap") is None or os.geteuid() != 0:
        sys.exit("make image needs docker, or root and debootstrap: apt-get install debootstrap")
    with TemporaryDirectory() as made:
        image = Path(made) / "image"
        entry = follow((ROOT / "Dockerfile").read_text(encoding="utf-8"), image)
        for arguments in (["init", "paper"], ["scan", "paper.toml", "--scan.sections", "4"]):
            run_in(image, [*entry, *arguments], "/work")
