"""What is handed on: true directions, stated units, and the same numbers in every format."""

import csv
import io
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from cells import CLOCKWISE, FAULTLESS, PAPER
from command import tjscan
from measured import ORIGIN
from PIL import Image

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.provenance import LengthUnit, Provenance
from tjscan.joint.edges import feature_edges
from tjscan.joint.file import read_joint
from tjscan.result.directions import tangents_along_line
from tjscan.result.directory import job_label_of_run
from tjscan.result.export import GROOVE_DOCUMENT, export_run
from tjscan.result.shapes import sort_sections_by_azimuth
from tjscan.result.summary import read_summary
from tjscan.result.table import read_sections_csv, write_sections_csv

CAD = Path(__file__).parent.parent.parent / "cad"
SCHEMA = Path(__file__).parent.parent.parent / "docs" / "export.schema.json"

OFF_INSIDE = np.radians(0.1)
"""A polynomial of third degree through sections 40 mm apart on a radius of 229 mm."""

OFF_AT_ENDS = np.radians(0.6)
"""The same at the ends of the chain, where neighbours stand on one side only."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scanned(tmp_path_factory.mktemp("runs") / "exact", PAPER)


def scanned(directory: Path, job: Path) -> Path:
    keys = {**FAULTLESS, "scan.sections": 9}
    options = [word for key, value in keys.items() for word in (f"--{key}", value)]
    assert tjscan("scan", job, "--out", directory, *options) == 0
    return directory


def document_of(run: Path, units: LengthUnit = "mm") -> dict[str, Any]:
    """The JSON that a run exports."""
    found: dict[str, Any] = json.loads(export_run(run, "json", units).read_bytes())
    return found


def column(document: dict[str, Any], name: str) -> Array:
    """A field's value of every section."""
    return np.array([section[name] for section in document["sections"]])


def between(a: Array, b: Array) -> Array:
    """Angles between unit vectors, shape (n,)."""
    return np.asarray(np.arccos(np.clip(np.sum(a * b, axis=1), -1, 1)))


@pytest.mark.parametrize("job", [PAPER, CLOCKWISE], ids=["counterclockwise", "clockwise"])
def test_directions_are_those_of_the_joint(job: Path, tmp_path: Path) -> None:
    document = document_of(scanned(tmp_path / "run", job))
    azimuths = column(document, "azimuth")
    assert (np.diff(azimuths) > 0).all()
    points = column(document, "points")
    p2, p4 = points[:, 1], points[:, 3]
    wall = p2 * (1, 1, 0) / np.hypot(p2[:, 0], p2[:, 1])[:, None]
    leg = p4 * (0, 1, 1) / np.hypot(p4[:, 1], p4[:, 2])[:, None]
    for truth, found in (
        (wall, column(document, "wall_normal")),
        (leg, column(document, "leg_normal")),
    ):
        off = between(truth, found)
        assert off[2:-2].max() < OFF_INSIDE
        assert off.max() < OFF_AT_ENDS
    tangent, bevel = column(document, "tangent"), column(document, "bevel_normal")
    # Counterclockwise seen from above, and along both faces that meet at p3.
    assert (np.cross(points[:, 2], tangent)[:, 2] > 0).all()
    np.testing.assert_allclose(np.sum(tangent * bevel, axis=1), 0, atol=2e-7)  # as printed
    assert (np.sum(bevel * (p4 - points[:, 2]), axis=1) > 0).all()  # out of the steel


@pytest.mark.parametrize(
    ("step", "inside", "at_ends"), [(5e-3, 0.3, 1.1), (20e-3, 0.3, 1.1), (80e-3, 1.2, 5.0)]
)
def test_nine_directions_of_ten_are_as_right_as_promised(
    step: float, inside: float, at_ends: float
) -> None:
    line = feature_edges(read_joint(CAD / "tjoint-600x457.toml")).p3.points_j
    along = np.concatenate(([0.0], np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum()))
    truth = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    rng, off = np.random.default_rng(3), []
    for start in rng.uniform(0, 0.5 * along[-1], 40):
        at = np.searchsorted(along, np.arange(start, start + 0.4 * along[-1], step))
        seen = line[at] + rng.normal(scale=50e-6, size=(len(at), 3))
        directions = truth[at] / np.linalg.norm(truth[at], axis=1, keepdims=True)
        off.append(np.degrees(between(directions, tangents_along_line(seen, directions))))
    assert np.percentile(np.concatenate([one[2:-2] for one in off]), 90) < inside
    assert np.percentile([one[[0, -1]] for one in off], 90) < at_ends


def test_vectors_have_length_one(run: Path) -> None:
    document = document_of(run)
    for name in ("tangent", "wall_normal", "bevel_normal", "leg_normal", "axes"):
        # They are printed with seven decimals.
        sizes = np.linalg.norm(column(document, name), axis=-1)
        np.testing.assert_allclose(sizes, 1, atol=1e-6)


def test_the_document_keeps_to_its_schema_and_says_what_it_holds(run: Path) -> None:
    text = export_run(run, "json").read_bytes()
    document = json.loads(text)
    again = GROOVE_DOCUMENT.model_validate_json(text).model_dump_json()
    assert json.loads(again) == document
    assert (document["schema_name"], document["version"]) == ("tjscan.groove", 3)
    stated = document["provenance"]
    assert (stated["length"], stated["angle"], stated["frame"]) == ("mm", "deg", "j")
    assert stated["job"] == job_label_of_run(run)
    assert stated["job"].startswith("paper.toml, SHA-256 ")
    assert document["run"] == run.name


def test_the_schema_is_the_one_in_the_documents() -> None:
    stated = json.loads(SCHEMA.read_text(encoding="utf-8"))
    assert stated == GROOVE_DOCUMENT.model_json_schema()


def test_the_document_agrees_with_the_sections_file(run: Path) -> None:
    sections, document = read_sections_csv(run / "sections.csv"), document_of(run)
    np.testing.assert_allclose(
        column(document, "points"), [1e3 * section.points for section in sections], atol=1e-6
    )
    covariances = [1e6 * section.covariances[:, *np.triu_indices(3)] for section in sections]
    np.testing.assert_allclose(column(document, "covariances"), covariances, rtol=1e-9)
    sigmas = [1e6 * section.sigmas[3] for section in sections]
    np.testing.assert_allclose(column(document, "sigma_area"), sigmas)


def test_metres_are_a_thousandth_of_millimetres(run: Path) -> None:
    large, small = document_of(run), document_of(run, "m")
    for name, power, printed in (
        ("points", 1, 1e-6),
        ("covariances", 2, 0),
        ("area", 2, 1e-3),
        ("s", 1, 1e-6),
        ("groove_angle", 0, 0),
        ("tangent", 0, 0),
    ):
        np.testing.assert_allclose(
            1e3**power * column(small, name), column(large, name), rtol=1e-9, atol=printed
        )


def test_the_table_is_flat_and_holds_the_same_numbers(run: Path) -> None:
    document = document_of(run, "m")
    text = export_run(run, "csv", "m").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert len(rows) == len(document["sections"])
    for row, section in zip(rows, document["sections"], strict=True):
        assert [float(row[f"p3{axis}_m"]) for axis in "xyz"] == section["points"][2]
        assert [float(row[f"leg_normal_{axis}"]) for axis in "xyz"] == section["leg_normal"]
        assert float(row["sigma_area_m2"]) == section["sigma_area"]
        xx, _, _, yy, _, zz = section["covariances"][1]
        assert float(row["sigma_p3_m"]) == pytest.approx(np.sqrt(xx + yy + zz), rel=2e-5)


def test_the_cloud_is_read_by_others_with_its_normals(run: Path) -> None:
    document = document_of(run)
    text = export_run(run, "ply").read_bytes()
    assert b"comment units: mm" in text
    assert b"comment frame: j" in text
    cloud = trimesh.load(io.BytesIO(text), file_type="ply", process=False)
    np.testing.assert_allclose(cloud.vertices, column(document, "points").reshape(-1, 3))
    data = cloud.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(
        data["corner"].ravel(), np.tile(np.arange(1, 6), len(document["sections"]))
    )
    np.testing.assert_array_equal(data["section"].ravel(), np.repeat(np.arange(9), 5))
    np.testing.assert_allclose(
        np.column_stack([data[f"n{axis}"].ravel() for axis in "xyz"])[3::5],
        column(document, "leg_normal"),
        atol=1e-6,
    )


def test_the_command_writes_a_file_or_says_why_not(run: Path, tmp_path: Path) -> None:
    for kind in ("csv", "ply", "json"):
        assert tjscan("export", run, "--to", kind, "--units", "m") == 0
        assert (run / f"export.{kind}").stat().st_size > 1000
    out = tmp_path / "mine.json"
    assert tjscan("export", run, "--to", "json", "--out", out) == 0
    assert json.loads(out.read_bytes())["provenance"]["length"] == "mm"
    assert tjscan("export", run, "--to", "json", "--out", tmp_path / "none" / "x.json") == 2
    assert tjscan("export", run, "--to", "json", "--out", tmp_path) == 2
    assert tjscan("export", run, "--to", "step") == 2
    assert tjscan("export", tmp_path, "--to", "json") == 2
    assert tjscan("export", tmp_path / "none", "--to", "json") == 2


def test_one_section_gives_no_direction(run: Path, tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_bytes((run / "summary.json").read_bytes())
    write_sections_csv(
        tmp_path / "sections.csv", read_sections_csv(run / "sections.csv")[:1], ORIGIN
    )
    with pytest.raises(ConfigurationError, match="two sections"):
        export_run(tmp_path, "json")


def test_without_its_extra_weldx_is_refused(
    run: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "weldx", None)  # as if it were not installed
    assert tjscan("export", run, "--to", "weldx", "--out", tmp_path / "x.weldx") == 2
    assert "tjscan[weldx]" in capsys.readouterr().err
    assert not (tmp_path / "x.weldx").exists()


# weldx leaves files to the garbage collector.
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_weldx_reads_the_frames_again(run: Path, tmp_path: Path) -> None:
    weldx = pytest.importorskip("weldx", reason="the extra tjscan[weldx] is not installed")
    file = tmp_path / "groove.weldx"
    assert tjscan("export", run, "--to", "weldx", "--units", "m", "--out", file) == 0
    sections = sort_sections_by_azimuth(read_sections_csv(run / "sections.csv"))
    with weldx.WeldxFile(file, mode="r") as made:
        assert made["groove"]["provenance"]["length"] == "m"
        frames = made["coordinate_systems"]
        assert len(frames.coordinate_system_names) == 1 + len(sections)
        for k, section in enumerate(sections):
            points = frames.get_data(f"points of section {k}", "joint").coordinates
            # Axes are printed with seven decimals, over some 70 mm.
            np.testing.assert_allclose(points.data.to("m").magnitude, section.points, atol=1e-7)


def test_a_picture_says_where_it_comes_from(run: Path) -> None:
    entries = Image.open(run / "scan.png").text  # type: ignore[attr-defined]
    assert entries["units"] == "mm, deg"
    assert entries["frame"].startswith("j ")
    assert entries["job"] == job_label_of_run(run)


def test_every_file_of_a_run_says_where_it_comes_from(run: Path) -> None:
    job = job_label_of_run(run)
    beside = json.loads((run / "sections.csv-metadata.json").read_text(encoding="utf-8"))
    assert beside["notes"][0]["job"] == job
    copied = (run / "job.toml").read_text(encoding="utf-8")
    cloud = (run / "groove.ply").read_bytes().split(b"end_header")[0].decode()
    for text, mark, frame in ((copied, "#", "b"), (cloud, "comment", "j")):
        found = Provenance.from_comment_lines(text, mark)
        assert found is not None
        assert (found.job, found.frame, found.length) == (job, frame, "mm")
    stated = read_summary(run / "summary.json").provenance
    assert stated is not None
    assert (stated.job, stated.frame) == (job, "j")


def test_files_of_a_run_of_an_older_version_are_read(run: Path, tmp_path: Path) -> None:
    old = tmp_path / "old"
    shutil.copytree(run, old)
    (old / "SHA256SUMS").unlink()
    for name in ("sections.csv", "job.toml"):
        lines = (run / name).read_text(encoding="utf-8").splitlines()
        kept = [line for line in lines if not line.startswith("#")]
        (old / name).write_text("\n".join([*kept, ""]), encoding="utf-8")
    summary = json.loads((old / "summary.json").read_text(encoding="utf-8"))
    del summary["provenance"]
    (old / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    assert document_of(old)["sections"] == document_of(run)["sections"]
    assert document_of(old)["provenance"]["job"].startswith("job.toml, SHA-256 ")
