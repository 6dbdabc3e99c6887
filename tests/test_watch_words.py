"""What ``coheft watch`` says of a run."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from coheft.app.run import launch
from coheft.app.run.folder import RunFile
from coheft.app.terminal.screen import Display
from coheft.wire.messages.requests import RunState
from coheft.wire.scenario.schema import MAX_DURATION
from tests.recording.runs import BEGIN


class Notes(Display):
    def __init__(self) -> None:
        self.texts: list[str] = []

    def note(self, text: str) -> None:
        self.texts.append(text)


@pytest.mark.parametrize(("duration", "time"), [(35.0, "5.0 of 35 s"), (MAX_DURATION, "5.0 s")])
def test_how_far_a_run_is_that_is_watched(duration: float, time: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that goes on until it is stopped has no duration to tell."""
    status = msgspec.structs.replace(BEGIN, time=5.0, duration=duration, state=RunState.FINISHED)
    observer = SimpleNamespace(ask=lambda request: status)
    monkeypatch.setattr(launch, "observe", lambda run_file: nullcontext(observer))
    notes = Notes()
    assert launch.watch(Path(), RunFile(run="x", server="x", agents={}), notes) == "the run has ended at 5.00 s"
    assert f"watching ring3, which is at {time}" in notes.texts
