"""What is handed on: true directions, stated units, and the same numbers in every format."""

import csv
import importlib.util
import io
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cells import CLOCKWISE, FAULTLESS, PAPER
from command import tjscan

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.export.document import GrooveDocument, document_of
from tjscan.export.files import to_csv, to_json, to_ply
from tjscan.export.surfaces import direction_along
from tjscan.joint.edges import feature_edges
from tjscan.joint.file import read_joint
from tjscan.result.sections import read_sections, write_sections

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


def between(a: Array, b: Array) -> Array:
    """Angles between unit vectors, shape (n,)."""
    return np.asarray(np.arccos(np.clip(np.sum(a * b, axis=1), -1, 1)))


@pytest.mark.parametrize("job", [PAPER, CLOCKWISE], ids=["counterclockwise", "clockwise"])
def test_directions_are_those_of_the_joint(job: Path, tmp_path: Path) -> None:
    sections = document_of(scanned(tmp_path / "run", job)).sections
    azimuths = [section.azimuth for section in sections]
    assert azimuths == sorted(azimuths)  # type: ignore[type-var]
    points = np.array([section.points for section in sections])
    p2, p4 = points[:, 1], points[:, 3]
    wall = p2 * (1, 1, 0) / np.hypot(p2[:, 0], p2[:, 1])[:, None]
    leg = p4 * (0, 1, 1) / np.hypot(p4[:, 1], p4[:, 2])[:, None]
    for truth, found in (
        (wall, [section.normals.wall for section in sections]),
        (leg, [section.normals.leg for section in sections]),
    ):
        off = between(truth, np.array(found))
        assert off[2:-2].max() < OFF_INSIDE
        assert off.max() < OFF_AT_ENDS
    tangent = np.array([section.tangent for section in sections])
    bevel = np.array([section.normals.bevel for section in sections])
    # Counterclockwise seen from above, and along both faces that meet at p3.
    assert (np.cross(points[:, 2], tangent)[:, 2] > 0).all()
    np.testing.assert_allclose(np.sum(tangent * bevel, axis=1), 0, atol=1e-9)
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
        off.append(np.degrees(between(directions, direction_along(seen, directions))))
    assert np.percentile(np.concatenate([one[2:-2] for one in off]), 90) < inside
    assert np.percentile([one[[0, -1]] for one in off], 90) < at_ends


def test_vectors_have_length_one(run: Path) -> None:
    for section in document_of(run).sections:
        n = section.normals
        for vector in (section.tangent, n.wall, n.bevel, n.leg, *section.frame_g.axes):
            # Axes of g are printed with seven decimals in sections.csv.
            assert np.linalg.norm(vector) == pytest.approx(1, abs=1e-6)


def test_the_document_comes_back_and_says_what_it_holds(run: Path) -> None:
    document = document_of(run)
    assert GrooveDocument.model_validate_json(to_json(document)) == document
    told = json.loads(to_json(document))
    assert (told["schema_name"], told["version"]) == ("tjscan.groove", 1)
    assert told["units"] == {"length": "mm", "angle": "deg"}
    assert told["frame"] == "j"
    assert told["run"] == run.name


def test_the_schema_is_the_one_in_the_documents() -> None:
    stated = json.loads(SCHEMA.read_text(encoding="utf-8"))
    assert stated == GrooveDocument.model_json_schema()


def test_the_document_agrees_with_the_sections_file(run: Path) -> None:
    for was, now in zip(
        read_sections(run / "sections.csv"), document_of(run).sections, strict=True
    ):
        np.testing.assert_allclose(now.points, 1e3 * was.points, atol=1e-6)
        np.testing.assert_allclose(now.corner_covariances, 1e6 * was.covariances, rtol=1e-9)
        assert now.sigmas.area == pytest.approx(1e6 * was.sigmas[3])


def test_metres_are_a_thousandth_of_millimetres(run: Path) -> None:
    for large, small in zip(document_of(run).sections, document_of(run, "m").sections, strict=True):
        np.testing.assert_allclose(1e3 * np.array(small.points), large.points, atol=1e-6)
        np.testing.assert_allclose(
            1e6 * np.array(small.corner_covariances), large.corner_covariances, rtol=1e-9
        )
        assert 1e6 * small.measures.area == pytest.approx(large.measures.area)
        assert 1e3 * small.s == pytest.approx(large.s)
        assert small.measures.groove_angle == large.measures.groove_angle
        assert small.tangent == large.tangent


def test_the_table_is_flat_and_holds_the_same_numbers(run: Path) -> None:
    document = document_of(run, "m")
    rows = list(csv.DictReader(io.StringIO(to_csv(document).decode())))
    assert len(rows) == len(document.sections)
    for row, section in zip(rows, document.sections, strict=True):
        assert row["frame"] == "j"
        assert [float(row[f"p3{axis}_m"]) for axis in "xyz"] == list(section.points[2])
        assert [float(row[f"leg_normal_{axis}"]) for axis in "xyz"] == list(section.normals.leg)
        assert float(row["sigma_area_m2"]) == section.sigmas.area
        sigma = np.sqrt(np.trace(np.array(section.corner_covariances[1])))
        assert float(row["sigma_p3_m"]) == pytest.approx(sigma, rel=1e-5)


def test_the_cloud_is_read_by_others_with_its_normals(run: Path) -> None:
    document = document_of(run)
    text = to_ply(document)
    assert b"comment units mm" in text
    assert b"comment frame j" in text
    cloud = trimesh.load(io.BytesIO(text), file_type="ply", process=False)
    points = np.array([section.points for section in document.sections]).reshape(-1, 3)
    np.testing.assert_allclose(cloud.vertices, points)
    data = cloud.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(
        data["corner"].ravel(), np.tile(np.arange(1, 6), len(document.sections))
    )
    np.testing.assert_array_equal(data["section"].ravel(), np.repeat(np.arange(9), 5))
    np.testing.assert_allclose(
        np.column_stack([data[f"n{axis}"].ravel() for axis in "xyz"])[3::5],
        [section.normals.leg for section in document.sections],
        atol=1e-6,
    )


def test_the_command_writes_a_file_or_says_why_not(run: Path, tmp_path: Path) -> None:
    for kind in ("csv", "ply", "json"):
        assert tjscan("export", run, "--to", kind, "--units", "m") == 0
        assert (run / f"export.{kind}").stat().st_size > 1000
    out = tmp_path / "mine.json"
    assert tjscan("export", run, "--to", "json", "--out", out) == 0
    assert GrooveDocument.model_validate_json(out.read_bytes()).units.length == "mm"
    assert tjscan("export", run, "--to", "json", "--out", tmp_path / "none" / "x.json") == 2
    assert tjscan("export", run, "--to", "json", "--out", tmp_path) == 2
    assert tjscan("export", run, "--to", "step") == 2
    assert tjscan("export", tmp_path, "--to", "json") == 2
    assert tjscan("export", tmp_path / "none", "--to", "json") == 2


def test_one_section_tells_no_direction(run: Path, tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_bytes((run / "summary.json").read_bytes())
    write_sections(tmp_path / "sections.csv", read_sections(run / "sections.csv")[:1])
    with pytest.raises(ConfigurationError, match="two sections"):
        document_of(tmp_path)


@pytest.mark.skipif(
    importlib.util.find_spec("weldx") is not None, reason="weldx is installed: nothing to refuse"
)
def test_without_its_extra_weldx_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
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
    document = document_of(run, "m")
    with weldx.WeldxFile(file, mode="r") as made:
        assert made["groove"]["units"]["length"] == "m"
        frames = made["coordinate_systems"]
        assert len(frames.coordinate_system_names) == 1 + len(document.sections)
        for section in document.sections:
            points = frames.get_data(f"points of section {section.index}", "joint").coordinates
            # Axes are printed with seven decimals, over some 70 mm.
            np.testing.assert_allclose(points.data.to("m").magnitude, section.points, atol=1e-7)
