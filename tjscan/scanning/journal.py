"""What a scan tells while it runs, to whoever writes it down or shows it."""

from __future__ import annotations

from typing import Protocol

from tjscan.scanning.section import ScannedSection, View


class Journal(Protocol):
    """Told of everything at once, in the order in which it happens."""

    def view(self, view: View) -> None:
        """Note that a profile was taken, before anybody tries to read it."""
        ...

    def section(self, scan: ScannedSection) -> None:
        """Note that a section is finished."""
        ...

    def event(self, name: str, detail: str) -> None:
        """Note that something out of the ordinary happened."""
        ...


class Journals:
    """Passes everything on to several journals, in their order.

    Parameters
    ----------
    *journals : Journal
        The one that writes to disk comes first.
    """

    def __init__(self, *journals: Journal) -> None:
        self._journals = journals

    def view(self, view: View) -> None:
        """Pass a profile on."""
        for journal in self._journals:
            journal.view(view)

    def section(self, scan: ScannedSection) -> None:
        """Pass a section on."""
        for journal in self._journals:
            journal.section(scan)

    def event(self, name: str, detail: str) -> None:
        """Pass an event on."""
        for journal in self._journals:
            journal.event(name, detail)
