"""What a laser's numbers mean: as it states, or as the job does, or it is refused."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any

import pytest

from tjscan.core.config import validate_table
from tjscan.core.devices import DeviceIdentity
from tjscan.core.errors import ProfileFormatRefused
from tjscan.laser.genicam.gige import scales_of_laser
from tjscan.laser.genicam.messages import ConnectedLaser, StatedAxis
from tjscan.laser.genicam.settings import GenicamSettings

LASER = ConnectedLaser(
    DeviceIdentity("maker model", "1"),
    address="10.0.0.7",
    pixel_format="Coord3D_AC16",
    columns=640,
    rows=1,
    packet_size=1500,
    unit="Millimeter",
    output_mode="CalibratedAC_Linescan",
    x=StatedAxis(0.004, -131.0, 0.0, 65535.0, 0.0),
    z=StatedAxis(0.002, 100.0, 1.0, 65535.0, 0.0),
    exposure=None,
    latches=True,
)


def job(**keys: Any) -> GenicamSettings:
    return validate_table(GenicamSettings, {"address": "10.0.0.7", **keys})


def test_the_laser_states_them_in_millimetres() -> None:
    scales = scales_of_laser(LASER, job())
    assert (scales.x.scale, scales.x.offset) == pytest.approx((4e-6, -0.131))
    assert (scales.z.scale, scales.z.offset) == pytest.approx((2e-6, 0.1))
    assert (scales.z.low, scales.z.high, scales.invalid) == (1.0, 65535.0, 0.0)


def test_the_job_is_stronger_than_the_laser() -> None:
    stated = job(scale_mm=[0.01, 0.02], offset_mm=[1, 2], invalid=-1.0, axis_limits=False)
    for laser in (LASER, replace(LASER, unit="Pixel", output_mode="UncalibratedC")):
        scales = scales_of_laser(laser, stated)
        assert (scales.x.scale, scales.z.offset) == pytest.approx((1e-5, 2e-3))
        assert (scales.z.low, scales.z.high, scales.invalid) == (-inf, inf, -1.0)


def test_turned_axes_change_their_sign() -> None:
    plain = scales_of_laser(LASER, job())
    turned = scales_of_laser(LASER, job(flip_x=True, flip_z=True))
    assert (turned.x, turned.z) == (plain.x.flipped_axis(), plain.z.flipped_axis())


@pytest.mark.parametrize(
    ("changes", "hint"),
    [
        ({"unit": None}, "Scan3dDistanceUnit"),
        ({"unit": "Pixel"}, "Pixel"),
        ({"unit": "Inch"}, "Inch"),
        ({"output_mode": "UncalibratedC"}, "no lengths"),
        ({"z": StatedAxis(offset=1.0)}, "Scan3dCoordinateScale"),
        ({"x": StatedAxis(scale=1.0)}, "offset_mm"),
        ({"pixel_format": "Mono8"}, "Mono8"),
    ],
)
def test_what_nobody_states_is_refused(changes: dict[str, Any], hint: str) -> None:
    with pytest.raises(ProfileFormatRefused, match=hint):
        scales_of_laser(replace(LASER, **changes), job())


@pytest.mark.parametrize(("low", "high"), [(None, None), (0.0, 0.0), (5.0, None)])
def test_limits_that_bound_nothing_are_none(low: float | None, high: float | None) -> None:
    laser = replace(LASER, z=replace(LASER.z, low=low, high=high))
    scales = scales_of_laser(laser, job())
    assert (scales.z.low, scales.z.high) == (-inf, inf)
