"""``tjscan`` with a display that holds the scan in its fifth section until stdin has a line."""

from __future__ import annotations

import sys

from tjscan.cli import main
from tjscan.cli.output import scan
from tjscan.scanning.section import ProfileView, Substep

UNDER_WAY = "a section is under way"
HELD = 4
"""Index of the section; a scan that has more behind it goes on there."""


class GatedJournal(scan.ProgressJournal):
    held = False

    def record(self, message: object) -> None:
        super().record(message)
        if not isinstance(message, ProfileView) or self.held:
            return
        if message.substep is Substep.PREDICTION and message.index == HELD:
            self.held = True
            print(UNDER_WAY, file=sys.stderr, flush=True)
            sys.stdin.readline()


if __name__ == "__main__":
    scan.ProgressJournal = GatedJournal  # type: ignore[misc]
    main()
