"""The schemas that editors check files by, held by a validator of another make."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from command import tjscan
from jsonschema import Draft202012Validator

from tjscan.job.reading import FILE_KINDS, kind_of_other_file

ROOT = Path(__file__).parents[2]
CRAWLS = ("crawl", "crawl-paper-initial", "crawl-paper-final")
SCANS = ("paper", "ur10e", "whole-joint", "kr5_arc", "irb1600_10_145", "m10ia")
FILES = {
    "joint": sorted((ROOT / "cad").glob("*.toml")),
    "scan": [ROOT / "examples" / f"{name}.toml" for name in SCANS],
    "weld": [ROOT / "examples" / "weld.toml"],
    "recorded": [ROOT / "examples" / "calibrate-recorded.toml"],
    "accept": [ROOT / "examples" / "accept.toml"],
    "calibrate": [ROOT / "examples" / "calibrate.toml"],
    "crawl": [ROOT / "examples" / f"{name}.toml" for name in CRAWLS],
    "tow": [ROOT / "examples" / f"tow-{name}.toml" for name in ("simulation", "yard", "passer-by")],
    "chain": [ROOT / "examples" / "paper-chain.toml"],
    "study": [ROOT / "examples" / "paper-study.toml"],
    "wps": [ROOT / "examples" / "wps.toml"],
}


@pytest.fixture(params=[kind.word for kind in FILE_KINDS])
def kind(request: pytest.FixtureRequest) -> str:
    """Each kind of file."""
    return str(request.param)


def _schema(kind: str, capsys: pytest.CaptureFixture[str]) -> Any:
    assert tjscan("schema", kind) == 0
    return json.loads(capsys.readouterr().out)


def test_examples_keep_to_their_schema_and_a_typo_does_not(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    schema = _schema(kind, capsys)
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)
    for file in FILES[kind]:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
        assert validator.is_valid(data), file
        assert not validator.is_valid(data | {"typo": 1})


def test_a_file_is_told_from_other_kinds_by_its_tables(kind: str) -> None:
    for file in FILES[kind]:
        told = kind_of_other_file(tomllib.loads(file.read_text(encoding="utf-8")), ())
        assert told is not None
        assert told.word == kind


def test_defaults_and_explanations_are_in_the_units_of_the_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tables = _schema("scan", capsys)["$defs"]
    assert tables["AdaptiveStepSettings"]["properties"]["least_mm"]["default"] == 10.0
    said = tables["AdaptiveStepSettings"]["properties"]["least_mm"]["description"]
    assert said == "Shortest and longest step."
    arm = _schema("scan", capsys)["properties"]["arm"]["properties"]
    assert "ur" in arm["driver"]["enum"]
    assert "drivers" not in arm


def test_no_explanation_speaks_of_units_that_are_not_in_files(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = json.dumps(_schema(kind, capsys))
    assert not re.search(r"\b(metres|radians)\b|;\.", text, re.IGNORECASE)


def test_an_unknown_kind_is_named_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert tjscan("schema", "scna") == 2
    assert "did you mean: scan?" in capsys.readouterr().err
