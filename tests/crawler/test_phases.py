"""Every phase is reached and left, and a stop holds."""

from pathlib import Path

import pytest

from tjscan.crawler.phases import PHASE_TRANSITIONS, Event, Phase, next_phase


def draw_state_diagram() -> str:
    """The phases as a Mermaid state diagram, from the table itself."""
    lines = ["stateDiagram-v2", f"    [*] --> {_diagram_name(Phase.MANUAL)}"]
    for (phase, event), after in PHASE_TRANSITIONS.items():
        if event is not Event.DANGER:
            lines.append(f"    {_diagram_name(phase)} --> {_diagram_name(after)}: {event}")
    stop = f"{_diagram_name(Phase.STOP)}: {Event.DANGER}"
    lines += [
        f"    {_diagram_name(phase)} --> {stop}" for phase in Phase if phase is not Phase.STOP
    ]
    return "\n".join(lines)


def _diagram_name(phase: Phase) -> str:
    return str(phase).title().replace(" ", "")


def test_a_job_goes_round_and_ends_in_manual() -> None:
    phase, seen = Phase.MANUAL, [Phase.MANUAL]
    for event in (
        Event.JOINT_IN_VIEW,
        Event.ALIGNED,
        Event.AT_START,
        Event.WELD_CONFIRMED,
        Event.PASS_WELDED,
        Event.PASSES_LEFT,
        Event.WELD_CONFIRMED,
        Event.PASS_WELDED,
        Event.ALL_WELDED,
    ):
        phase = next_phase(phase, event)
        seen.append(phase)
    assert phase is Phase.MANUAL
    assert set(seen) == set(Phase) - {Phase.STOP}


@pytest.mark.parametrize("phase", Phase)
def test_danger_stops_it_from_anywhere(phase: Phase) -> None:
    assert next_phase(phase, Event.DANGER) is Phase.STOP


def test_only_the_operator_ends_a_stop() -> None:
    leads = {event for (phase, event), after in PHASE_TRANSITIONS.items() if phase is Phase.STOP}
    assert leads == {Event.CLEARED, Event.DANGER}


def test_what_can_not_happen_is_refused() -> None:
    with pytest.raises(ValueError, match="no event"):
        next_phase(Phase.READY, Event.ALIGNED)


def test_the_diagram_shows_every_transition() -> None:
    assert (
        draw_state_diagram().count("-->") == len(PHASE_TRANSITIONS) - 1 + 1
    )  # Stop to Stop; start


def test_the_documented_diagram_is_that_of_the_code() -> None:
    text = (Path(__file__).parents[2] / "docs" / "crawler.md").read_text(encoding="utf-8")
    assert draw_state_diagram() in text
