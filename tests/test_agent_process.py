"""One agent's process, with its real links but no process at their other ends."""

from __future__ import annotations

import time

import numpy as np
import pytest

from coheft.agents.process.links import Stopped, open_links
from coheft.agents.process.main import AgentProcess
from coheft.agents.process.neighbour_link import SILENCE
from coheft.app.run.plan import make_plan
from coheft.errors import MessageError
from coheft.estimation.measurement import SAMPLE_SIZE
from coheft.wire.messages.structs import Measurements, NeighbourMessage, Ready
from coheft.wire.scenario.file import load_scenario
from coheft.wire.transport.inbox import Received, Refused


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


def test_measurements_of_a_former_world_are_not_processed_in_the_next_one(monkeypatch: pytest.MonkeyPatch) -> None:
    config = make_plan(load_scenario("ring3")).agents["r1"]
    samples = np.zeros((config.agent.block, SAMPLE_SIZE))
    waiting: list[Received] = []
    answered: list[int] = []
    deadline = time.monotonic() + 10.0

    def server_restarts(ready: Ready) -> None:
        waiting[:] = [
            Received("the server", Measurements("r1", block, samples, world=world, attempt=ready.attempt))
            for world, blocks in ((1, 3), (2, 2))
            for block in range(blocks)
        ]

    def receive(_: float) -> Received | None:
        if len(answered) == 3 or time.monotonic() > deadline:
            raise Stopped
        return waiting.pop(0) if waiting else None

    with open_links(config, Measurements, NeighbourMessage) as links:
        problems: list[str] = []
        monkeypatch.setattr(links.ready, "send", server_restarts)
        monkeypatch.setattr(links.reference, "send", lambda reference: answered.append(reference.answers))
        monkeypatch.setattr(links.problems, "tell", problems.append)
        monkeypatch.setattr(links, "receive", receive)
        with pytest.raises(Stopped):
            AgentProcess(config, links).run()
    assert answered[-2:] == [0, 1]
    assert not any("expected one after" in problem for problem in problems)
