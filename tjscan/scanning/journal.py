"""What a scan tells while it runs, to whoever writes it down or shows it."""

from __future__ import annotations

from typing import Protocol

from tjscan.scanning.scan import Scan, View


class Journal(Protocol):
    """Told of everything at once, in the order in which it happens."""

    def view(self, view: View) -> None:
        """Note that a profile was taken, before anybody tries to read it."""
        ...

    def section(self, scan: Scan) -> None:
        """Note that a section is finished."""
        ...

    def event(self, name: str, detail: str) -> None:
        """Note that something out of the ordinary happened."""
        ...
