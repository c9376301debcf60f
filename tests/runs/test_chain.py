"""The chain: its file, and the sources of error that it knows. Its accuracy: bench/chain.py."""

from __future__ import annotations

from pathlib import Path

import pytest
from cells import EXAMPLES
from command import tjscan

from tjscan.core.config import table_to_dict
from tjscan.job.files import read_calibration_job, read_scan_job
from tjscan.recording.header import flatten_to_dotted_keys
from tjscan.runs.chain import KEYS_OF_ERROR_SOURCES, read_chain_file

CHAIN = EXAMPLES / "paper-chain.toml"


def test_both_jobs_are_of_one_cell_that_errs() -> None:
    chain = read_chain_file(CHAIN)
    calibrate = read_calibration_job(Path(chain.calibrate), chain.both | chain.calibration)
    scan = read_scan_job(Path(chain.scan), chain.both)
    worlds = [one.simulation for one in (calibrate, scan)]
    assert calibrate.ball is not None
    assert worlds[0] is not None
    assert worlds[1] is not None
    assert worlds[0].arm is not None
    assert worlds[1].arm is not None
    assert worlds[0].arm.errors == worlds[1].arm.errors is not None
    assert worlds[0].laser == worlds[1].laser
    assert worlds[0].seed == worlds[1].seed
    assert worlds[0].T_f_s_mm == worlds[1].T_f_s_mm


@pytest.mark.parametrize("source", KEYS_OF_ERROR_SOURCES)
def test_each_source_is_there_and_can_be_switched_off(source: str) -> None:
    chain = read_chain_file(CHAIN)
    as_it_is = flatten_to_dotted_keys(table_to_dict(read_scan_job(Path(chain.scan), chain.both)))
    without = chain.with_shared_keys(dict.fromkeys(KEYS_OF_ERROR_SOURCES[source], 0.0))
    off = flatten_to_dotted_keys(table_to_dict(read_scan_job(Path(chain.scan), without.both)))
    for key in KEYS_OF_ERROR_SOURCES[source]:
        assert as_it_is[key] > 0
        assert off[key] == 0


def test_a_key_that_both_jobs_do_not_share_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "chain.toml"
    file.write_text('calibrate = "a"\nscan = "b"\n[both.scan]\nstep_mm = 20.0\n', encoding="utf-8")
    assert tjscan("chain", file) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "both.scan.step_mm" in said
    assert "[both.simulation]" in said
