"""What a file says of itself is read again as it was written."""

from datetime import UTC, datetime

import pytest

from tjscan.core.provenance import LengthUnit, Provenance
from tjscan.core.version import PROGRAM_VERSION


@pytest.mark.parametrize("frame", ["j", "b", "w", "x"])
@pytest.mark.parametrize("length", ["mm", "m"])
@pytest.mark.parametrize("mark", ["#", "comment"])
def test_lines_come_back(mark: str, length: LengthUnit, frame: str) -> None:
    before = datetime.now(UTC).replace(microsecond=0)
    stated = Provenance.for_file_written_now(
        "yard 3, leg: A.toml, SHA-256 0123456789abcdef", frame, length
    )
    lines = stated.comment_lines(mark)
    assert all(line.startswith(f"{mark} ") for line in lines.splitlines())
    assert Provenance.from_comment_lines(f"{lines}the rest: of the file", mark) == stated
    assert stated.program == f"tjscan {PROGRAM_VERSION}"
    assert before <= stated.written <= datetime.now(UTC)


def test_a_name_of_many_lines_stays_in_one() -> None:
    stated = Provenance.for_file_written_now("a\n# frame: b\nend_header", "j")
    assert len(stated.comment_lines("#").splitlines()) == len(stated.header_entries)
    found = Provenance.from_comment_lines(stated.comment_lines("#"), "#")
    assert found is not None
    assert found.frame == "j"


@pytest.mark.parametrize("text", ["", "index,station", "# units: mm, deg", "# note: nothing"])
def test_a_file_without_them_says_nothing(text: str) -> None:
    assert Provenance.from_comment_lines(text, "#") is None
