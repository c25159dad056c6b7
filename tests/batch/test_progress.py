"""What a batch says of itself while it runs."""

from __future__ import annotations

import io
import sys

from rich.console import Console

from skinbake import progress
from skinbake.baking.stage_log import StageLog
from skinbake.batch.progress import BatchProgress
from tests.test_progress import wait_for


def test_a_batch_says_where_its_looks_are(monkeypatch):
    """Stage, and where it is within; no share before a look has ended, which nobody knows then."""
    monkeypatch.setattr(progress, "LINE_S", 0.05)
    monkeypatch.setattr(progress, "DRAW_S", 0.005)
    monkeypatch.setattr(sys, "stderr", said := io.StringIO())
    with BatchProgress(2, 1, Console(file=io.StringIO())) as shown:
        shown.on_event("even", {"event": "begin"})
        for stage in ("diffuse", "relight"):  # this within that: a transfer is made where a look first asks for it
            shown.on_event("even", {"event": "stage", "stage": stage})
        wait_for(said, "  ... looks: even light from everywhere: 1 s so far\n")
        shown.on_event("even", {"event": "note", "text": "relighting: scattering 8 of 61"})
        wait_for(said, "  ... looks: even light from everywhere: relighting: scattering 8 of 61: 1 s so far\n")
        shown.on_event("even", {"event": "stage end", "stage": "relight"})
        wait_for(said, "  ... looks: even scattering light: 1 s so far\n")
        assert "%" not in said.getvalue()
        shown.on_event("even", {"event": "end", "status": "done"})
        shown.on_event("dim", {"event": "begin", "host": "here"})
        wait_for(said, "  ... looks: dim here: 50%")


def test_a_look_that_is_tried_again_begins_anew():
    """Whatever its lost process says after that."""
    with BatchProgress(1, 1, Console(quiet=True)) as shown:
        events = [{"event": "begin"}, {"event": "stage", "stage": "read"}, {"event": "note", "text": "a map"}]
        for event in (*events, {"event": "begin"}, *2 * [{"event": "stage end", "stage": "read"}]):
            shown.on_event("even", event)
        assert shown._task.note == "even"


def test_stages_say_where_they_are_to_who_listens():
    """Also where nothing is shown: a look of a batch is baked by another process."""
    events = []
    StageLog(0, events.append).note("key, 1 of 2")
    assert events == [{"event": "note", "text": "key, 1 of 2"}]


def test_looks_that_take_the_blurs_of_another_are_expected_to_be_quicker(monkeypatch, capsys):
    """After the one that they take them from, nobody knows how quick; then by those of their kind."""
    now = [100.0]
    monkeypatch.setattr("skinbake.batch.progress.time.monotonic", lambda: now[0])
    quicker = [f"skin-{k}" for k in range(9)]
    with BatchProgress(10, 1, Console(file=io.StringIO()), quicker) as shown:
        for name, seconds in (("base", 60.0), (quicker[0], 4.0), (quicker[1], 4.0)):
            shown.on_event(name, {"event": "begin"})
            now[0] += seconds
            shown.on_event(name, {"event": "end", "status": "done"})
    base, first, second = capsys.readouterr().err.splitlines()
    assert "left" not in base
    assert first.endswith("(about 32 s left)")
    assert second.endswith("(about 28 s left)")
    assert shown._task.done / shown._task.total == 68 / 96
