"""``import tjscan``: what it shows, what it loads, and that its example runs."""

import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from calibration_stage import HAND, T_F_S, error, shots, varied
from command import blank_pictures

import tjscan
from tjscan.api import Scan
from tjscan.comparison.compare import Comparison
from tjscan.core.errors import ConfigurationError, GrooveNotFound

ROOT = Path(__file__).parents[1]

HEAVY = {"open3d", "matplotlib", "pinocchio", "coal", "trimesh", "manifold3d"}
"""What takes long to load, and few commands need."""


def loaded_by(code: str) -> set[str]:
    """The packages that a new Python has loaded after running some code."""
    show = "import sys; print(*{name.partition('.')[0] for name in sys.modules})"
    command = [sys.executable, "-c", f"{code}\n{show}"]
    return set(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())


@pytest.mark.parametrize(
    "module", ["tjscan", "tjscan.groove.read", "tjscan.scanning.scanner", "tjscan.job"]
)
def test_nothing_heavy_is_loaded_before_it_is_used(module: str) -> None:
    assert not loaded_by(f"import {module}") & HEAVY


def test_importing_the_package_loads_no_numerics_at_all() -> None:
    assert not loaded_by("import tjscan") & {"numpy", "scipy", "pydantic"}


def test_a_mistake_in_a_job_is_reported_before_anything_heavy_is_loaded(tmp_path: Path) -> None:
    job = tmp_path / "job.toml"
    job.write_text("[scna]\nstep_mm = 40\n", encoding="utf-8")
    code = f"""
from tjscan.cli import main
try:
    main(["scan", {str(job)!r}])
except SystemExit as stop:
    assert stop.code == 2
"""
    assert not loaded_by(code) & HEAVY


def test_the_package_shows_its_functions_and_nothing_else() -> None:
    shown = ["Recording", "Scan", "__version__", "calibrate", "compare", "read_groove", "scan"]
    assert dir(tjscan) == shown
    assert all(hasattr(tjscan, name) for name in shown)
    with pytest.raises(AttributeError, match="has no attribute 'scann'"):
        _ = tjscan.scann


def test_the_example_of_the_documentation_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    for folder in ("examples", "cad"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(example, names)
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "j (4, 5, 3)"
    assert printed[-1] == "within the tolerance"
    scan, recording = names["scan"], names["recording"]
    assert isinstance(scan, Scan)
    assert isinstance(recording, tjscan.Recording)
    assert len(scan.points[recording.section_numbers]) == len(recording)
    np.testing.assert_array_equal(tjscan.Scan.read(scan.directory).points, scan.points)
    for name in ("points", "T_r_g", "measures", "sigmas", "cloud"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(scan, name)[0] = 0.0
    check_that_they_show_themselves(scan, recording, names["comparison"])


def check_that_they_show_themselves(
    scan: Scan, recording: tjscan.Recording, comparison: object
) -> None:
    """Tables hold what the arrays and files do, and a notebook is given HTML and pictures."""
    assert isinstance(comparison, Comparison)
    table = scan.to_pandas()
    written = pd.read_csv(scan.directory / "sections.csv")
    numbers = [name for name in written.columns if table[name].dtype == float]
    assert len(numbers) > 50
    np.testing.assert_allclose(table[numbers], written[numbers], rtol=1e-5, atol=1e-4)
    np.testing.assert_array_equal(table["index"], written["index"])
    assert len(dataclasses.replace(scan, sections=scan.sections[:1]).to_pandas()) == 1
    profiles = recording.to_pandas()
    assert list(profiles["section"]) == list(recording.section_numbers)
    sensor = profiles[["sensor_x_mm", "sensor_y_mm", "sensor_z_mm"]]
    np.testing.assert_allclose(1e-3 * sensor, recording.T_b_s[:, :3, 3])
    distances = comparison.to_pandas()
    for deviation in comparison.deviations:
        own = distances[distances["kind"] == deviation.kind]["distance_mm"]
        np.testing.assert_allclose(own, 1e3 * deviation.distances)
    for one in (scan, recording, comparison):
        html = one._repr_html_()
        assert html.count("<tr>") == html.count("</tr>") > 1
        with blank_pictures():
            assert one.plot()._repr_png_().startswith(b"\x89PNG")
    assert "within" in comparison._repr_html_()
    assert "data:image/png" in scan._repr_html_()


def test_a_groove_is_read_from_two_columns_or_three() -> None:
    with pytest.raises(ValueError, match=r"\(n, 2\) or \(n, 3\), not \(5,\)"):
        tjscan.read_groove(np.zeros(5))
    with pytest.raises(ValueError, match="off the laser plane"):
        tjscan.read_groove(np.ones((200, 3)))
    with pytest.raises(ValueError, match="unknown model 'vee'"):
        tjscan.read_groove(np.zeros((200, 2)), model="vee")
    with pytest.raises(ValueError, match="unknown align 'jont'; one of none, joint, icp"):
        tjscan.compare("scan.ply", "joint.toml", align="jont")  # type: ignore[arg-type]
    with pytest.raises(GrooveNotFound):
        tjscan.read_groove(np.column_stack((np.linspace(0, 0.1, 200), np.full(200, 0.2))))


def test_a_calibration_finds_the_sensor_on_the_flange() -> None:
    rng = np.random.default_rng(7)
    poses = varied(rng, 16)
    profiles = [profile.points_s for profile in shots(poses, HAND, rng)]
    found = tjscan.calibrate(profiles, poses)
    assert np.linalg.norm(error(found.T_f_s)[:3]) < 3e-3
    assert found.T_f_s.shape == T_F_S.shape
    with pytest.raises(ValueError, match="16 profiles need poses"):
        tjscan.calibrate(profiles, poses[:3])
    with pytest.raises(ValueError, match="a radius is of a sphere"):
        tjscan.calibrate(profiles, poses, radius=0.02)
    with pytest.raises(ValueError, match="unknown target 'ball'; one of plane, sphere"):
        tjscan.calibrate(profiles, poses, target="ball")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="unknown noise 'rnage'; one of range"):
        tjscan.calibrate(profiles, poses, noise={"rnage": 1e-5})
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert all(hasattr(found, name) for name in re.findall(r"found\.(\w+)", text))


def test_a_recording_that_is_not_there_is_not_named_as_what_a_run_holds(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="name a run directory that holds one"):
        tjscan.Recording(tmp_path / "none")
