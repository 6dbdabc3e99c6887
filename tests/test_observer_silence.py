"""Requests to parts of a run that do not answer."""

from __future__ import annotations

import pytest

from coheft.app.run import observer
from coheft.app.run.folder import RunFile
from coheft.app.run.observer import ask_server, set_link
from coheft.errors import LinkError
from coheft.wire.messages.requests import StatusRequest
from tests.ports import free_port
from tests.synthetic_run import SCENE


def test_who_does_not_answer_is_named_and_for_how_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observer, "_ANSWER_LIMIT", 0.7)
    endpoints = {name: f"tcp/127.0.0.1:{free_port()}" for name in ("server", *SCENE.robots)}
    run_file = RunFile(run="test", server=endpoints.pop("server"), agents=endpoints)
    with pytest.raises(LinkError, match=r"^r2 does not answer within 0\.7 s$"):
        set_link(run_file, SCENE, "r1", "r2", cut=True)
    with pytest.raises(LinkError, match=r"^the run's server does not answer within 0\.7 s$"):
        ask_server(run_file, StatusRequest())
