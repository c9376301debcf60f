"""The licence of everything that is installed: none is stronger than the LGPL, and none unknown.

``make licences`` prints the list. What a package states of itself counts: its licence expression
(PEP 639), else its classifiers, else the first line of its licence.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, distributions
from typing import Final

from _table import Row, main

OWN: Final = ("tjscan", "tjscan-loopback")

NOT_STATED: Final = {"asdf_standard": "BSD-3-Clause", "cmeel-qhull": "Qhull"}
"""Packages whose metadata states none, and the licence in their sources."""

NO_STRONGER: Final = re.compile(
    r"MIT|\d?-?BSD|0BSD|Apache|ISC|HPND|PSF|Python Software Foundation|Zlib|BSL-1|Boost|CC0|"
    r"Unlicense|Qhull|MPL|Mozilla|LGPL|Lesser General Public|any-OSI",
    re.IGNORECASE,
)
"""Licences that ask no more of a program that uses the package than the LGPL does."""

STRONGER: Final = re.compile(
    r"\bA?GPL|(?<!Lesser )General Public|Affero|SSPL|NonCommercial|\bNC\b|Proprietary|Commercial",
    re.IGNORECASE,
)


def stated_licence(package: Distribution) -> str:
    """Licence that a package states; empty where it states none."""
    expression, text = (_first_line(package, key) for key in ("License-Expression", "License"))
    classifiers = package.metadata.get_all("Classifier") or ()
    words = [word.rpartition(" :: ")[2] for word in classifiers if word.startswith("License :: ")]
    return expression or " AND ".join(words) or text or NOT_STATED.get(package.name, "")


def _first_line(package: Distribution, key: str) -> str:
    return next(iter(package.metadata.get_all(key) or ()), "").strip().partition("\n")[0]


def is_permitted(licence: str) -> bool:
    """Whether a licence, or one of those to choose from, is no stronger than the LGPL."""
    return any(
        all(_is_known(one) for one in choice.split(" AND ")) for choice in licence.split(" OR ")
    )


def _is_known(licence: str) -> bool:
    return bool(NO_STRONGER.search(licence)) and not STRONGER.search(licence)


def licences() -> Iterator[tuple[str, str, str]]:
    """Name, version and licence of every installed package."""
    for package in sorted(distributions(), key=lambda one: one.name.lower()):
        if package.name not in OWN:
            yield package.name, package.version, stated_licence(package)


def measure() -> list[Row]:
    """Print every licence, and count those that are not permitted."""
    found = list(licences())
    for name, version, licence in found:
        verdict = "" if is_permitted(licence) else "   NOT PERMITTED"
        print(f"{name:<28}{version:<18}{licence or 'not stated'}{verdict}", file=sys.stderr)
    wrong = sum(not is_permitted(licence) for _, _, licence in found)
    return [
        Row("installed packages", len(found), float("inf"), at_least=50),
        Row("… stronger than the LGPL, or not stated", wrong, 0),
    ]


if __name__ == "__main__":
    sys.exit(main("licences", measure, sys.argv[1:]))
