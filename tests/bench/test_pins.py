"""Every package that the project or one of its extras needs is pinned, with its hash."""

import re
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, requires
from itertools import chain
from pathlib import Path

from _pins import pinned
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
HASHED = re.compile(r"([\w.-]+)==(\S+) --hash=sha256:[0-9a-f]{64}")


def same_name(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def constraints() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    return {same_name(name): version for name, _, version in (ln.partition("==") for ln in lines)}


def hashed() -> dict[str, str]:
    lines = (ROOT / "requirements-hashed.txt").read_text().splitlines()
    matches = [HASHED.fullmatch(line) for line in lines if not line.startswith("#")]
    return {same_name(match[1]): match[2] for match in matches if match is not None}


def needed() -> Iterator[str]:
    """Names of what the project, its extras and all that they need ask for, as far as installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [*project["dependencies"], *chain(*project["optional-dependencies"].values())]
    left, seen = [(text, "") for text in asked], set[tuple[str, str]]()
    while left:
        text, extra = asking = left.pop()
        one = Requirement(text)
        if asking in seen or not (one.marker is None or one.marker.evaluate({"extra": extra})):
            continue
        seen.add(asking)
        yield same_name(one.name)
        with suppress(PackageNotFoundError):  # of an extra that is not installed here
            left += [(inner, e) for inner in requires(one.name) or () for e in one.extras or {""}]


def test_everything_that_is_needed_is_pinned() -> None:
    assert set(needed()) - constraints().keys() == set()


def test_every_pin_has_a_hash_and_no_host() -> None:
    text = (ROOT / "requirements-hashed.txt").read_text()
    assert "://" not in text
    assert len(hashed()) == sum(not line.startswith("#") for line in text.splitlines())
    assert constraints() == hashed()


def test_pins_are_made_of_a_report_of_pip() -> None:
    report = {
        "environment": {
            "python_version": "3.11",
            "platform_system": "Linux",
            "platform_machine": "x86_64",
        },
        "install": [
            {
                "metadata": {"name": "numpy", "version": "2.4.6"},
                "download_info": {"archive_info": {"hashes": {"sha256": 64 * "0"}}},
            }
        ],
    }
    *head, line = pinned(report).splitlines()
    assert all(one.startswith("#") for one in head)
    assert HASHED.fullmatch(line)
