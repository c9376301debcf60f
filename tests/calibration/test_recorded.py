"""Real lines: a camera and a line laser on an arm over a flat board whose place is unknown."""

from pathlib import Path

import numpy as np
import pytest
from _board import points_rms
from _targets import calibrate_on_plane
from scipy.spatial.transform import Rotation

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets.line import LineFit, fit_line
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import pose
from tjscan.laser.profile import Profile

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "openlmd-lines"
MM = 1e-3
NOISE = NoiseModel(range=0.15 * MM, correlation=60.0, geometry=0.0)
"""Assumption: the camera's lens was never calibrated, so errors vary slowly along a line, and
hold what the arm adds."""

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the recorded lines are no part of the project; none at {DATA}"
)


def recorded(name: str) -> list[PosedFit[LineFit]]:
    lines = np.loadtxt(DATA / f"{name}_profiles.csv", delimiter=",")
    found = []
    for frame, x, y, z, *quaternion in np.loadtxt(DATA / f"{name}_poses.csv", delimiter=","):
        rows = lines[lines[:, 0] == frame]
        profile = Profile(MM * rows[:, 4], MM * rows[:, 3])
        T_b_f = pose(Rotation.from_quat(quaternion).as_matrix(), MM * np.array((x, y, z)))
        found.append(PosedFit(f"frame {frame:.0f}", T_b_f, fit_line(profile, NOISE)))
    return found


def test_a_good_recording_lies_flat() -> None:
    taken = recorded("root")
    result = calibrate_on_plane(taken, None, NOISE)
    assert result.rejected_sample_names == ()
    assert points_rms(result, taken) <= 0.19 * MM
    assert any("certain to" in said for said in result.caveats)  # eight lines, plane unknown


def test_a_recording_with_another_setups_optics_is_not_trusted() -> None:
    with pytest.raises(CalibrationRefused, match="noise model can't explain"):
        calibrate_on_plane(recorded("calib4"), None, NOISE)


@pytest.mark.parametrize("factor", [0.7, 1.5])
def test_the_verdict_does_not_hang_on_the_exact_noise_stated(factor: float) -> None:
    stated = NoiseModel(range=factor * NOISE.range, correlation=60.0, geometry=0.0)
    taken = recorded("root")
    assert points_rms(calibrate_on_plane(taken, None, stated), taken) < 0.25 * MM
    with pytest.raises(CalibrationRefused, match=r"can't explain|uncertain"):
        calibrate_on_plane(recorded("calib4"), None, stated)
