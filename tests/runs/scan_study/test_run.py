"""What a study measures is what a recorded scan states."""

from pathlib import Path

import pytest
from cells import PAPER
from studies import expand_in, settings_of

from tjscan.runs.scan.run import ScanContext
from tjscan.runs.scan.run import run_scan as record_scan
from tjscan.runs.scan.study import ScanOutcome, StudyScanSettings, scan_for_study


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> StudyScanSettings:
    expand = expand_in(tmp_path_factory.mktemp("study"))
    trials = expand(fixed={"scan.sections": 4, "scan.prediction_case": 1})
    return settings_of(trials, trials[0])


@pytest.fixture(scope="module")
def outcome(settings: StudyScanSettings) -> ScanOutcome:
    return scan_for_study(settings)


def test_settings_come_back_from_their_text(settings: StudyScanSettings) -> None:
    assert StudyScanSettings.from_json_text(settings.to_canonical_json_text()) == settings


def test_a_study_keeps_what_a_recorded_scan_would_say(
    settings: StudyScanSettings, outcome: ScanOutcome, tmp_path: Path
) -> None:
    summary = record_scan(ScanContext(settings.job, PAPER), tmp_path / "run")
    assert summary.step_mm.mean == outcome.step_mean_mm
    assert summary.flange_travel_mm == outcome.travel_mm
    assert summary.motion_time_s == outcome.motion_time_s
    assert summary.scans == outcome.scans
    assert summary.corner_error_mm is not None
    # The same points, carried into frame j by another product of the same poses.
    assert summary.corner_error_mm.mean == pytest.approx(outcome.corner_mean_mm, rel=1e-9)


def test_travel_is_that_of_predictions_and_corrections(outcome: ScanOutcome) -> None:
    assert outcome.travel_prediction_mm is not None
    assert outcome.travel_correction_mm is not None
    both = outcome.travel_prediction_mm + outcome.travel_correction_mm
    assert both == pytest.approx(outcome.travel_mm, rel=1e-12)
    assert len(outcome.path) == outcome.scans
