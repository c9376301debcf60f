"""What several tests of the report look at."""

import pytest
from cells import FAULTLESS, PAPER
from command import tjscan

from tjscan.report.data import ReportData, read_report_data


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    """A run of five sections of the paper's joint, its faults off."""
    directory = tmp_path_factory.mktemp("runs") / "exact"
    keys = {**FAULTLESS, "scan.sections": 5}
    options = [word for key, value in keys.items() for word in (f"--{key}", value)]
    assert tjscan("scan", PAPER, "--out", directory, *options) == 0
    return read_report_data(directory)
