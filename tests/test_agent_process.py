"""One agent's process, with its real links but no process at their other ends."""

from __future__ import annotations

import time

import pytest

from coheft.agents.process.links import Stopped, open_links
from coheft.agents.process.main import AgentProcess
from coheft.agents.process.neighbour_link import SILENCE
from coheft.app.run.plan import make_plan
from coheft.errors import MessageError
from coheft.wire.messages.structs import Measurements, NeighbourMessage
from coheft.wire.scenario.file import load_scenario
from coheft.wire.transport.inbox import Refused


def test_who_floods_an_agent_does_not_keep_it_from_dialling_others_again(monkeypatch: pytest.MonkeyPatch) -> None:
    agents = make_plan(load_scenario("ring3")).agents.values()
    config = next(each for each in agents if all(robot.endpoint is not None for robot in each.neighbours))
    dialled: list[str] = []
    deadline = time.monotonic() + 5.0 * SILENCE

    def flood(_: float) -> Refused:
        if dialled or time.monotonic() > deadline:
            raise Stopped
        return Refused(config.neighbours[0].name, MessageError("rubbish"))

    with open_links(config, Measurements, NeighbourMessage) as links:
        monkeypatch.setattr(links, "receive", flood)
        monkeypatch.setattr(links, "redial", dialled.append)
        AgentProcess(config, links).run()
    assert dialled
