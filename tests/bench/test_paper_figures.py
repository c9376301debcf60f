"""The figures of the paper's programme."""

from _paper_figures import (
    CASE_COLOURS,
    CASE_KEY,
    OTHER_COLOUR,
    STEP_KEY,
    draw_travel_and_rotation,
)
from matplotlib.colors import to_rgba

from tjscan.runs.scan.study import ScanOutcome
from tjscan.study.trial import StudyRow, Value


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
        StudyRow("", index, {CASE_KEY: case, STEP_KEY: 20.0}, outcome)
        for index, (case, outcome) in enumerate(outcomes.items())
    ]
    axes = draw_travel_and_rotation(shown).axes[0]
    faces = {bar.get_facecolor() for bar in axes.patches}
    assert faces >= {to_rgba(CASE_COLOURS[3]), to_rgba(OTHER_COLOUR)}
    crosses = [line for line in axes.lines if line.get_marker() == "x"]
    assert [line.get_color() for line in crosses] == [CASE_COLOURS["smooth"]]
    legend = axes.get_legend()
    assert legend is not None
    words = [text.get_text() for text in legend.get_texts()]
    assert {"case 3", "smooth", "no complete scan"} <= set(words)
