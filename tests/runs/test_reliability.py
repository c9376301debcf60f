"""What `make soak` does a thousand times, a few times."""

import random
from pathlib import Path

import pytest
from _faulty import KINDS, faulty_scan
from _fuzz import section_ends
from cells import PAPER
from command import tjscan

from tjscan.scanning.recording import read_recorded_scan

CUTS = 60
WRONG_MM = 1.0
"""A corner further than this from the true edge is a wrong one."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("runs") / "run"
    assert tjscan("scan", PAPER, "--out", directory, "--scan.sections", 5) == 0
    return directory


def test_every_whole_section_before_a_cut_is_read(run: Path, tmp_path: Path) -> None:
    data, dice = (run / "scan.mcap").read_bytes(), random.Random(0)
    ends = section_ends(data)
    assert len(ends) == 5
    sizes = [dice.randrange(len(data)) for _ in range(CUTS)]
    for size in [*sizes, *ends, *(end - 1 for end in ends), 0, len(data)]:
        (tmp_path / "scan.mcap").write_bytes(data[:size])
        assert len(read_recorded_scan(tmp_path).sections) == sum(end <= size for end in ends)


def test_zeros_behind_the_last_section_are_what_a_lost_power_leaves(
    run: Path, tmp_path: Path
) -> None:
    data = (run / "scan.mcap").read_bytes()
    ends = section_ends(data)
    (tmp_path / "scan.mcap").write_bytes(data[: ends[3]] + bytes(5000))
    assert len(read_recorded_scan(tmp_path).sections) == 4


@pytest.mark.parametrize("seed", range(len(KINDS)))
def test_a_sensor_that_fails_for_a_while_claims_no_wrong_section(seed: int) -> None:
    scan = faulty_scan(seed)
    assert scan.clean
    assert scan.complete, scan.told
    assert scan.worst_mm < WRONG_MM
