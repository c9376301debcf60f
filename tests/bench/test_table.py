"""What every bench prints, and when."""

import json
from collections.abc import Iterator
from math import inf, nan

import pytest
from _table import Row, main

HOLDS, FAILS, UNKNOWN = Row("a", 1.0, 2.0, "mm"), Row("b", 3.0, 2.0), Row("c", nan, inf)


def test_each_row_is_printed_as_it_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    def measure() -> Iterator[Row]:
        yield HOLDS
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        main("bench", measure, [])
    title, row = capsys.readouterr().out.split("\n")[1:3]
    assert title == "bench"
    assert row.split() == ["a", "1", "mm", "≤", "2", "mm", "holds"]


@pytest.mark.parametrize(("row", "code"), [(HOLDS, 0), (FAILS, 1), (UNKNOWN, 1)])
def test_it_ends_in_1_where_a_row_does_not_hold_and_says_so_as_json(
    row: Row, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main("bench", lambda: [HOLDS, row], ["--json"]) == code
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [one["holds"] for one in rows] == [True, code == 0]
    assert rows[1]["measured"] == (None if row is UNKNOWN else row.measured)


def test_an_unknown_option_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main("bench", lambda: [], ["--jsn"]) == 2
    assert "--jsn" in capsys.readouterr().err
