"""The longest silence is that of all signs of life noted lately."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tjscan.robot.ur.client import SILENCE_MEMORY, LongestSilence


@given(st.lists(st.floats(0.01, 5.0), min_size=1, max_size=40), st.floats(0, 3))
def test_it_is_the_longest_gap_that_ended_lately_or_lasts(gaps: list[float], since: float) -> None:
    watch, moment, ended = LongestSilence(0.0), 0.0, []
    for gap in gaps:
        moment += gap
        watch.note_sign_of_life(moment)
        ended.append((moment, gap))
    now = moment + since
    lately = [gap for end, gap in ended if now - end < SILENCE_MEMORY]
    assert abs(watch.longest_until(now) - max([since, *lately])) < 1e-9
