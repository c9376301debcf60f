"""Every file that states the version states the same."""

import re

from documented import ROOT

from tjscan.core.version import PROGRAM_VERSION


def test_changelog_and_citation_state_the_version_of_the_program() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    versions = re.findall(r"^## (\S+)", changelog, re.MULTILINE)
    assert versions[0] == PROGRAM_VERSION
    assert re.findall(r"^version: (\S+)", citation, re.MULTILINE) == [PROGRAM_VERSION]
