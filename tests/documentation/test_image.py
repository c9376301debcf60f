"""The container's recipe: every step is one that is followed, and all that it copies is there."""

import re
from pathlib import Path

import pytest
from _image import BASE, follow, instructions
from documented import ROOT

DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def test_it_installs_what_the_makefile_does() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (packages,) = re.findall(r"^OPEN3D_PACKAGES := (.*)$", makefile, re.MULTILINE)
    installed = {
        word for step, rest in instructions(DOCKERFILE) if step == "RUN" for word in rest.split()
    }
    assert {*packages.split()} <= installed


def test_its_base_has_the_python_of_the_pins() -> None:
    ((_, base),) = (step for step in instructions(DOCKERFILE) if step[0] == "FROM")
    found = BASE.fullmatch(base)
    assert found is not None
    head = (ROOT / "requirements-hashed.txt").read_text(encoding="utf-8").partition("\n")[0]
    assert f"CPython {found[1]}" in head


def test_what_it_copies_is_there_and_not_ignored() -> None:
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    copied = [rest.split()[:-1] for step, rest in instructions(DOCKERFILE) if step == "COPY"]
    for source in (name for names in copied for name in names):
        assert (ROOT / source).exists()
        assert f"!{source}" in ignored


def test_an_unknown_step_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not followed here: ADD"):
        follow("# an image\nADD a b\n", tmp_path)
