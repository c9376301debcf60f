"""The figures of the paper's programme."""

from matplotlib.colors import to_rgba

from tjscan.runs.scan_study.figures import COLOURS, OTHER, draw_travel_and_rotation
from tjscan.runs.scan_study.outcome import ScanOutcome
from tjscan.runs.scan_study.paper import CASE, STEP
from tjscan.study.row import StudyRow
from tjscan.study.trial import Value


def test_a_prediction_keeps_its_colour_and_what_is_not_complete_is_marked() -> None:
    complete = ScanOutcome(
        True,
        "length reached",
        "length reached",
        travel_mm=900.0,
        travel_prediction_mm=700.0,
        rotation_deg=90.0,
        rotation_prediction_deg=60.0,
    )
    outcomes: dict[Value, ScanOutcome] = {
        3: complete,
        "smooth": ScanOutcome(False, "lost", "lost"),
        "another": complete,
    }
    shown = [
        StudyRow("", index, {CASE: case, STEP: 20.0}, outcome)
        for index, (case, outcome) in enumerate(outcomes.items())
    ]
    axes = draw_travel_and_rotation(shown).axes[0]
    assert {bar.get_facecolor() for bar in axes.patches} >= {to_rgba(COLOURS[3]), to_rgba(OTHER)}
    crosses = [line for line in axes.lines if line.get_marker() == "x"]
    assert [line.get_color() for line in crosses] == [COLOURS["smooth"]]
    legend = axes.get_legend()
    assert legend is not None
    words = [text.get_text() for text in legend.get_texts()]
    assert {"case 3", "smooth", "no complete scan"} <= set(words)
