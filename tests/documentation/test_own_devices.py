"""The driver that the documents show is a driver: a job names it, and profiles come."""

import re
import sys
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cells import PAPER
from command import tjscan
from documented import ROOT, fenced_blocks

from tjscan.core.config import validate_table
from tjscan.core.devices import guard_device
from tjscan.core.errors import ArmFault
from tjscan.job.files import read_scan_job
from tjscan.laser.drivers import LASER_DRIVERS
from tjscan.robot.drivers import ARM_DRIVERS, ArmDriverInputs
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits


def connected(host: str, exposure_us: float) -> SimpleNamespace:
    """A maker's library that gives a plate at 240 mm, with one column missing."""
    x = np.linspace(-20.0, 20.0, 200)
    rows = np.column_stack([x, np.where(np.arange(200) == 7, 0.0, 240.0)])
    assert host == "192.168.1.20"
    assert exposure_us == pytest.approx(250.0)
    return SimpleNamespace(trigger=lambda timeout_s: rows, close=lambda: None)


def test_the_driver_of_the_documents_takes_profiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = ROOT / "docs" / "own-devices.md"
    blocks = (block.text for block in fenced_blocks(page) if block.language != "sh")
    driver, package, job, _arm, _towing_vehicle = blocks
    name, place = re.findall(r'(\w+) = "(\w+:\w+)"', package)[0]
    (tmp_path / f"{place.partition(':')[0]}.py").write_text(driver, encoding="utf-8")
    text = re.sub(r"(?ms)^\[laser\].*?(?=^\[)", job + "\n", PAPER.read_text(encoding="utf-8"))
    (tmp_path / "job.toml").write_text(text, encoding="utf-8")
    library = ModuleType("acme")
    vars(library)["connect"] = connected
    monkeypatch.setitem(sys.modules, "acme", library)
    monkeypatch.syspath_prepend(tmp_path)
    added = EntryPoint(name, place, "tjscan.laser")
    monkeypatch.setitem(vars(LASER_DRIVERS), "_entries", {**LASER_DRIVERS._entries, name: added})
    written = tmp_path / "profiles.csv"
    assert tjscan("laser", tmp_path / "job.toml", "--profiles", "2", "--write", written) == 0
    rows = np.genfromtxt(written, delimiter=",", skip_header=1)
    assert np.isnan(rows[:, -1]).sum() == 2
    np.testing.assert_allclose(rows[~np.isnan(rows[:, -1]), -1], 240.0)


class AcmeController:
    """A maker's controller that is wherever it was last sent, or that fails when it is asked."""

    def __init__(self, q: list[float]) -> None:
        self.q, self.sent, self.broken = q, 0, False

    def joint_angles(self) -> list[float]:
        if self.broken:
            raise ConnectionResetError("connection reset by peer")
        return self.q

    def start(self, q: list[list[float]], tick: float) -> None:
        self.q, self.sent = q[-1], self.sent + len(q)

    seconds = staticmethod(lambda: 0.0)
    is_moving = staticmethod(lambda: False)
    has_arrived = staticmethod(lambda: True)
    halt = close = staticmethod(lambda: None)


def test_the_arm_of_the_documents_moves_and_fails_as_a_fault_of_its_driver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = ROOT / "docs" / "own-devices.md"
    blocks = [block.text for block in fenced_blocks(page) if "class AcmeArm(" in block.text]
    (tmp_path / "acme_arm_tjscan.py").write_text(blocks[0], encoding="utf-8")
    controller = AcmeController(np.radians([-110, -95, 160, 105, -110, 0]).tolist())
    library = ModuleType("acme_arm")
    vars(library)["connect"] = lambda host: controller
    monkeypatch.setitem(sys.modules, "acme_arm", library)
    monkeypatch.syspath_prepend(tmp_path)
    added = EntryPoint("acme", "acme_arm_tjscan:ARM", "tjscan.arm")
    monkeypatch.setitem(vars(ARM_DRIVERS), "_entries", {**ARM_DRIVERS._entries, "acme": added})
    table = ARM_DRIVERS.load("acme").table
    kinematics = Kinematics.load("ur10e")
    inputs = ArmDriverInputs(kinematics, MotionLimits(), 1, None, None, no_recording)
    arm = ARM_DRIVERS.make("acme", inputs, validate_table(table, {"host": "10.0.0.2"}))
    first, second = (start.T for start in read_scan_job(PAPER).start_poses)
    with arm:
        arm.check_moves(first, second)
        for reached, wanted in (
            (arm.move_joint_to_pose(first), first),
            (arm.move_linear(second), second),
        ):
            np.testing.assert_allclose(reached.T_b_f, wanted, atol=1e-6)
        assert controller.sent > 100
        arm.stop()
        with pytest.raises(ArmFault, match="stop"):
            arm.move_linear(first)
        controller.broken = True
        with pytest.raises(ArmFault, match=r"arm 'acme' failed: connection reset by peer"):
            arm.state()


@dataclass(frozen=True)
class FrozenDevice:
    """A driver that is a frozen dataclass, whose connection is lost."""

    host: str = "10.0.0.2"

    @property
    def identity(self) -> str:
        raise ConnectionResetError("lost")

    def state(self) -> str:
        raise ConnectionResetError("lost")


def test_frozen_devices_are_guarded_and_their_properties_too() -> None:
    device = guard_device(FrozenDevice(), "the arm 'x'", ArmFault)
    assert device.host == "10.0.0.2"
    assert isinstance(device, FrozenDevice)
    with pytest.raises(ArmFault, match="'x' failed: lost"):
        device.state()
    with pytest.raises(ArmFault, match="'x' failed: lost"):
        _ = device.identity


def no_recording() -> Any:
    raise AssertionError("this arm needs no recording")
