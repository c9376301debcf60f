"""A page with 10⁵ points, in a process of its own; prints its address, then its memory."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from tjscan.live.drawables import MeasuredPiece
from tjscan.live.page import Page, PageAddress
from tjscan.live.step import Measure, SceneSetup, Step

PIECES, EACH = 100, 1000


def resident_bytes() -> int:
    """Memory of this process that is in use."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    (kilobytes,) = (line.split()[1] for line in lines if line.startswith("VmRSS"))
    return 1024 * int(kilobytes)


def main() -> None:
    """Show the points, and wait for a line on stdin."""
    rng = np.random.default_rng(0)
    none = np.empty((0, 3))
    with Page([SceneSetup("many points", (Measure("number"),))], PageAddress(port=0)) as page:
        for k in range(PIECES):
            points = rng.normal((0.01 * k, 0.0, 0.0), 0.05, (EACH, 3))
            piece = MeasuredPiece(points, none, none.astype(int), {"number": float(k)})
            page.show_step(Step(drawn={f"piece/{k}": piece}, facts={"points": str(EACH * (k + 1))}))
        print(json.dumps({"url": page.url}), flush=True)
        sys.stdin.readline()
        print(json.dumps({"resident": resident_bytes()}), flush=True)


if __name__ == "__main__":
    main()
