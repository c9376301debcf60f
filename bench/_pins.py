"""Pins with hashes from pip's report of what it would install, on standard input.

See ``make pins``. Names, versions and SHA-256 only: where packages come from is pip's own setting.
"""

from __future__ import annotations

import json
import sys
from typing import Any, Final

HEAD: Final = """\
# What constraints.txt pins, with the SHA-256 of each file, for CPython {version} on {system}.
#   pip install --require-hashes -r requirements-hashed.txt && pip install --no-deps .
# Made by: make pins
"""


def pinned(report: dict[str, Any]) -> str:
    """Lines of a requirements file from an installation report of pip."""
    place = report["environment"]
    lines = [
        f"{one['metadata']['name']}=={one['metadata']['version']} "
        f"--hash=sha256:{one['download_info']['archive_info']['hashes']['sha256']}\n"
        for one in report["install"]
    ]
    head = HEAD.format(
        version=place["python_version"],
        system=f"{place['platform_system']} {place['platform_machine']}",
    )
    return head + "".join(sorted(lines, key=str.lower))


if __name__ == "__main__":
    sys.stdout.write(pinned(json.load(sys.stdin)))
