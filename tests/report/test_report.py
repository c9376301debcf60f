"""``report.html``: it stands alone, says what the run holds, and takes every name as text."""

import json
import re
import shutil
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from cells import FAULTLESS, PAPER
from command import tjscan
from measured import ORIGIN

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import transform_points
from tjscan.core.manifest import MANIFEST_FILE
from tjscan.groove.read import read_groove
from tjscan.joint.file import read_joint
from tjscan.report.data import read_report_data
from tjscan.report.dimensions import designed_measures
from tjscan.report.findings import report_findings
from tjscan.report.write import render_report_page, write_run_report
from tjscan.result.directory import BUDGET_FILE
from tjscan.result.section import MEASURE_FIELDS
from tjscan.result.summary import (
    OverlapReport,
    StationPlacement,
    StitchingReport,
    read_stitching_report,
    read_summary,
    summarise_stations,
    write_stitching_report,
    write_summary,
)
from tjscan.result.table import read_sections_csv, write_sections_csv
from tjscan.scanning.recording import read_recorded_scan

CAD = Path(__file__).parent.parent.parent / "cad" / "tjoint-600x457.toml"

MOST_BYTES = 3_000_000

SCRIPTS = 2
"""The data of the view that turns, and its program."""

LOADING = {"src", "href", "srcset", "data", "poster", "action", "background", "xlink:href"}
"""Attributes by which a page loads something."""

AS_DESIGNED = np.array((0.1, 0.03, 0.06, 2.0))
"""Degrees, mm, mm², of points without noise: sides are taken for shallow arcs."""


class Page(HTMLParser):
    """A page's tags, what they load, and its text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.loads: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.loads += [value or "" for name, value in attrs if name in LOADING]

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of six sections, its faults off."""
    directory = tmp_path_factory.mktemp("runs") / "exact"
    keys = {**FAULTLESS, "scan.sections": 6}
    options = [word for key, value in keys.items() for word in (f"--{key}", value)]
    assert tjscan("scan", PAPER, "--out", directory, *options, pictures=True) == 0
    return directory


@pytest.fixture(scope="module")
def page(run: Path) -> str:
    return (run / "report.html").read_text(encoding="utf-8")


def test_a_report_stands_alone_and_is_small(page: str) -> None:
    found = Page(page)
    assert len(page.encode()) < MOST_BYTES
    assert found.loads
    begins = {"data:image/png;base64": b"\x89PNG", "data:image/svg+xml;base64": b"<?xml"}
    kinds, pictures = zip(*(load.split(",", 1) for load in found.loads), strict=True)
    for kind, picture in zip(kinds, pictures, strict=True):
        assert b64decode(picture, validate=True).startswith(begins[kind])
    assert set(kinds) == set(begins)
    rest = re.sub(r'"data:[^"]*"', "", page)
    assert "://" not in rest
    assert not {"link", "iframe", "object", "embed"} & set(found.tags)
    assert found.tags.count("script") == SCRIPTS
    assert not re.search(r"@import|url\((?!#)", rest)


def test_a_report_says_what_the_run_holds(run: Path, page: str) -> None:
    text = Page(page).text
    summary = read_summary(run / "summary.json")
    for words in (
        "6 sections",
        summary.detail,
        "counterclockwise",
        "steps of 40 mm",
        "leg 600 × 20 mm, brace 457.2 × 25.4 mm, 90°",
        "Simulated: no real arm and laser",
        "uncertainty is not known",
        "cloud to mesh",
        "corners to feature edges",
        f"{summary.flange_travel_mm:.0f}",
        f"{read_recorded_scan(run).started:%Y-%m-%d}",
    ):
        assert words in text
    assert page.count("<figcaption") == 8
    alts = re.findall(r'<img [^>]*alt="([^"]*)"', page)
    assert len(set(alts) - {""}) == 7
    assert sum(any(figure.isdigit() for figure in alt) for alt in alts) >= 6


def test_what_is_buried_is_neither_measured_nor_compared(run: Path, tmp_path: Path) -> None:
    tacked = tmp_path / "tacked"
    shutil.copytree(run, tacked)
    (tacked / MANIFEST_FILE).unlink()
    before = read_report_data(run)
    one = replace(before.sections[2], conditions=("tack",), absent=("p3", "p4"))
    sections = (*before.sections[:2], one, *before.sections[3:])
    write_sections_csv(tacked / "sections.csv", sections, ORIGIN)
    data = read_report_data(tacked)
    text = Page(render_report_page(data)).text
    assert "Shaded: tack welds, 1 of 6 sections are on one." in text
    assert data.comparison is not None
    (found,) = (d for d in data.comparison.deviations if d.kind == "corners to feature edges")
    assert np.isnan(found.distances.reshape(-1, 3)).tolist() == [
        [False, buried, buried] for buried in (k == 2 for k in range(6))
    ]


def test_names_are_text_whatever_they_hold(run: Path, tmp_path: Path) -> None:
    odd = tmp_path / "<script>alert(1) & $\\frac$ \"x' <b>"
    shutil.copytree(run, odd)
    (odd / MANIFEST_FILE).unlink()
    summary = json.loads((odd / "summary.json").read_text(encoding="utf-8"))
    summary |= {"detail": "<img src=x onerror=alert(1)>", "complete": False}
    (odd / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    found = Page(write_run_report(odd).read_text(encoding="utf-8"))
    assert found.tags.count("script") == SCRIPTS
    assert found.tags.count("figcaption") == 8
    assert odd.name in found.text
    assert "<img src=x onerror=alert(1)>" in found.text


def test_measures_are_those_of_the_design_cut_by_the_same_planes(run: Path) -> None:
    sections = read_sections_csv(run / "sections.csv")
    design = designed_measures(sections, read_joint(CAD))
    measured = np.array([section.measures for section in sections])
    assert (
        np.abs(measured - design) / [field.unit.factor for field in MEASURE_FIELDS] < AS_DESIGNED
    ).all()


def test_the_log_holds_every_section_where_it_was_read(run: Path) -> None:
    log = read_recorded_scan(run)
    assert sorted(log.sections) == list(range(6))
    assert len(log.views) == read_summary(run / "summary.json").scans
    for found, again in zip(log.sections.values(), log.reread_sections(read_groove), strict=True):
        np.testing.assert_allclose(again.T_b_g, found.T_b_g, atol=1e-9)
        np.testing.assert_allclose(
            transform_points(found.T_b_g, np.zeros(3)), found.T_b_g[:3, 3], atol=1e-12
        )
    assert [event.name for event in log.events][-1] == "stop"


def test_gaps_and_what_is_over_tolerance_are_reported(run: Path, tmp_path: Path) -> None:
    gappy = tmp_path / "gappy"
    shutil.copytree(run, gappy)
    (gappy / MANIFEST_FILE).unlink()
    (gappy / BUDGET_FILE).unlink()  # it is of all sections
    sections = read_sections_csv(run / "sections.csv")
    write_sections_csv(gappy / "sections.csv", [sections[i] for i in (0, 1, 2, 5)], ORIGIN)
    found = list(report_findings(read_report_data(gappy, CAD, tolerance=1e-9)))
    assert any("of groove were not seen, azimuth 3° to 3" in words for words in found)
    assert any("Outside the tolerance" in words for words in found)
    assert any("12 of 12 corners are farther" in words for words in found)
    assert not any("not seen" in words for words in report_findings(read_report_data(run)))


def test_a_run_without_a_joint_is_reported_along_its_groove(run: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(run, bare)
    (bare / MANIFEST_FILE).unlink()
    (bare / "joint.toml").unlink()
    summary = json.loads((bare / "summary.json").read_text(encoding="utf-8"))
    summary |= {"frame": "b", "corner_error_mm": None}
    (bare / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    rows = (bare / "sections.csv").read_text(encoding="utf-8").splitlines()
    (bare / "sections.csv").write_text(
        "\n".join([rows[0], *(re.sub(r"^(\d+,[^,]*),[^,]*", r"\1,", row) for row in rows[1:])]),
        encoding="utf-8",
    )
    found = Page(render_report_page(read_report_data(bare)))
    assert "azimuths are not known in frame b" in found.text
    assert found.tags.count("figcaption") == 6
    assert "Compared with" not in found.text


def test_the_command_writes_it_again_against_another_reference(run: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    shutil.copytree(run, again)
    (again / MANIFEST_FILE).unlink()
    (again / "report.html").unlink()
    assert tjscan("report", again, "--reference", CAD, "--tolerance-mm", "0.5", pictures=True) == 0
    text = Page((again / "report.html").read_text(encoding="utf-8")).text
    assert "within tolerance" in text
    assert "tolerance of 0.5 mm" in text
    assert tjscan("report", again, "--reference", tmp_path / "none.stl") == 2
    bare = again / "groove.ply"
    shutil.copyfile(bare, tmp_path / "camera.ply")
    camera = ("--reference", tmp_path / "camera.ply")
    assert tjscan("report", again, *camera) == 2  # of which unit?
    assert tjscan("report", again, *camera, "--units", "mm", "--frame", "j") == 0
    text = Page((again / "report.html").read_text(encoding="utf-8")).text
    assert "corners to reference cloud" in text
    (tmp_path / "empty").mkdir()
    assert tjscan("report", tmp_path / "empty") == 2
    before = (again / "report.html").read_bytes()
    for tolerance in ("0", "-1", "nan", "inf"):
        assert tjscan("report", again, "--tolerance-mm", tolerance) == 2
    (again / "joint.toml").unlink()
    assert tjscan("report", again, "--tolerance-mm", "1") == 2  # of which joint?
    assert (again / "report.html").read_bytes() == before
    with pytest.raises(ConfigurationError, match="no finished run"):
        read_report_data(tmp_path / "none")


@pytest.fixture
def stitched(run: Path, tmp_path: Path) -> Path:
    """A stitched result as its files have it: the run as its only station, with an overlap."""
    directory = tmp_path / "stitched"
    shutil.copytree(run, directory)
    (directory / MANIFEST_FILE).unlink()
    (directory / "scan.mcap").unlink()
    (directory / "joint.toml").unlink()
    shutil.copytree(run, directory / "left & <b>")
    sections = read_sections_csv(run / "sections.csv")
    write_sections_csv(
        directory / "sections.csv",
        [replace(s, station="left & <b>+right") for s in sections],
        ORIGIN,
    )
    single = read_summary(run / "summary.json")
    parts = {"left & <b>": single, "right": single}
    write_summary(directory / "summary.json", summarise_stations(parts, sections, "j"))
    station = StationPlacement(
        name="left & <b>",
        source="left & <b>",
        position_mm=(1.0, 2.0, 3.0),
        euler_zyx_deg=(0.0, 0.0, 0.0),
        sigma_position_mm=(0.01, 0.02, 0.03),
        sigma_rotation_deg=(0.001, 0.002, 0.003),
        sigma_groove_mm=0.024,
        azimuth_deg=(-20.0, 30.0),
        sections=6,
        views=10,
        nominal_off_mm=4.56,
        nominal_off_deg=0.789,
        walls_rms_mm=0.033,
        walls_misfit=1.0,
    )
    overlap = OverlapReport(
        stations=("left & <b>", "right"),
        azimuth_deg=12.0,
        arc_deg=34.0,
        sections=(3, 4),
        views=7,
        left_out=0,
        residual_rms_mm=0.038,
        misfit=16.0,
        sigma_mm=0.051,
        covariance=((0.0,) * 6,) * 6,
        gap_mm=0.0061,
    )
    report = StitchingReport(
        frame="j",
        covered_deg=340.0,
        brace_diameter_mm=457.19,
        leg_diameter_mm=599.95,
        angle_deg=90.006,
        offset_mm=0.01,
        sigma_brace_diameter_mm=0.03,
        sigma_leg_diameter_mm=0.05,
        sigma_angle_deg=0.005,
        sigma_offset_mm=0.02,
        out_of_round_mm=0.02,
        loop_gap_before_mm=0.037,
        loop_gap_after_mm=0.007,
        stations=(station, replace(station, name="right", source="right")),
        overlaps=(overlap,),
    )
    write_stitching_report(directory / "stations.json", report)
    return directory


def test_a_stitched_run_shows_its_stations(stitched: Path) -> None:
    found = Page(write_run_report(stitched).read_text(encoding="utf-8"))
    for words in (
        "2 stations, stitched",
        "457.19 mm wide (± 0.06, two sigma)",
        "closes to 0.007 mm",
        "left & <b> and right",
        "4.56",
        "fit at 12° 4.0 times worse than their errors explain",
        "cover 340° without a gap",
        "The recordings of right are not there any more",
        "leg 600 × 20 mm",  # the joint that a station names
        "corners to feature edges",
    ):
        assert words in found.text
    assert found.tags.count("figcaption") == 8


def test_a_loop_that_no_overlap_closes_is_reported(stitched: Path) -> None:
    report = read_stitching_report(stitched)
    assert report is not None
    write_stitching_report(
        stitched / "stations.json",
        replace(report, covered_deg=360.0, loop_gap_before_mm=None, loop_gap_after_mm=None),
    )
    text = Page(write_run_report(stitched).read_text(encoding="utf-8")).text
    assert "no overlap closes the way round" in text


def test_a_damaged_stations_file_is_refused(stitched: Path) -> None:
    (stitched / "stations.json").write_text('{"frame": 1}', encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"stations\.json"):
        read_report_data(stitched)
