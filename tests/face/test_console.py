"""Where there is no terminal: a line a minute of what takes long, with the time that is left."""

from __future__ import annotations

import pytest

from mam_sim.console import PhaseBar, Screen, duration


def test_a_phase_says_once_a_minute_how_long_it_still_takes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    now = [0.0]
    with PhaseBar(Screen(), clock=lambda: now[0]) as update:
        for second in range(0, 601):  # ten minutes, one per cent every six seconds
            now[0] = float(second)
            update("training", second / 600, f"loss {second}")
    lines = capsys.readouterr().err.strip().splitlines()
    assert lines[0] == "[training 0 %] loss 0" and len(lines) == 11
    assert lines[1] == "[training 10 %, 9 min left] loss 60"
    assert lines[-1] == "[training 100 %, under a minute left] loss 600"


def test_a_run_that_goes_on_counts_from_where_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    with PhaseBar(Screen(), clock=lambda: now[0]) as update:
        update("training", 0.8, "")
        now[0] = 600.0
        update("training", 0.9, "")
    assert capsys.readouterr().err.splitlines()[1] == "[training 90 %, 10 min left]"


def test_nothing_is_said_where_nothing_is_wanted(capsys: pytest.CaptureFixture[str]) -> None:
    with PhaseBar(Screen(quiet=True)) as update:
        update("training", 0.5, "loss")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("seconds", "words"), [(20, "under a minute"), (720, "12 min"), (4800, "1 h 20 min")]
)
def test_a_duration_in_words(seconds: float, words: str) -> None:
    assert duration(seconds) == words
