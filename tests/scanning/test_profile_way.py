"""The way of a profile through the code stays short enough to be read."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

TRACER = Path(__file__).resolve().parents[2] / ".ci" / "profile_way.py"
MOST_FILES = 36
"""Files of tjscan/ between the capture of a profile and the accepted section, devices included."""

MOST_CHANGES = 250
"""Calls on that way that lead from one file to another."""


def tracer() -> ModuleType:
    spec = importlib.util.spec_from_file_location("profile_way", TRACER)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_a_profile_takes_a_short_way_to_its_section() -> None:
    way = tracer().trace_profile_way()
    assert len(way.files) <= MOST_FILES, way.files
    assert way.file_changes <= MOST_CHANGES
