"""``tjscan compare`` as a user types it: files, units, frames, and what it ends with."""

import json
import os
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cells import FAULTLESS, PAPER
from command import tjscan
from matplotlib.figure import Figure

from tjscan.comparison.shapes import UserUnitAndFrame
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.result.shapes import read_shape

CAD = Path(__file__).parent.parent.parent / "cad" / "tjoint-600x457.toml"

NOISE = 0.03
"""Millimetres: standard deviation of the range put into the simulated laser."""

ROUNDED = 1e-4
"""Millimetres: files are written with four decimals, PLY in single precision of some 700 mm."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of five sections whose only faults are the range's noise."""
    directory = tmp_path_factory.mktemp("runs") / "noisy"
    keys = {**FAULTLESS, "simulation.laser.noise_mm": NOISE, "scan.sections": 5}
    options = [word for key, value in keys.items() for word in (f"--{key}", value)]
    assert tjscan("scan", PAPER, "--out", directory, *options) == 0
    return directory


@pytest.fixture(scope="module")
def cad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example's joint, built."""
    directory = tmp_path_factory.mktemp("cad")
    assert tjscan("joint", CAD, "--out", directory) == 0
    return directory


def compared(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, dict[str, float]]:
    """What the command says of each kind of distance."""
    capsys.readouterr()
    assert tjscan("compare", *arguments, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    return {d["kind"]: d for d in told["deviations"]}


def test_a_scan_is_within_its_noise_of_the_joint(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = compared(capsys, run, CAD)
    surface = found["cloud to mesh"]
    # The range's noise is along the ray, so square to the surface it is never larger. A tenth
    # more is chance, for some 3000 points.
    assert surface["rms_mm"] < 1.1 * NOISE
    assert abs(surface["mean_mm"]) < 0.1 * NOISE
    assert surface["signed"]
    assert found["corners to feature edges"]["p95_mm"] < 4 * NOISE


def test_every_way_to_name_the_joint_gives_the_same(
    run: Path, cad: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [f"tjoint-600x457.{kind}" for kind in ("stl", "ply", "json")]
    first, *others = [compared(capsys, run, file) for file in (CAD, *(cad / n for n in names))]
    for other in others:
        for kind, told in first.items():
            assert other[kind]["rms_mm"] == pytest.approx(told["rms_mm"], abs=ROUNDED)
    edges = compared(capsys, run, cad / "edges.csv")
    assert list(edges) == ["corners to feature edges"]
    corners = first["corners to feature edges"]["mean_mm"]
    assert edges["corners to feature edges"]["mean_mm"] == pytest.approx(corners, abs=ROUNDED)


def test_corners_are_compared_with_a_cloud_as_in_the_paper(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud = tmp_path / "camera.csv"
    points = read_shape(run).points
    assert points is not None
    np.savetxt(cloud, 1e3 * points, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    found = compared(capsys, run, cloud, "--frame", "j")
    assert found["cloud to cloud"]["max_mm"] < ROUNDED
    assert 0 < found["corners to reference cloud"]["mean_mm"] < 1
    assert not found["corners to reference cloud"]["signed"]


def test_a_cloud_of_this_program_states_its_unit(run: Path, tmp_path: Path) -> None:
    alone = shutil.copyfile(run / "groove.ply", tmp_path / "alone.ply")
    cloud = read_shape(alone, UserUnitAndFrame(frame="j"))
    assert (cloud.stated.unit, cloud.stated.unit_source) == ("mm", "its header")


def test_tolerance_decides_between_0_and_3(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert tjscan("compare", run, CAD, "--tolerance-mm", 1) == 0
    assert "within the tolerance" in capsys.readouterr().out
    assert tjscan("compare", run, CAD, "--tolerance-mm", 0.0001) == 3
    assert "OUTSIDE" in capsys.readouterr().out
    assert tjscan("compare", run, CAD, "--tolerance-mm", -1) == 2


def test_icp_from_a_true_pose_stays_there(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert tjscan("compare", run, CAD, "--align", "icp", "--json") == 0
    alignment = json.loads(capsys.readouterr().out)["alignment"]
    # The noise is correlated along a profile: a few dozen numbers are independent, not thousands.
    assert alignment["moved_mm"] < NOISE
    assert alignment["fitness"] > 0.95


def test_the_picture_is_drawn_where_azimuths_are(run: Path, tmp_path: Path) -> None:
    picture = tmp_path / "map.png"
    assert tjscan("compare", run, CAD, "--plot", picture, pictures=True) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert tjscan("compare", run, CAD, "--plot", tmp_path / "map.docx") == 2


def test_the_hours_of_a_picture_are_where_they_are_on_the_clock(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of a part of the joint that is shorter than an hour."""
    drawn: list[Figure] = []
    keep = "tjscan.comparison.maps.write_deviation_map"
    monkeypatch.setattr(keep, lambda _, figure: drawn.append(figure))
    tjscan("compare", run, CAD, "--plot", tmp_path / "map.png", pictures=True)
    axes = drawn[0].axes[0]
    (clock,) = axes.child_axes
    low, high = axes.get_xlim()
    labels = [tick.get_text() for tick in clock.get_xticklabels()]
    for hour, label in zip(clock.get_xticks(), labels, strict=True):
        assert low <= 30 * hour <= high
        assert hour % 12 == int(label) % 12


def test_a_picture_that_cant_be_written_is_refused_before_anything_is_computed(
    run: Path, cad: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("compare", run, CAD, "--plot", tmp_path / "none" / "map.png") == 2
    assert "folder does not exist" in capsys.readouterr().err
    (tmp_path / "map.png").mkdir()
    assert tjscan("compare", run, CAD, "--plot", tmp_path / "map.png") == 2
    # Azimuths are known only once both are read: the comparison is told before that is refused.
    options = ("--units", "mm", "--frame", "hall", "--align", "icp", "--plot", tmp_path / "m.png")
    shutil.copyfile(cad / "tjoint-600x457.stl", tmp_path / "cad.stl")
    assert tjscan("compare", run, tmp_path / "cad.stl", *options) == 2
    assert "cloud to mesh" in capsys.readouterr().out


def test_a_name_that_looks_like_a_formula_is_drawn_as_it_is(run: Path, tmp_path: Path) -> None:
    odd = tmp_path / r"$\frac$ & <b>"
    shutil.copytree(run, odd)
    assert tjscan("compare", odd, CAD, "--plot", tmp_path / "map.png", pictures=True) == 0


def write_xyz(file: Path, points: Array) -> None:
    np.savetxt(file, points)


def write_csv(file: Path, points: Array) -> None:
    np.savetxt(file, points, delimiter=",", header="# by hand\nx,y,z", comments="")


def with_decimal_commas(write: Callable[[Path, Array], None]) -> Callable[[Path, Array], None]:
    """The same file as a spreadsheet in Europe writes it."""

    def write_with_commas(file: Path, points: Array) -> None:
        write(file, points)
        text = file.read_text(encoding="utf-8").replace(",", ";").replace(".", ",")
        file.write_text(text, encoding="utf-8")

    return write_with_commas


def write_pcd(file: Path, points: Array) -> None:
    head = [
        "VERSION .7",
        "FIELDS x y z",
        "SIZE 8 8 8",
        "TYPE F F F",
        "COUNT 1 1 1",
        f"WIDTH {len(points)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(points)}",
        "DATA ascii",
    ]
    rows = [" ".join(map(str, point)) for point in points.tolist()]
    file.write_text("\n".join([*head, *rows]) + "\n", encoding="ascii")


def write_ply(file: Path, points: Array) -> None:
    file.write_bytes(trimesh.PointCloud(points).export(file_type="ply"))


CLOUDS: dict[str, Callable[[Path, Array], None]] = {
    "xyz": write_xyz,
    "commas.xyz": with_decimal_commas(write_xyz),
    "semicolons.xyz": with_decimal_commas(
        lambda file, points: np.savetxt(file, points, delimiter=",")
    ),
    "csv": write_csv,
    "semicolons.csv": with_decimal_commas(write_csv),
    "pcd": write_pcd,
    "ply": write_ply,
}


@pytest.mark.parametrize("kind", CLOUDS)
def test_clouds_come_back_as_they_were_written(kind: str, tmp_path: Path) -> None:
    points = np.random.default_rng(1).uniform(-300, 300, (50, 3))
    file = tmp_path / f"cloud.{kind}"
    CLOUDS[kind](file, points)
    with pytest.raises(ConfigurationError, match="--units"):
        read_shape(file, UserUnitAndFrame(frame="j"))
    with pytest.raises(ConfigurationError, match="--frame"):
        read_shape(file, UserUnitAndFrame(units="mm"))
    found = read_shape(file, UserUnitAndFrame("mm", "j"))
    assert found.points is not None
    np.testing.assert_allclose(found.points, 1e-3 * points, atol=1e-3 * ROUNDED)


@pytest.mark.parametrize("kind", ["stl", "ply", "obj", "3mf"])
def test_meshes_come_back_as_they_were_written(kind: str, tmp_path: Path) -> None:
    file = tmp_path / f"box.{kind}"
    trimesh.creation.box((100, 200, 300)).export(file)
    told = UserUnitAndFrame(None if kind == "3mf" else "mm", "j")  # 3MF states its unit
    mesh = read_shape(file, told).mesh
    assert mesh is not None
    assert len(mesh.triangles) == 12
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), (0.1, 0.2, 0.3), atol=1e-9)


def test_a_sidecar_states_units_and_frame(tmp_path: Path) -> None:
    file = tmp_path / "box.stl"
    trimesh.creation.box((1, 2, 3)).export(file)
    file.with_suffix(".json").write_text('{"units": "m", "frame": "hall"}', encoding="utf-8")
    found = read_shape(file)
    assert (found.stated.unit, found.stated.frame) == ("m", "hall")
    assert found.extent == pytest.approx(np.sqrt(14))


@pytest.mark.parametrize("units", ["m", "um"])
def test_mistaken_units_end_with_2(
    run: Path, cad: Path, tmp_path: Path, units: str, capsys: pytest.CaptureFixture[str]
) -> None:
    stranger = tmp_path / "stranger.stl"
    shutil.copyfile(cad / "tjoint-600x457.stl", stranger)
    assert tjscan("compare", run, stranger, "--units", "mm", "--frame", "j") == 0
    assert tjscan("compare", run, stranger, "--units", units, "--frame", "j") == 2
    assert "units" in capsys.readouterr().err
    cloud = tmp_path / "cloud.xyz"
    points = read_shape(run).points
    assert points is not None
    np.savetxt(cloud, 1e3 * points)
    assert tjscan("compare", cloud, CAD, "--units", units, "--frame", "j") == 2


CUT_PLY = b"""ply
format ascii 1.0
element vertex 1000
property float x
property float y
property float z
end_header
0 0 0
900 0 0
0 900 0
"""


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.ply", b""),
        ("cut.ply", CUT_PLY),
        ("noise.ply", bytes(range(256))),
        ("cut.stl", b"solid x\nfacet normal 0 0"),
        ("noise.pcd", b"VERSION nothing"),
        ("words.xyz", b"these are words"),
        ("empty.xyz", b"# nothing\n"),
        ("columns.csv", b"a,b,c\n1,2,3\n"),
        ("words.csv", b"# a comment\nx,y,z\none,two,three\n"),
        ("nowhere.csv", b"x,y,z\nnan,nan,nan\n"),
        ("noise.3mf", b"PK"),
        ("faceless.obj", b"f 1 2 3\n"),
        ("mixed.csv", b"x_mm,y_m,z_mm\n1,2,3\n"),
        ("noise.step", b"ISO-10303-21;"),
        ("noise.e57", b"ASTM-E57"),
        ("table.json", b"[]"),
        ("picture.png", b"\x89PNG"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*input contained no data:UserWarning")
def test_damaged_files_end_with_2(
    name: str, content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / name
    file.write_bytes(content)
    assert tjscan("compare", file, CAD, "--units", "mm", "--frame", "j") == 2
    assert name in capsys.readouterr().err or name.endswith((".step", ".e57"))


def test_what_is_not_there_or_makes_no_sense_ends_with_2(
    run: Path, cad: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("compare", tmp_path / "none.ply", CAD) == 2
    assert tjscan("compare", tmp_path, CAD) == 2  # a directory that is no run
    assert tjscan("compare", run.parent, CAD) == 2  # stations that nobody stitched
    assert "tjscan stitch" in capsys.readouterr().err
    assert tjscan("compare", run, tmp_path / "none.toml") == 2
    assert tjscan("compare", cad / "tjoint-600x457.stl", CAD) == 2  # a mesh is no measurement
    assert tjscan("compare", run / "groove.ply", cad / "edges.csv") == 2  # no corners
    assert tjscan("compare", run, CAD, "--align", "guess") == 2


def test_a_3mf_in_inches_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "inch.3mf"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("3D/3dmodel.model", '<model unit="inch" xml:lang="en-US"></model>')
    with pytest.raises(ConfigurationError, match="inch"):
        read_shape(file, UserUnitAndFrame("mm", "j"))


def test_an_archive_that_unpacks_without_bound_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "bomb.3mf"
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("3D/3dmodel.model", "w") as part,
    ):
        for _ in range(501):
            part.write(bytes(1_000_000))
    with pytest.raises(ConfigurationError, match="unpacks to 501000000 bytes"):
        read_shape(file, UserUnitAndFrame("mm", "j"))


def test_what_a_mesh_names_beside_it_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mtl")  # reading it would wait for ever
    file = tmp_path / "mesh.obj"
    file.write_text("mtllib pipe.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    mesh = read_shape(file, UserUnitAndFrame("mm", "j")).mesh
    assert mesh is not None
    assert len(mesh.triangles) == 1


def test_e57_is_in_metres_by_its_standard(tmp_path: Path) -> None:
    pye57 = pytest.importorskip("pye57")
    points = np.random.default_rng(1).uniform(-0.3, 0.3, (50, 3))
    file = pye57.E57(str(tmp_path / "scan.e57"), mode="w")
    file.write_scan_raw({f"cartesian{axis}": points[:, i] for i, axis in enumerate("XYZ")})
    file.close()
    found = read_shape(tmp_path / "scan.e57", UserUnitAndFrame(frame="j"))
    assert found.points is not None
    np.testing.assert_allclose(found.points, points, atol=1e-7)  # single precision
