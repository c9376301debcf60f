"""``calibration.toml`` keeps what was found, and for which devices."""

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from _targets import calibrate_on_plane
from calibration_stage import HAND, MM, NOISE, circle, raised, samples, shots, target

from tjscan.calibration.file import (
    CalibrationFile,
    read_calibration,
    write_calibration,
)
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.to_file import to_calibration_file
from tjscan.core.errors import ConfigurationError
from tjscan.core.provenance import Provenance

WHEN = datetime(2026, 3, 4, 10, 30, tzinfo=UTC)
PROVENANCE = Provenance.for_file_written_now("calibrate.toml, SHA-256 0123456789abcdef", "f")


@pytest.fixture(scope="module")
def result() -> HandEyeCalibration:
    rng = np.random.default_rng(0)
    profiles = shots(circle(30), HAND, rng)
    profiles[4] = raised(profiles[4], 2 * MM)
    return calibrate_on_plane(samples(circle(30), profiles), target(rng), NOISE)


@pytest.fixture
def kept(result: HandEyeCalibration, tmp_path: Path) -> Path:
    file = tmp_path / "calibration.toml"
    found = to_calibration_file(result, NOISE, arm="ur10e 1", laser="2610-100 7", date=WHEN)
    write_calibration(file, found, PROVENANCE)
    return file


def test_what_is_written_is_what_is_read(kept: Path, result: HandEyeCalibration) -> None:
    found = read_calibration(kept, arm="ur10e 1", laser="2610-100 7")
    np.testing.assert_allclose(found.T_f_s, result.T_f_s, atol=1e-14)
    np.testing.assert_allclose(found.covariance_si, result.covariance, rtol=1e-12)
    assert found.date == WHEN
    assert Provenance.from_comment_lines(kept.read_text(encoding="utf-8"), "#") == PROVENANCE
    assert found.lines == 11
    assert found.method == "plane touched"
    assert [r.name for r in found.residuals if not r.used] == ["line 5"]
    assert found.residuals[4].offset_mm == pytest.approx(1e3 * result.residuals[4].offset)
    assert found.noise.range == pytest.approx(0.03e-3)
    assert found.sigma_position_mm == pytest.approx(1e3 * result.uncertainty.position)


@pytest.mark.parametrize(("key", "device"), [("arm", "ur20 1"), ("laser", "2610-100 8")])
def test_a_calibration_of_another_device_is_refused(kept: Path, key: str, device: str) -> None:
    with pytest.raises(ConfigurationError, match=f"{key}.*{device}.*calibrate again"):
        read_calibration(kept, **{key: device})


@pytest.mark.parametrize(
    ("pattern", "wrong", "said"),
    [
        (r"^arm = .*$", "arms = 'x'", "unknown key"),
        (r"^lines = .*$", "lines = 0", "lines"),
        (r"^T_f_s_mm = \[\n    \[\n        [^,]*,", "T_f_s_mm = [[2.0,", "not a rotation"),
        (r"^excess = .*$", "excess = nan", "excess"),
        (r"^covariance = \[\n    \[\n        [^,]*,", "covariance = [[-1.0,", "covariance"),
        (r"^sigma_position_mm = .*$", "sigma_position_mm = 50.0", "sigmas"),
    ],
)
def test_a_spoiled_file_is_refused(kept: Path, pattern: str, wrong: str, said: str) -> None:
    text, count = re.subn(pattern, wrong, kept.read_text(), flags=re.MULTILINE)
    assert count == 1
    kept.write_text(text)
    with pytest.raises(ConfigurationError, match=said):
        read_calibration(kept)


def test_the_model_is_closed() -> None:
    with pytest.raises(ValueError, match="extra"):
        CalibrationFile.model_validate({"colour": "red"})
