"""The compiled loops give what NumPy gives, on grooves as yards leave them."""

import re
from collections.abc import Iterator
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from _steel import FILLED, GROOVES, NO_GROOVE, Fault, shoot

import tjscan.groove
from tjscan.core.errors import GrooveNotFound
from tjscan.groove import kernel
from tjscan.groove.candidates import ProjectivePoints, find_pieces
from tjscan.groove.prior import GroovePrior
from tjscan.groove.read import read_groove
from tjscan.groove.reflections import find_runs
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile

FOLDER = Path(tjscan.groove.__file__).parent
EXACTNESS = 1e-9
"""Metres, radians, square metres; of a covariance, the share of its largest entry."""

pytestmark = pytest.mark.skipif(
    kernel.compiled is None, reason="the compiled kernel was not built, or is switched off"
)


@pytest.fixture
def sources() -> Iterator[None]:
    """Leave the kernel as it was."""
    before = kernel.compiled
    yield
    kernel.compiled = before


def read_both_ways(profile: Profile, prior: GroovePrior | None) -> list[GrooveSection | str]:
    """The section, or the words of the refusal: compiled, and by NumPy."""
    found: list[GrooveSection | str] = []
    for compiled in (kernel.compiled, None):
        kernel.compiled = compiled
        try:
            found.append(read_groove(profile, prior=prior))
        except GrooveNotFound as refusal:
            found.append(str(refusal))
    return found


def assert_same(a: GrooveSection | str, b: GrooveSection | str) -> None:
    """Whether two readings of one profile agree in everything."""
    if isinstance(a, str) or isinstance(b, str):
        assert a == b
        return
    for field in fields(a):
        if field.name == "evidence":
            continue
        one, other = getattr(a, field.name), getattr(b, field.name)
        if isinstance(one, str | tuple):
            assert one == other
            continue
        covariance = field.name.endswith("covariance") or field.name == "covariance_s"
        scale = np.abs(one).max() if covariance else 1.0
        np.testing.assert_allclose(other, one, rtol=0, atol=EXACTNESS * scale, err_msg=field.name)


@pytest.mark.usefixtures("sources")
@pytest.mark.parametrize("fault", [*GROOVES, *FILLED, *NO_GROOVE], ids=lambda fault: fault.name)
def test_the_compiled_loops_give_what_numpy_gives(fault: Fault) -> None:
    before = kernel.compiled
    for k in (71, 72):
        points = shoot(fault, k).points
        kernel.compiled = before
        assert_same(*read_both_ways(Profile(points[:, 0], points[:, 1]), None))
    kernel.compiled = before
    bent = GroovePrior(bends=np.array((0.0, 1.5)), bend_sigmas=np.array((0.3, 0.2)))
    assert_same(*read_both_ways(Profile(points[:, 0], points[:, 1]), bent))


@pytest.mark.usefixtures("sources")
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e200])
def test_pieces_of_points_that_are_none_are_found_in_the_same_way(wrong: float) -> None:
    u, z = np.linspace(-0.5, 0.5, 400), np.full(400, 0.2)
    y = 5 + np.abs(u)
    y[100:103] = wrong
    found = []
    for compiled in (kernel.compiled, None):
        kernel.compiled = compiled
        points = ProjectivePoints(u, y, z, 5e-5)
        runs = find_runs(Profile(-u * z, z))
        with np.errstate(all="ignore"):
            found.append(find_pieces(points, runs))
    np.testing.assert_array_equal(found[0].first, found[1].first)
    np.testing.assert_array_equal(found[0].stop, found[1].stop)


def test_columns_without_their_number_are_refused() -> None:
    with pytest.raises(ValueError, match="column_count"):
        Profile(np.zeros(3), np.ones(3), columns=np.arange(3))


def test_constants_of_the_compiled_loops_have_the_values_that_they_have_in_python() -> None:
    found = re.findall(r"^#define (\w+) ([-\d.e]+)$", (FOLDER / "_kernel.c").read_text(), re.M)
    modules = [import_module(f"tjscan.groove.{file.stem}") for file in FOLDER.glob("[a-z]*.py")]
    assert len(found) > 30
    for name, value in found:
        values = {getattr(module, name) for module in modules if hasattr(module, name)}
        assert values == {float(value)}, name


def test_arrays_that_do_not_match_are_refused() -> None:
    assert kernel.compiled is not None
    x, columns = np.linspace(-1, 1, 100), np.arange(100)
    sides, model = np.zeros((3, 8)), np.zeros((3, 6))
    arrays = [x, x + 2, columns, sides, np.zeros((2, 2)), model, np.zeros((0, 2, 2))]
    arrays += [np.zeros(168), np.zeros((2, 100)), np.zeros(100, dtype=bool)]
    assert kernel.compiled.refine_fit(*arrays, 100, 1e-3, True) is None
    for k, array in enumerate(arrays):
        other = [*arrays]
        if k != 6:  # there may be any number of known fits
            other[k] = np.resize(array, (len(array) + 1, *array.shape[1:]))
            with pytest.raises(ValueError, match="do not match"):
                kernel.compiled.refine_fit(*other, 100, 1e-3, True)
        other[k] = array.astype(np.float16)
        with pytest.raises(TypeError, match="not of kind"):
            kernel.compiled.refine_fit(*other, 100, 1e-3, True)
    with pytest.raises(ValueError, match="do not match"):
        kernel.compiled.refine_fit(*arrays, 99, 1e-3, True)


def test_the_compiled_loops_can_be_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(kernel.WITHOUT_KERNEL, "1")
    assert kernel.load_kernel() is None
    monkeypatch.setenv(kernel.WITHOUT_KERNEL, "")
    assert kernel.load_kernel() is kernel.compiled


def test_compiled_loops_of_another_version_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    assert kernel.compiled is not None
    monkeypatch.setattr(kernel.compiled, "KERNEL_VERSION", kernel.KERNEL_VERSION - 1)
    assert kernel.load_kernel() is None


@pytest.mark.usefixtures("sources")
@pytest.mark.parametrize("k", [2, 7])
def test_points_on_one_ray_are_left_out_in_the_same_way(k: int) -> None:
    """They leave holes in the order of columns, about which a surface may seem to curl."""
    points = shoot(GROOVES[0], k).points.copy()
    points[np.random.default_rng(k).random(len(points)) < 0.2, 0] = 0.0
    assert_same(*read_both_ways(Profile(points[:, 0], points[:, 1]), None))
