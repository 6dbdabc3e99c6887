"""Numbers of a neighbour that are possible one by one, but with which nothing can be computed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from coheft.agents.agent import Agent
from coheft.agents.efficient.exchange import RowMessage
from coheft.agents.efficient.handover import CHANNEL, encode
from coheft.agents.efficient.settings import fit_settings
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit_settings import Guess
from coheft.estimation.moments.unknowns import State, Unknowns
from coheft.wire.messages.structs import Validity
from tests.in_process import changed

NAMES = ("r1", "r2", "r3")
Channels = dict[str, Any]


def with_fast_gyros(agent: Agent, channels: Channels) -> Channels:
    """Add a handover that says that gyros are off by 1e10 rad/s."""
    return with_handover(agent, channels, gyros=1e10)


def with_handover(agent: Agent, channels: Channels, gyros: float = 0.0) -> Channels:
    """Add a handover of an estimate with these offsets of gyros [rad/s]."""
    message = RowMessage.of_channels(channels)
    if message is None:
        return channels
    settings = fit_settings(agent.config, NAMES)
    state = State.first([Pose(np.eye(3), np.array([0.0, 0.0, 0.3 * k])) for k in range(3)], settings.errors)
    theta = np.array([2.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.1, 0.0, 0.0, 0.0])
    state = State(state.poses, state.eta, state.calibration, np.full(3, gyros), np.append(np.zeros(6), theta))
    size = Unknowns(3, settings.errors).size
    evidence = Evidence.of_rows(np.zeros(size), 100.0 * np.eye(size), np.zeros((size, size)), 1e6)
    prior = Prior(state, Guess.about(theta, 0.5), evidence, has_expectations=True)
    return channels | {CHANNEL: encode(message.team, prior, 0)}


def with_vast_parameters(agent: Agent, channels: Channels) -> Channels:
    """Replace the estimate of the load by numbers around 1e8."""
    return {
        name: 1e8 * np.random.default_rng(1).standard_normal(array.shape) if name == "parameters" else array
        for name, array in channels.items()
    }


@pytest.mark.parametrize(
    ("estimator", "tampered", "first"), [("efficient", with_fast_gyros, 4), ("fan2017", with_vast_parameters, 150)]
)
def test_the_estimator_starts_again_and_gets_over_it(
    estimator: str, tampered: Callable[[Agent, Channels], Channels], first: int
) -> None:
    scenario = changed("ring3", estimator=estimator, load_changes=())
    team = TeamInProcess(scenario)
    problems, last = [], {}
    for block in range(first + 350):
        result, heard = team.measure(), team.received()
        if first <= block < first + 60:
            heard["r1"] = [
                structs.replace(m, channels=tampered(team.agents["r1"], dict(m.channels))) if m.sender == "r2" else m
                for m in heard["r1"]
            ]
        outboxes = team.answer(measured(result), heard)
        problems += outboxes["r1"].problems
        last |= {name: outbox.estimate for name, outbox in outboxes.items() if outbox.estimate is not None}
    assert any("starts again" in problem for problem in problems)
    assert last["r1"].status is Validity.VALID
    assert last["r1"].payload.mass == pytest.approx(result.truth.payload.mass, rel=0.01)
