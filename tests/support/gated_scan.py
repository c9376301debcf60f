"""``tjscan`` with a display that holds the scan in its first section until stdin has a line."""

from __future__ import annotations

import sys

from tjscan.cli import console, main
from tjscan.scanning.section import Substep, View

UNDER_WAY = "a section is under way"


class GatedJournal(console.ProgressJournal):
    held = False

    def view(self, view: View) -> None:
        super().view(view)
        if view.substep is Substep.PREDICTION and not self.held:
            self.held = True
            print(UNDER_WAY, file=sys.stderr, flush=True)
            sys.stdin.readline()


if __name__ == "__main__":
    console.ProgressJournal = GatedJournal  # type: ignore[misc]
    main()
