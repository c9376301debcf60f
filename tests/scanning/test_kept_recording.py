"""A recording that is kept in the repository is read, replayed, resumed and reprocessed.

It was made by an early reader, and its form is today's: a change of the form is noticed here.
"""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
from command import tjscan

from tjscan.core.frames import inverse_pose, transform_points
from tjscan.groove.read import read_groove
from tjscan.job.files import read_scan_job
from tjscan.recording.header import FORMAT_VERSION
from tjscan.recording.reader import read_header
from tjscan.scanning.recording import read_recorded_scan

KEPT = Path(__file__).parents[1] / "data" / "run-0.1.0"
READERS = 3e-3
"""Metres: the early reader placed corners, and the ends of the sides most of all, elsewhere."""
READERS_MM = 1e3 * READERS
IN_FILE_MM = 2e-4
"""sections.csv has four decimals."""
INTERRUPTED = 0.55
"""Share of the recording that a scan left behind which broke off after its second section."""


@pytest.fixture
def old(tmp_path: Path) -> Path:
    return Path(shutil.copytree(KEPT, tmp_path / "old"))


def corners(run: Path) -> np.ndarray:
    with (run / "sections.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    return np.array([[float(v) for k, v in row.items() if k.startswith("p")] for row in rows])


def test_it_is_read(old: Path) -> None:
    head = read_header(old / "scan.mcap")
    assert head is not None
    assert head.format == FORMAT_VERSION
    scan = read_recorded_scan(old)
    assert (len(scan.views), list(scan.sections)) == (6, [0, 1, 2, 3])
    assert scan.stop_detail.startswith("number of sections reached")
    assert scan.events[-1].name == "stop"
    for section, again in zip(
        scan.sections.values(), scan.reread_sections(read_groove), strict=True
    ):
        np.testing.assert_allclose(again.points_b, section.points_b, atol=READERS)
        np.testing.assert_allclose(again.T_b_g, section.T_b_g, atol=READERS)


def test_its_sections_are_those_that_it_wrote_beside_them(old: Path) -> None:
    joint = read_scan_job(old / "job.toml").joint
    assert joint is not None
    points_b = [section.points_b for section in read_recorded_scan(old).sections.values()]
    points_j = [transform_points(inverse_pose(joint.T_w_j), points) for points in points_b]
    np.testing.assert_allclose(1e3 * np.reshape(points_j, (-1, 15)), corners(old), atol=IN_FILE_MM)


def test_it_is_reprocessed(old: Path, tmp_path: Path) -> None:
    assert tjscan("reprocess", old, "--out", tmp_path / "again") == 0
    np.testing.assert_allclose(corners(tmp_path / "again"), corners(old), atol=READERS_MM)


def test_it_is_replayed(old: Path, tmp_path: Path) -> None:
    options = ("--laser.driver", "replay", "--laser.recording", old)
    assert tjscan("scan", old / "job.toml", *options, "--out", tmp_path / "again") == 0
    np.testing.assert_allclose(corners(tmp_path / "again"), corners(old), atol=READERS_MM)
    head = read_header(tmp_path / "again" / "scan.mcap")
    assert head is not None
    assert head.format == FORMAT_VERSION


def test_it_is_gone_on_with_in_a_further_part(old: Path) -> None:
    data = (old / "scan.mcap").read_bytes()
    (old / "scan.mcap").write_bytes(data[: int(INTERRUPTED * len(data))])
    for name in ("sections.csv", "summary.json"):
        (old / name).unlink()
    before = read_recorded_scan(old)
    assert 2 <= len(before.sections) < 4
    assert tjscan("scan", "--resume", old) == 0
    assert len(read_recorded_scan(old).sections) == 4
    formats = [read_header(old / name) for name in ("scan.mcap", "scan-2.mcap")]
    assert [head.format for head in formats if head is not None] == [FORMAT_VERSION, FORMAT_VERSION]
