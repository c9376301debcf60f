"""``tjscan plan``: its files, exit codes and messages."""

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import tjscan
from procedures import WPS_TEXT, wps_beside

from tjscan.core.manifest import MANIFEST_FILE, manifest_text
from tjscan.planning.document import PlanDocument
from tjscan.result.directory import CLOUD_FILE, SECTIONS_FILE
from tjscan.result.shapes import read_run_shape
from tjscan.result.table import read_sections_csv, sections_to_csv

ROOT = Path(__file__).parent.parent.parent
RUN = ROOT / "tests" / "data" / "run-0.1.0"
SCHEMA = ROOT / "docs" / "plan.schema.json"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    directory = tmp_path / "run"
    shutil.copytree(RUN, directory)
    return directory


def planned(run: Path, *options: object, wps: Path | None = None) -> int:
    return tjscan(
        "plan", run, "--wps", wps or wps_beside(run), "--gravity", 0, 0, -1, "--no-reach", *options
    )


def test_the_schema_is_the_one_in_the_documents() -> None:
    stated = json.loads(SCHEMA.read_text(encoding="utf-8"))
    assert stated == PlanDocument.model_json_schema()


def test_a_plan_leaves_files_that_agree(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert planned(run) in (0, 3)
    printed = capsys.readouterr()
    assert "arc on for" in printed.out
    document = PlanDocument.model_validate_json((run / "plan.json").read_bytes())
    lines = (run / "beads.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert {int(row["bead"]) for row in rows} == {bead.number for bead in document.beads}
    # Another reading of the same file: what the wire brings at its speed is the area stated.
    wire = 0.25 * np.pi * 1.2**2 * 0.95
    for row in rows:
        speed, feed = float(row["speed_mm_min"]), 1e3 * float(row["feed_m_min"])
        assert wire * feed / speed == pytest.approx(float(row["area_mm2"]), rel=1e-4)
        assert 240 <= speed <= 420
    assert (run / "plan.png").is_file()
    page = (run / "plan.html").read_text(encoding="utf-8")
    assert f"<b>{len(document.beads)} beads</b>" in page
    assert "http" not in page.split("</style>")[1]  # it loads nothing


def test_nothing_of_an_earlier_plan_stays_beside_a_new_one(run: Path) -> None:
    """Its program would be of other beads, other speeds, or switch the arc."""
    earlier = [run / name for name in ("plan.urscript", "plan-left.urscript", "plan-passes.toml")]
    for file in earlier:
        file.write_text("of an earlier plan", encoding="utf-8")
    (run / MANIFEST_FILE).write_text(manifest_text(run, run), encoding="utf-8")
    (run / "plan of mine.txt").touch()
    assert planned(run) in (0, 3)
    assert not [file for file in earlier if file.exists()]
    assert "urscript" not in (run / MANIFEST_FILE).read_text(encoding="utf-8")
    assert (run / "plan of mine.txt").is_file()


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda text: text.replace('"version": 3', '"version": 2'), "run `tjscan plan` again"),
        (lambda text: text.replace('"wire_kg"', '"wire_lb"'), "run `tjscan plan` again"),
        (lambda text: text[: len(text) // 2], "is no plan"),
    ],
)
def test_a_plan_that_is_damaged_or_older_is_refused(
    spoil: Callable[[str], str], says: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert planned(run, "--out", run / "plan") in (0, 3)
    file = run / "plan" / "plan.json"
    (run / "plan" / "plan.html").unlink()
    assert tjscan("report", run / "plan") == 0
    assert (run / "plan" / "plan.html").is_file()
    (run / "plan" / "SHA256SUMS").unlink(missing_ok=True)
    file.write_text(spoil(file.read_text(encoding="utf-8")), encoding="utf-8")
    capsys.readouterr()
    assert tjscan("report", run / "plan") == 2
    message = capsys.readouterr().err
    assert says in message
    assert "plan.json" in message


def test_what_is_out_of_the_wps_is_named_and_ends_with_3(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wps = tmp_path / "wps.toml"
    text = WPS_TEXT.replace('["PA", "PB", "PC", "PF", "PG"]', '["PG"]')
    wps.write_text(text, encoding="utf-8")
    assert planned(run, wps=wps) == 3
    assert "sequence.positions" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--output", 9), "--output: must be 0 to 7"),
        (("--gravity", 0, 0, 0), "--gravity: must be a direction"),
    ],
)
def test_wrong_options_are_refused(
    options: tuple[object, ...], says: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("plan", run, "--wps", wps_beside(run))
    gravity = () if options[0] == "--gravity" else ("--gravity", 0, 0, -1)
    assert tjscan(*given, *gravity, *options) == 2
    assert says in capsys.readouterr().err


def test_a_key_that_fits_nothing_is_told_with_its_file(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wps = tmp_path / "wps.toml"
    text = WPS_TEXT.replace("[2.0, 6.5]", "[50.0, 60.0]")
    wps.write_text(text, encoding="utf-8")
    assert planned(run, wps=wps) == 2
    message = capsys.readouterr().err
    assert f"{wps}: bead.layer_height_mm: at s = 0 mm" in message
    assert not (run / "plan.json").exists()


def test_a_groove_with_weld_in_it_needs_the_passes_that_were_welded(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its toes are no corners of the root: they do not count where it is compared either."""
    file = run / SECTIONS_FILE
    sections = list(read_sections_csv(file))
    sections[2] = replace(sections[2], conditions=("weld in the groove",))
    file.write_text(sections_to_csv(sections, "mm"), encoding="utf-8")
    (run / MANIFEST_FILE).unlink(missing_ok=True)
    assert planned(run) == 2
    message = capsys.readouterr().err
    assert "--after-pass: 1 of " in message
    assert "state how many passes are welded" in message
    assert planned(run, "--after-pass", 1) in (0, 3)
    points = "\n".join(f"{x} {y} {z}" for x, y, z in np.eye(3))
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
    header += "property float y\nproperty float z\nend_header\n"
    (run / CLOUD_FILE).write_text(header + points + "\n", encoding="utf-8")
    absent = np.asarray(read_run_shape(run).absent)
    assert absent[2].tolist() == [False, True, True]
    assert not absent[0].any()
