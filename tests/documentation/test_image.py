"""The container's recipe: every step is one that is followed, and all that it copies is there."""

import re
from pathlib import Path

import pytest
from _image import BASE, follow, instructions
from documented import ROOT

from tjscan.cli import SYSTEM_LIBRARY_ADVICE

DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def test_whoever_installs_libraries_of_the_system_names_the_same() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (packages,) = re.findall(r"^SYSTEM_PACKAGES := (.*)$", makefile, re.MULTILINE)
    assert SYSTEM_LIBRARY_ADVICE.endswith(f"apt-get install {packages}")
    assert f"`{packages}`" in (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    steps = [" ".join(rest.split()) for word, rest in instructions(DOCKERFILE) if word == "RUN"]
    assert any(packages in step for step in steps)


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
